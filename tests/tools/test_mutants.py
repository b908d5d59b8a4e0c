"""The tool that plants bugs: on a small repository whose tests are known, and its changes of sources, by hand."""

import json
import subprocess
from pathlib import Path

import pytest

from tools.mutants.__main__ import main, rooms_of
from tools.mutants.mutant import every_place, mutants_in_order

SOURCE = """\
from functools import cache


def area(a, b):
    return a * b


def half_circumference(a, b):
    return a + b


def rest(a, b):
    return a % b


@cache
def is_rectangular():
    return True


def never(a):
    return -a
"""
TESTS = """\
import subprocess
import sys

import pytest
from toy.rectangle import area, rest, half_circumference, is_rectangular


@pytest.fixture(scope="module")
def area_of_two():
    return area(2, 3)


@pytest.mark.parametrize("k", range(4))
def test_it_is_there(area_of_two, k):
    assert area(2, 3) and half_circumference(2, 3)
    is_rectangular()


def test_area(area_of_two):
    assert area_of_two == 6


def test_it_fails_anyway():
    assert half_circumference(2, 3) == 0


def test_in_a_program():
    subprocess.run([sys.executable, "-c", "from toy.rectangle import *; assert rest(7, 4) == 3"], check=True)


def test_what_is_kept():
    assert is_rectangular()
"""


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("COVERAGE_PROCESS_START", "PYTHONDONTWRITEBYTECODE"):
        monkeypatch.delenv(name, raising=False)
    files = {"toy/rectangle.py": SOURCE, "tests/test_rectangle.py": TESTS}
    for name, text in {**files, "toy/__init__.py": "", ".gitignore": "results/\n"}.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    named = [word for key in ("user.name=a", "user.email=a@b") for word in ("-c", key)]
    for command in (["init"], ["add", "."], [*named, "commit", "--message=all"]):
        subprocess.run(["git", *command], cwd=tmp_path, check=True, capture_output=True)
    return tmp_path


