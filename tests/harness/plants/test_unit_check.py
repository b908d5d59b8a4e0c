"""`gough-stewart build --check`: units that are right pass, and one that is wrong anywhere fails, with the reason."""

import json
import re
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

import gough_stewart as gs
from gough_stewart.harness.plants.unit_check import check_units
from tests.support.commands import invoke
from tests.support.real_platforms import real_platform
from tests.support.uneven import UNEVEN

NAMES = ["validation", "Co-Simulation", "Model Exchange"]
BOUND = 1e-5
Files = dict[str, bytes]
PLATFORMS = {
    "uneven": UNEVEN,
    "sticks_and_gives": real_platform("lugre", springs=True),
    # whose smooth friction changes sign within a millimetre per second; the small one follows forces at once
    "motion_base": gs.load_preset("motion_base"),
    "desktop_hexapod": gs.load_preset("desktop_hexapod"),
    "gives": real_platform(springs=True),
    "sticks": real_platform("elasto_plastic"),
}


@pytest.mark.parametrize(
    "name", [name if name == "uneven" else pytest.param(name, marks=pytest.mark.evidence) for name in PLATFORMS]
)
def test_units_pass_all_checks(name: str, tmp_path: Path) -> None:
    """Expected: the files' reference results at 1e-12 in Python, to a fifth of the bound."""
    gs.save_platform(PLATFORMS[name], tmp_path / "mine.toml")
    done = invoke("build", "--check", "--platform", str(tmp_path / "mine.toml"), "--out", str(tmp_path / "out"))
    assert done.exit_code == 0, done.output
    assert done.stdout.splitlines()[0].endswith("; all 6 checks passed")
    for version in "23":
        for kind in NAMES:
            assert re.search(rf"_fmi{version}.fmu.* {kind} .* passed ", done.stdout)
    deviations = re.findall(r"(\d\.\de-\d\d) \((?:open_loop|varying_inputs)\)", done.stdout)
    assert len(deviations) == 4
    assert 0 < max(map(float, deviations)) <= 0.2 * BOUND


def test_a_wrong_unit_is_named_and_ends_the_command_with_3(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: both kinds of a unit from a compiler that takes sines for cosines fail; the files are there."""
    monkeypatch.setenv("CC", f"{sys.executable} -m ziglang cc -Dcos=sin -Xclang -disable-llvm-passes")
    done = invoke("build", "--check", "--fmi", "3.0", "--out", str(tmp_path))
    assert done.exit_code == 3
    assert "; 2 of 3 checks failed: Co-Simulation of gough_stewart_fmi3.fmu and Model" in done.stdout.splitlines()[0]
    assert len(re.findall("│ FAILED +│", done.stdout)) == 2
    assert {p.name for p in tmp_path.iterdir()} == {"gough_stewart_fmi3.fmu", "report.json"}
    assert json.loads((tmp_path / "report.json").read_text())["verdict"]["status"] == "bad"


@pytest.fixture(scope="module")
def units(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Files]:
    """The files of sound units."""
    found = {}
    for version, path in zip((2, 3), gs.build(tmp_path_factory.mktemp("units"), platform=UNEVEN), strict=True):
        with zipfile.ZipFile(path) as archive:
            found[version] = {name: archive.read(name) for name in archive.namelist()}
    return found


def changed(place: str, change: Callable[[str], str]) -> Callable[[Files], Files]:
    """The same, with those that end so changed."""

    def files_with(files: Files) -> Files:
        places = [name for name in files if name.endswith(place)]
        assert places
        return files | {name: change(files[name].decode()).encode() for name in places}

    return files_with


def described(pattern: str, new: str) -> Callable[[Files], Files]:
    return changed("modelDescription.xml", lambda text: re.sub(pattern, new, text, count=1))


def other_number(row: int) -> Callable[[str], str]:
    """An angular acceleration in a row differs by twice the bound."""

    def changed_at(text: str) -> str:
        rows = text.splitlines()
        separator = " " if '"' not in rows[row] and " " in rows[row] else ","
        head, _, last = rows[row].rpartition(separator)
        by = 2 * BOUND * max(1.0, *(abs(float(w)) for line in rows[1:] for w in re.split(r"[ ,]", line)[-3:]))
        rows[row] = f"{head}{separator}{float(last) + by!r}"
        return "\n".join(rows) + "\n"

    return changed_at


def larger(text: str) -> str:
    """The first force or position is a percent larger."""
    return re.sub(r"^([\d.e-]+),([\d.e-]+)", lambda m: f"{m[1]},{1.01 * float(m[2])!r}", text, flags=re.M)


def without_forces(text: str) -> str:
    """The platform falls into the plane of its base within a second."""
    return re.sub(r"^([\d.e-]+),[^,]*,", rf"\1,{' '.join(['0.0'] * 6)},", text, flags=re.M)


RUNS_FAIL, TWICE = [True, False, False], r"^(2\.\d|1\.9)e-05"
# Version, what is done to the files, what passes, and the reason of what does not.
WRONG: dict[str, tuple[int, Callable[[Files], Files], list[bool], str]] = {
    "another result": (2, changed("loop/gough_stewart_ref.csv", other_number(40)), RUNS_FAIL, f"{TWICE} \\(open_loop"),
    "another result of the other case": (
        3, changed("varying_inputs/gough_stewart_ref.csv", other_number(-1)), RUNS_FAIL, f"{TWICE} \\(varying_inputs",
    ),
    "another input": (3, changed("open_loop/gough_stewart_in.csv", larger), RUNS_FAIL, "open_loop"),
    "another start": (3, changed("open_loop/gough_stewart_start.csv", larger), RUNS_FAIL, "open_loop"),
    "no output in ModelStructure": (3, described(r" *<Output [^>]*/>\n", ""), [False, True, True], "Structure/Outputs"),
    "another token": (3, described(r'instantiationToken="\w', 'instantiationToken="x'), RUNS_FAIL, "wrong token"),
    "no results": (
        3, lambda files: {name: content for name, content in files.items() if not name.startswith("extra/")}, RUNS_FAIL,
        "has no reference results in extra/gough_stewart",
    ),
    "a motion into a limit": (3, changed("gough_stewart_in.csv", without_forces), RUNS_FAIL, "."),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_unit_that_is_wrong_fails_with_the_reason(case: str, units: dict[int, Files], tmp_path: Path) -> None:
    """Expected: the checks that do not concern it pass."""
    version, change, passes, reason = WRONG[case]
    with zipfile.ZipFile(tmp_path / "unit.fmu", "w") as archive:
        for name, content in change(units[version]).items():
            archive.writestr(name, content)
    checks = list(check_units([tmp_path / "unit.fmu"]))
    assert [(check.name, check.passed) for check in checks] == [*zip(NAMES, passes, strict=True)]
    assert all(check.passed or re.search(reason, check.result) for check in checks)


def test_of_a_file_that_is_not_there_no_check_passes(tmp_path: Path) -> None:
    assert [check.passed for check in check_units([tmp_path / "nowhere.fmu"])] == [False] * 3
