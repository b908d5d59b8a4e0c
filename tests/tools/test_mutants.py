"""The tool that plants bugs, on a module of a few lines whose mutants are known."""

import json
import subprocess
from functools import cache
from itertools import islice
from pathlib import Path

import pytest

from tools.mutants.__main__ import ROOT, main
from tools.mutants.folders import is_of_another_room, rooms
from tools.mutants.mutation import Mutant
from tools.mutants.selection import equivalents, every_mutant, files_in, mutants_in_order

TOY = """\
def area(a, b):
    return a * b


def half_circumference(a, b):
    return a + b
"""
# They see the area, and call the other without a look at it.
TESTS = """\
from toy.rectangle import area, half_circumference


def test_it():
    assert area(2, 3) == 6
    half_circumference(2, 3)
"""


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    root = tmp_path / "repository"
    for name, text in {"toy/rectangle.py": TOY, "tests/toy/test_rectangle.py": TESTS, "toy/__init__.py": ""}.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    subprocess.run(["git", "init", "--quiet"], cwd=root, check=True)
    return root


def test_what_the_tests_look_at_is_killed_and_what_they_only_call_survives(
    toy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: the product that the test compares is seen, the sum that it does not compare is not."""
    report = tmp_path / "report.json"
    assert main(["toy", "--report", str(report)], toy, libraries=()) == 1
    fates = {key.split("|")[1]: fate for key, fate in json.loads(report.read_text()).items()}
    assert fates == {"return a * b": "KILLED", "return a + b": "SURVIVED"}
    printed = capsys.readouterr().out
    assert "toy: 1 of 2 token mutants killed, 50 % (0 by timeout; 0 more did not compile)" in printed
    assert printed.count("\nsurvived: toy/rectangle.py:6") == 1
    assert (toy / "toy/rectangle.py").read_text() == TOY
    assert sorted(path.name for path in toy.iterdir()) == [".git", "tests", "toy"]


def test_draws_of_both_kinds_share_one_run_and_do_not_try_a_mutant_twice(
    toy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: the second draw of the same seed is empty; the tests see both mutants of the two conditions."""
    wide = "\n\ndef is_wide(a, b):\n    return a > 1 and b > 1\n"
    tests = "    assert is_wide(2, 2)\n    assert not is_wide(2, 0)\n    assert not is_wide(0, 2)\n"
    (toy / "toy/rectangle.py").write_text(TOY + wide)
    (toy / "tests/toy/test_rectangle.py").write_text(TESTS.replace("import", "import is_wide,", 1) + tests)
    report = tmp_path / "report.json"
    draws = ["--draw", "token:1:99", "--draw", "token:1:99", "--draw", "semantic:1:9"]
    assert main(["toy", "--report", str(report), *draws, "--least", "0"], toy, libraries=()) == 0
    printed = capsys.readouterr().out
    assert printed.count("first run") == 1
    tokens = len(mutants_in_order(toy, files_in(toy, ["toy"]), 1))
    assert f" of {tokens} token mutants killed" in printed
    assert "toy: 2 of 2 semantic mutants killed, 100 %" in printed
    assert len(json.loads(report.read_text())) == tokens + 2


def test_a_room_contains_no_files_of_the_rooms_inside_it(tmp_path: Path) -> None:
    """Expected: written by hand."""
    files = ["model/a.py", "model/inner/b.py", "harness/__init__.py", "harness/web/c.js", "fmu_build/c/unit/d.c"]
    for name in ("model/data/e.toml", *files):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    found = rooms(tmp_path)
    assert found == ("fmu_build/c", "harness/web", "model", "model/inner")
    assert not is_of_another_room(Path("model/a.py"), "model", found)
    assert is_of_another_room(Path("model/inner/b.py"), "model", found)
    assert not is_of_another_room(Path("model/inner/b.py"), "model/inner", found)
    assert not is_of_another_room(Path("fmu_build/c/unit/d.c"), "fmu_build/c/unit", found)


@pytest.mark.parametrize(
    ("body", "message"),
    [("assert False", "must pass on the unchanged"), ("import pytest; pytest.skip('no browser')", "no test ran")],
)
def test_tests_that_fail_without_a_mutant_or_do_not_run_are_no_evidence(
    toy: Path, capsys: pytest.CaptureFixture[str], body: str, message: str
) -> None:
    (toy / "tests/toy/test_rectangle.py").write_text(f"def test_it():\n    {body}\n")
    assert main(["toy"], toy, libraries=()) == 2
    assert message in capsys.readouterr().err


def test_a_seed_always_gives_the_same_mutants_and_other_lines_do_not_change_them(toy: Path) -> None:
    files = files_in(toy, ["toy"])
    listed = [mutants_in_order(toy, files, seed) for seed in range(10)]
    assert listed == [mutants_in_order(toy, files, seed) for seed in range(10)]
    assert {m.file for m in listed[0]} == {Path("toy/rectangle.py")}
    assert len({tuple(m.key for m in each) for each in listed}) == 2  # two orders of two
    (toy / "toy/rectangle.py").write_text("# moved down\nSIDES = 4\n" + TOY)
    moved = [m.key for m in mutants_in_order(toy, files, 1)]
    assert [key for key in moved if "SIDES" not in key] == [m.key for m in listed[1]]


@pytest.mark.evidence
def test_every_equivalent_mutant_is_one_of_its_file() -> None:
    """Expected: the sources as they are; an entry whose lines have changed has to be looked at again."""
    known = equivalents()

    @cache
    def mutants_of(file: Path) -> list[Mutant]:
        return list(every_mutant(file, (ROOT / file).read_bytes(), ("token", "semantic")))

    for name, before, after in known.single:
        assert (before, after) in {(mutant.before, mutant.after) for mutant in mutants_of(Path(name))}
    for pattern, _, why in known.families:
        files = files_in(ROOT, [str(Path(pattern).parent)], Path(pattern).name)
        family = (mutant for file in files for mutant in mutants_of(file) if known.reason(mutant) == why)
        assert len(list(islice(family, 2))) == 2, pattern


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


@pytest.mark.parametrize("source", PYTHON)
def test_changes_of_python(source: str) -> None:
    """Expected: written by hand."""
    found = {mutant.after for mutant in every_mutant(Path("x.py"), source.encode())}
    assert found == PYTHON[source]


TOKENS = {
    "{/* a - b */ x = a * -b;\n}": {"{/* a - b */ x = a / -b;", "{/* a - b */ x = a * b;", "{/* a - b */ ;"},
    "double *x = p + 4;\nchar y[6];\n": {f"double *x = p {other};" for other in ("- 4", "+ 5", "+ 3")},
    "if (a <= b && !c) i->past = 0;\n": {
        *("if (a < b && !c) i->past = 0;", "if (a > b && !c) i->past = 0;", "if (a <= b || !c) i->past = 0;"),
        *(
            "if (a <= b && c) i->past = 0;",
            "if (!(a <= b && !c)) i->past = 0;",
            "if (a <= b && !c) ;",
            "if (a <= b && !c) i->past = 1;",
        ),
    },
    "{ forget(x, y); return z; }\n": {"{ ; return z; }", "{ forget(y, x); return z; }"},
    'say("1 < 2"); const m = s.replace(/[-1]/g, "");\n': set[str](),
    "return a.map((v) => v % 2 === 0);\n": {
        *("return a.map((v) => v * 2 === 0);", "return a.map((v) => v % 2 !== 0);"),
        *(f"return a.map((v) => v % {n} === 0);" for n in (1, 3)),
        "return a.map((v) => v % 2 === 1);",
    },
}


@pytest.mark.parametrize("source", TOKENS)
def test_changes_of_c_and_javascript(source: str) -> None:
    """Expected: written by hand."""
    found = {mutant.after for mutant in every_mutant(Path("x.c"), source.encode())}
    assert found == TOKENS[source]


# Bugs as people write them, each made by an operator; by operator, source and changed line.
MEANT = {
    ("swap", "return roll, pitch, yaw\n"): {"return pitch, roll, yaw", "return roll, yaw, pitch"},
    ("swap", "v = f(first=a, last=b)\n"): {"v = f(first=b, last=a)"},
    ("swap", "v = {'x': low, 'y': high}\n"): {"v = {'x': high, 'y': low}"},
    ("swap", "v = np.stack([s, c, one])\n"): {"v = np.stack([c, s, one])", "v = np.stack([s, one, c])"},
    ("name", "v = record['position']\n"): {"v = record['orientation']"},
    ("name", 'v = table["leg_length"]\n'): {'v = table["leg_velocity"]'},
    ("name", "v = axes['roll']\n"): {"v = axes['pitch']"},
    ("option", "v = seed if own is None else own\n"): {"v = (seed)", "v = (own)"},
    ("option", "v = a if filtered else b\n"): {"v = (a)", "v = (b)"},
    ("dropped", "v = is_task and has_delay\n"): {"v = is_task", "v = has_delay"},
    ("dropped", "v = bandwidth or 2.0\n"): {"v = bandwidth", "v = 2.0"},
    ("dropped", "v = (x < low) | (x > high)\n"): {"v = (x < low)", "v = (x > high)"},
    ("one side", "v = low <= x <= high\n"): {"v = x <= high", "v = low <= x"},
    ("one side", "v = abs(error) < bound\n"): {"v = -(error) < bound"},
    ("one side", "v = 0 < share < 1\n"): {"v = share < 1", "v = 0 < share"},
    ("unit", "v = np.degrees(angle)\n"): {"v = (angle)"},
    ("unit", "v = 1000 * length\n"): {"v = (length)"},
    ("unit", "v = time / 1e3\n"): {"v = (time)"},
    ("frame", "v = R @ f\n"): {"v = (R).T @ f"},
    ("frame", "v = rotation(o) @ v\n"): {"v = (rotation(o)).T @ v"},
    ("reduction", "v = error.max(axis=1)\n"): {"v = error.max()"},
    ("reduction", "v = np.all(fine, axis=-1)\n"): {"v = np.all(fine)"},
    ("stale", "v = seeds[member]\n"): {"v = seeds[0]"},
    ("stale", "v = row[k]\n"): {"v = row[0]"},
    ("block", "v = u[first:last]\n"): {"v = u[:last]", "v = u[first:]"},
    ("block", "for k in range(chunks):\n    use(k)\n"): {
        "for k in range(1, chunks):",
        "for k in range((chunks) - 1):",
    },
    ("sibling", "def f(p):\n    return p.platform, p.machine\n"): {
        "return p.machine, p.machine",
        "return p.platform, p.platform",
    },
}


@pytest.mark.parametrize(("operator", "source"), MEANT)
def test_bugs_of_meaning_in_python(operator: str, source: str) -> None:
    """Expected: written by hand; no change of tokens makes any of them."""
    mutants = list(every_mutant(Path("x.py"), source.encode(), ("semantic",)))
    found = {mutant.after for mutant in mutants if mutant.change.operator == operator}
    assert found == MEANT[operator, source]
    assert not found & {mutant.after for mutant in every_mutant(Path("x.py"), source.encode())}


MEANT_IN_TOKENS = {
    ("dropped", "if (a && !b) x = 1;\n"): {"if (a) x = 1;", "if (!b) x = 1;"},
    ("dropped", "return low > x || x > high;\n"): {"return low > x;", "return x > high;"},
    ("option", "y = has ? a[0] : b;\n"): {"y = (a[0]);", "y = (b);"},
    ("stale", "y = out[k] + 1;\n"): {"y = out[0] + 1;"},
    ("one side", "if (fabs(e) > most) stop();\n"): {"if ((e) > most) stop();", "if (-(e) > most) stop();"},
    ("unit", "text = 1e3 + x * 1000;\n"): {"text = 1e3 + x ;"},
    ("block", "for (int k = 0; k < n; k++) sum += v[k];\n"): {"for (int k = 0; k < n - 1; k++) sum += v[k];"},
    ("name", 'draw("roll", 2);\n'): {'draw("pitch", 2);'},
    ("swap", "const axes = [right, up, ahead];\n"): {
        "const axes = [up, right, ahead];",
        "const axes = [right, ahead, up];",
    },
    ("sibling", "{ y = c->low + c->high; }\n"): {"{ y = c->high + c->high; }", "{ y = c->low + c->low; }"},
}


@pytest.mark.parametrize(("operator", "source"), MEANT_IN_TOKENS)
def test_bugs_of_meaning_in_c_and_javascript(operator: str, source: str) -> None:
    """Expected: written by hand."""
    mutants = every_mutant(Path("x.c"), source.encode(), ("semantic",))
    assert {mutant.after for mutant in mutants if mutant.change.operator == operator} == MEANT_IN_TOKENS[
        operator, source
    ]


@pytest.mark.evidence
def test_a_small_sample_of_bugs_of_meaning_has_three_of_every_operator() -> None:
    """Expected: counted in the first ones of two rooms of this project, whose operators differ in frequency."""
    files = files_in(ROOT, ["harness/tuning", "harness/ensemble"])
    ordered = mutants_in_order(ROOT, files, 7, "semantic")
    operators = {mutant.change.operator for mutant in ordered}
    first = [mutant.change.operator for mutant in ordered[: 3 * len(operators)]]
    available = {each: sum(mutant.change.operator == each for mutant in ordered) for each in operators}
    assert len(operators) >= 9
    for each in operators:
        assert first.count(each) >= min(3, available[each])
    assert ordered == mutants_in_order(ROOT, files, 7, "semantic")


def test_scripts_whose_browser_tests_were_skipped_are_said_to_be_unmeasured(
    toy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: none of the script's mutants counts as survived, and the command fails."""
    (toy / "toy/page.js").write_text("const a = 1 + x;\n")
    (toy / "tests/toy/test_page.py").write_text("import pytest\n\n\ndef test_page():\n    pytest.skip('no Chromium')\n")
    assert main(["toy", "--least", "0"], toy, libraries=()) == 1
    printed = capsys.readouterr().out
    assert "toy: scripts are unmeasured, since 1 tests were skipped: Skipped: no Chromium" in printed
    assert "page.js" not in printed