@pytest.mark.evidence
def test_what_tests_compare_is_seen_in_fixtures_programs_and_caches_and_nothing_else(
    toy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: the sum is only compared by a test that fails anyway, and nothing runs the last function."""
    report = toy / "results/report"
    main(["--map", "tests", "--jobs", "2"], toy)
    assert "1 failed, 7 passed" in capsys.readouterr().out
    for _ in range(2):  # the second time all is in the report
        main(["toy", "--semantic=0", "--token=99", "--seed=951add4", f"--report={report}"], toy)
        assert "toy: 60% of 5 token mutants seen" in capsys.readouterr().out
    entries = map(json.loads, report.read_text().splitlines())
    lines = ((entry["mutant"].partition(": ")[2].partition(" →")[0], entry["test"]) for entry in entries)
    assert {line: test.partition("::")[2] for line, test in lines} == {
        "return a * b": "test_area",
        "return a + b": "",
        "return a % b": "test_in_a_program",
        "return True": "test_what_is_kept",
        "return -a": "",
    }
    assert (toy / "toy/rectangle.py").read_text() == SOURCE


def test_a_seed_always_gives_the_same_mutants_in_an_order_of_its_own(toy: Path) -> None:
    rooms = rooms_of(toy)
    assert rooms == {"toy": [Path("toy/__init__.py"), Path("toy/rectangle.py")]}
    orders = {seed: [str(m) for m in mutants_in_order(toy, rooms["toy"], seed, "token")] for seed in (1, 2)}
    assert orders[1] == [str(mutant) for mutant in mutants_in_order(toy, rooms["toy"], 1, "token")]
    assert orders[1] != orders[2]
    assert sorted(orders[1]) == sorted(orders[2])


PYTHON = {
    "v = -a @ b\n": {"v = (b) @ (-a)", "v = (a) @ b"},
    "v = J.T @ f\n": {"v = (f) @ (J.T)", "v = J @ f"},
    "v = x[i, 0]\n": {"v = x[i - 1, 0]", "v = x[i, 1]"},
    "if a < 1.0 and b:\n    self.past = 0\n": {
        *("if a <= 1.0 and b:", "if a > 1.0 and b:", "if a < 1.0 or b:", "if not (a < 1.0 and b):"),
        *("if a < 1.1 and b:", "if a < (-1.0) and b:", "pass", "self.past = 1"),
    },
    "v = np.sqrt(np.mean(a))\n": {"v = (np.mean(a))", "v = np.sqrt(np.sum(a))"},
    "v = f(a, b)\n": {"v = f(b, a)"},
    "v = zip(a, b, strict=True)\n": set(),
    "raise E(f'{1 + 2}')\n": {"pass"},
    "total += 2\n": {"pass", "total -= 2", "total += 3", "total += 1"},
    "@frozen(True)\nclass C:\n    'Text 1.'\n    n: Array[3] = True\n": {"n: Array[3] = False"},
}

C = {
    "{/* a - b */ x = a * -b;\n}": {"{/* a - b */ x = a / -b;", "{/* a - b */ x = a * (b);", "{/* a - b */ ;"},
    "double *x = p + 4;\nchar y[6];\n": {f"double *x = p {other};" for other in ("- 4", "+ 5", "+ 3")},
    "if (a <= b && !c) i->past = 0;\n": {
        *("if (a < b && !c) i->past = 0;", "if (a > b && !c) i->past = 0;", "if (a <= b || !c) i->past = 0;"),
        *("if (a <= b && (c)) i->past = 0;", "if (!(a <= b && !c)) i->past = 0;", "if (a <= b && !c) ;"),
        "if (a <= b && !c) i->past = 1;",
    },
    "{ forget(x, y); return z; }\n": {"{ ; return z; }", "{ forget(y, x); return z; }"},
}

JAVASCRIPT = {
    'say("1 < 2"); const m = s.replace(/[-1]/g, "");\n': {'; const m = s.replace(/[-1]/g, "");'},
    "return a.map((v) => v % 2 === 0);\n": {
        *("return a.map((v) => v * 2 === 0);", "return a.map((v) => v % 2 !== 0);"),
        *(f"return a.map((v) => v % {n} === 0);" for n in (1, 3)),
        "return a.map((v) => v % 2 === 1);",
    },
}

MEANT = {
    ("swap", "return roll, pitch, yaw\n"): {"return pitch, roll, yaw", "return roll, yaw, pitch"},
    ("swap", "v = f(first=a, last=b)\n"): {"v = f(first=b, last=a)"},
    ("swap", "v = np.stack([s, c, one])\n"): {"v = np.stack([c, s, one])", "v = np.stack([s, one, c])"},
    ("name", 'v = table["leg_length"]\n'): {'v = table["leg_velocity"]'},
    ("option", "v = seed if own is None else own\n"): {"v = (seed)", "v = (own)"},
    ("dropped", "v = is_task and has_delay\n"): {"v = is_task", "v = has_delay"},
    ("dropped", "v = (x < low) | (x > high)\n"): {"v = (x < low)", "v = (x > high)"},
    ("one side", "v = low <= x <= high\n"): {"v = x <= high", "v = low <= x"},
    ("one side", "v = abs(error) < bound\n"): {"v = -(error) < bound"},
    ("unit", "v = np.degrees(angle)\n"): {"v = (angle)"},
    ("unit", "v = 1000 * length\n"): {"v = (length)"},
    ("frame", "v = rotation(o) @ v\n"): {"v = (rotation(o)).T @ v"},
    ("reduction", "v = error.max(axis=1)\n"): {"v = error.max()"},
    ("stale", "v = seeds[member]\n"): {"v = seeds[0]"},
    ("block", "v = u[first:last]\n"): {"v = u[:last]", "v = u[first:]"},
    ("block", "for k in range(n):\n    use(k)\n"): {"for k in range(1, n):", "for k in range((n) - 1):"},
    ("sibling", "def f(p):\n    return p.low, p.high\n"): {"return p.high, p.high", "return p.low, p.low"},
}

MEANT_IN_TOKENS = {
    ("dropped", "if (a && !b) x = 1;\n"): {"if (a) x = 1;", "if (!b) x = 1;"},
    ("option", "y = has ? a[0] : b;\n"): {"y = (a[0]);", "y = (b);"},
    ("stale", "y = out[k] + 1;\n"): {"y = out[0] + 1;"},
    ("one side", "if (fabs(e) > most) stop();\n"): {"if (-(e) > most) stop();"},
    ("unit", "text = 1e3 + x * 1000;\n"): {"text = 1e3 + (x);"},
    ("block", "for (int k = 0; k < n; k++) sum += v[k];\n"): {"for (int k = 0; k < n - 1; k++) sum += v[k];"},
    ("name", 'draw("roll", 2);\n'): {'draw("pitch", 2);'},
    ("swap", "const axes = [right, up];\n"): {"const axes = [up, right];"},
}


def after(suffix: str, source: str, mistake: str) -> set[str]:
    """The changed lines of all mutants of a source that imitate a mistake; without one, of those of tokens."""
    kind = "semantic" if mistake else "token"
    places = every_place(Path(f"x{suffix}"), source.encode(), kind)
    return {mutant.after for place in places for mutant in place if mutant.mistake == mistake}


@pytest.mark.parametrize(
    ("suffix", "mistake", "source", "expected"),
    [
        *((".py", "", source, expected) for source, expected in PYTHON.items()),
        *((".c", "", source, expected) for source, expected in C.items()),
        *((".js", "", source, expected) for source, expected in JAVASCRIPT.items()),
        *((".py", *case, expected) for case, expected in MEANT.items()),
        *((".js" if "const" in case[1] else ".c", *case, expected) for case, expected in MEANT_IN_TOKENS.items()),
    ],
)
def test_changes_of_tokens_and_of_meaning(suffix: str, mistake: str, source: str, expected: set[str]) -> None:
    """Expected: written by hand; no change of meaning repeats one of tokens."""
    assert after(suffix, source, mistake) == expected
    assert not mistake or not expected & after(suffix, source, "")
