"""`gough-stewart build --check`: units that are right pass, and one that is wrong anywhere fails, with the reason."""

import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from gough_stewart import build, load_preset
from gough_stewart.fmu_build.build import to_zip
from gough_stewart.harness.plants.unit_check import BOUND, UnitCheck, check_units
from tests.support.commands import invoke
from tests.support.real_platforms import real_platform
from tests.support.uneven import UNEVEN

NAMES = ["validation", "Co-Simulation", "Model Exchange"]
Files = dict[str, bytes]
PLATFORMS = {
    "uneven": UNEVEN,
    "sticks_and_gives": real_platform("lugre", springs=True),
    # whose smooth friction changes sign within a millimetre per second; the small one follows forces at once
    "motion_base": load_preset("motion_base"),
    "desktop_hexapod": load_preset("desktop_hexapod"),
    "gives": real_platform(springs=True),
    "sticks": real_platform("elasto_plastic"),
}
UNITS = [(name, fmi) for name in PLATFORMS for fmi in ("2.0", "3.0")]
FAST = (*UNITS[:2], ("sticks_and_gives", "2.0"))


@pytest.fixture(scope="module")
def units(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Files]:
    """The files of sound units."""
    found = {}
    for version, path in zip((2, 3), build(tmp_path_factory.mktemp("units"), platform=UNEVEN), strict=True):
        with zipfile.ZipFile(path) as archive:
            found[version] = {name: archive.read(name) for name in archive.namelist()}
    return found


def checks_of(files: Files, tmp_path: Path) -> list[UnitCheck]:
    """The three checks of a unit of these files."""
    path = tmp_path / "unit.fmu"
    path.write_bytes(to_zip(files))
    checks = list(check_units([path]))
    assert [check.name for check in checks] == NAMES
    return checks


def changed(files: Files, place: str, change: Callable[[str], str]) -> Files:
    """The same, with those that end so changed."""
    places = [name for name in files if name.endswith(place)]
    assert places
    return files | {name: change(files[name].decode()).encode() for name in places}


@pytest.mark.parametrize(
    ("name", "fmi"), [unit if unit in FAST else pytest.param(*unit, marks=pytest.mark.evidence) for unit in UNITS]
)
def test_units_pass_all_checks(name: str, fmi: str, tmp_path: Path) -> None:
    """Expected: the files' reference results at 1e-12 in Python; inputs vary linearly in one of the cases.

    To a fifth of the bound, so that a sound unit of another platform does not fail.
    """
    (path,) = build(tmp_path, platform=PLATFORMS[name], fmi=[fmi])
    validation, *comparisons = check_units([path])
    assert validation == UnitCheck(path.name, "validation", "no problem", passed=True)
    for check in comparisons:
        assert check.passed
        assert check.deviation is not None
        assert 0 < check.deviation <= 0.2 * BOUND
        assert re.fullmatch(r"\d\.\de-\d\d \((open_loop|varying_inputs)\)", check.result)


@pytest.mark.parametrize(("version", "case"), [(2, "open_loop"), (3, "varying_inputs")])
def test_another_result_anywhere_fails_both_kinds(
    version: int, case: str, units: dict[int, Files], tmp_path: Path
) -> None:
    """Expected: the last number of the last row, an angular acceleration, differs by twice the bound."""

    def other(text: str) -> str:
        rows = text.splitlines()
        head, _, last = rows[-1].rpartition(" " if version == 3 else ",")
        by = 2 * BOUND * max(1.0, *(abs(float(w)) for row in rows[1:] for w in re.split(r"[ ,]", row)[-3:]))
        rows[-1] = f"{head}{' ' if version == 3 else ','}{float(last.strip(chr(34))) + by!r}"
        return "\n".join(rows) + "\n"

    validation, *comparisons = checks_of(changed(units[version], f"{case}/gough_stewart_ref.csv", other), tmp_path)
    assert validation.passed
    for check in comparisons:
        assert not check.passed
        assert check.deviation == pytest.approx(2 * BOUND, rel=0.1)
        assert check.result.endswith(f"({case})")


@pytest.mark.parametrize("place", ["open_loop/gough_stewart_in.csv", "open_loop/gough_stewart_start.csv"])
def test_the_inputs_and_starts_of_the_files_are_those_of_the_run(
    place: str, units: dict[int, Files], tmp_path: Path
) -> None:
    """Expected: with the first force or position a percent larger, both kinds deviate, by the same."""

    def larger(text: str) -> str:
        return re.sub(r"^([\d.e-]+),([\d.e-]+)", lambda m: f"{m[1]},{1.01 * float(m[2])!r}", text, flags=re.M)

    _, stepped, integrated = checks_of(changed(units[3], place, larger), tmp_path)
    assert stepped.deviation is not None
    assert stepped.deviation > 1e-4
    assert stepped.deviation == pytest.approx(integrated.deviation, rel=1e-3)
    assert not stepped.passed


def _described(pattern: str, new: str, count: int = 0) -> Callable[[Files], Files]:
    return lambda files: changed(files, "modelDescription.xml", lambda text: re.sub(pattern, new, text, count=count))


def _without_forces(files: Files) -> Files:
    """The platform falls into the plane of its base within a second."""
    zeros = " ".join(["0.0"] * 6)
    falling = re.compile(r"^([\d.e-]+),[^,]*,", re.M)
    return changed(files, "gough_stewart_in.csv", lambda text: falling.sub(rf"\1,{zeros},", text))


# Version, what is done to the files, what passes, and the reason of what does not.
WRONG: dict[str, tuple[int, Callable[[Files], Files], list[bool], str]] = {
    "an output without its entry in ModelStructure": (
        *(3, _described(r" *<Output [^>]*/>\n", "", 1)),
        *([False, True, True], "ModelStructure/Outputs"),
    ),
    "another token": (2, _described(r'guid="\{.', 'guid="{x'), [True, False, False], "wrong token"),
    "no results": (
        2,
        lambda files: {name: content for name, content in files.items() if not name.startswith("extra/")},
        *([True, False, False], "has no reference results in extra/gough_stewart"),
    ),
    "a description that is too long": (
        *(3, _described(r"\Z", " " * 20_000_000), [False, False, False]),
        r"its modelDescription\.xml has 20\.\d MB; expected at most 20 MB; nothing was parsed",
    ),
    "a motion into a limit": (3, _without_forces, [True, False, False], "."),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_unit_that_is_wrong_fails_with_the_reason(case: str, units: dict[int, Files], tmp_path: Path) -> None:
    version, change, passes, reason = WRONG[case]
    checks = checks_of(change(units[version]), tmp_path)
    assert [check.passed for check in checks] == passes
    assert all(check.passed or re.search(reason, check.result) for check in checks)
    assert [check.passed for check in check_units([tmp_path / "nowhere.fmu"])] == [False] * 3


def test_the_command_says_a_line_for_each_check_and_fails_with_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: exit code 0 with three lines; 3 where a check failed, with its name, and the files are there."""
    monkeypatch.chdir(tmp_path)
    done = invoke("build", "--check", "--fmi", "2.0", "--out", "fmus")
    assert done.exit_code == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].endswith("; all 3 checks passed")
    for name in NAMES:
        (line,) = [line for line in lines if "_fmi2.fmu" in line and f" {name} " in line]
        assert " passed " in line
    failed = UnitCheck("a.fmu", "Model Exchange", "2.0e-03 (open_loop)", passed=False, deviation=2e-3)
    passed = UnitCheck("a.fmu", "Co-Simulation", "1.0e-09 (open_loop)", passed=True, deviation=1e-9)
    monkeypatch.setattr("gough_stewart.harness.plants.unit_check.check_units", lambda _paths: iter([passed, failed]))
    done = invoke("build", "--check", "--fmi", "3.0", "--out", "other", "--require", "checks.deviation <= 0.01")
    assert done.exit_code == 3
    assert "; 1 of 2 checks failed: Model Exchange of a.fmu" in done.stdout.splitlines()[0]
    assert re.search(r"Model Exchange +│ FAILED +│ +2.0e-03 \(open_loop\)", done.stdout)
    assert {p.name for p in Path("other").iterdir()} == {"gough_stewart_fmi3.fmu", "report.json"}
