"""`gough-stewart build --check`: units that are right pass, and one that is wrong anywhere fails, with the reason."""

import re
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from gough_stewart.fmu_build.build import build, to_zip
from gough_stewart.harness.plants.unit_check import BOUND, UnitCheck, check_units
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset
from tests.support.commands import invoke
from tests.support.real_platforms import real_platform
from tests.support.uneven import UNEVEN

NAMES = ["validation", "Co-Simulation", "Model Exchange"]


PLATFORMS = {
    "uneven": UNEVEN,
    # whose smooth friction changes sign within a millimetre per second; the small one follows forces at once
    "motion_base": load_preset("motion_base"),
    "desktop_hexapod": load_preset("desktop_hexapod"),
    "gives": real_platform(springs=True),
    "sticks": real_platform("elasto_plastic"),
    "sticks_and_gives": real_platform("lugre", springs=True),
}


@pytest.fixture(scope="module", params=PLATFORMS)
def built(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Platform, list[Path]]:
    """A platform with its units."""
    platform = PLATFORMS[request.param]
    return platform, build(tmp_path_factory.mktemp("built"), platform=platform)


def changed(path: Path, place: str, change: Callable[[str], str]) -> Path:
    """The unit beside its original, with the files that end so changed."""
    with zipfile.ZipFile(path) as archive:
        contents = {name: archive.read(name) for name in archive.namelist()}
    found = [name for name in contents if name.endswith(place)]
    assert found
    for name in found:
        contents[name] = change(contents[name].decode()).encode()
    out = path.with_name(f"changed_{path.name}")
    out.write_bytes(to_zip(contents))
    return out


def outcomes(checks: list[UnitCheck]) -> Mapping[str, bool]:
    return {each.name: each.passed for each in checks}


def test_units_pass_all_checks(built: tuple[Platform, list[Path]]) -> None:
    """Expected: the files' reference results at 1e-12 in Python; inputs vary linearly in one of the cases.

    To a fifth of the bound, so that a sound unit of another platform does not fail.
    """
    found = list(check_units(built[1]))
    assert [(each.file, each.name) for each in found] == [
        (f"gough_stewart_fmi{version}.fmu", name) for version in (2, 3) for name in NAMES
    ]
    assert all(each.passed for each in found), found
    assert [each.found for each in found if each.name == "validation"] == ["no problem"] * 2
    for each in found:
        if each.name != "validation":
            assert each.deviation is not None
            assert 0 < each.deviation <= 0.2 * BOUND
            assert re.fullmatch(r"\d\.\de-\d\d \((open_loop|varying_inputs)\)", each.found)


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("case", ["open_loop", "varying_inputs"])
def test_another_result_anywhere_fails_both_kinds(version: int, case: str, tmp_path: Path) -> None:
    """Expected: the last number of the last row, an angular acceleration, differs by twice the bound."""
    path = build(tmp_path, fmi=[f"{version}.0"], platform=UNEVEN)[0]

    def other(text: str) -> str:
        rows = text.splitlines()
        head, _, last = rows[-1].rpartition(" " if version == 3 else ",")
        by = 2 * BOUND * max(1.0, *(abs(float(w)) for row in rows[1:] for w in re.split(r"[ ,]", row)[-3:]))
        rows[-1] = f"{head}{' ' if version == 3 else ','}{float(last.strip(chr(34))) + by!r}"
        return "\n".join(rows) + "\n"

    found = list(check_units([changed(path, f"{case}/gough_stewart_ref.csv", other)]))
    assert outcomes(found) == dict(zip(NAMES, (True, False, False), strict=True))
    for each in found[1:]:
        assert each.deviation == pytest.approx(2 * BOUND, rel=0.1)
        assert each.found.endswith(f"({case})")


@pytest.mark.parametrize("place", ["open_loop/gough_stewart_in.csv", "open_loop/gough_stewart_start.csv"])
def test_the_inputs_and_starts_of_the_files_are_those_of_the_run(place: str, tmp_path: Path) -> None:
    """Expected: with the first force or position a percent larger, both kinds deviate, by the same."""
    path = build(tmp_path, fmi=["3.0"], platform=UNEVEN)[0]

    def larger(text: str) -> str:
        return re.sub(r"^([\d.e-]+),([\d.e-]+)", lambda m: f"{m[1]},{1.01 * float(m[2])!r}", text, flags=re.M)

    _, stepped, integrated = check_units([changed(path, place, larger)])
    assert stepped.deviation == pytest.approx(integrated.deviation, rel=1e-3)
    assert stepped.deviation is not None
    assert stepped.deviation > 1e-4
    assert not stepped.passed


@pytest.mark.parametrize(
    ("platform", "parameter"),
    [("gives", "leg_damping"), ("sticks", "leg_bristle_damping")],
)
def test_a_unit_with_other_equations_fails_both_kinds(platform: str, parameter: str, tmp_path: Path) -> None:
    """Expected: the results of a platform with a percent more of one parameter are not those of the unit."""
    sound = PLATFORMS[platform]
    other = sound.with_parameters({parameter: 1.01 * getattr(sound, parameter)})
    path, results = (
        build(tmp_path / name, fmi=["2.0"], platform=each)[0] for name, each in (("a", sound), ("b", other))
    )
    with zipfile.ZipFile(results) as archive:
        extra = {name: archive.read(name) for name in archive.namelist() if name.startswith("extra/")}
    with zipfile.ZipFile(path) as archive:
        own = {name: archive.read(name) for name in archive.namelist()}
    path.write_bytes(to_zip(own | extra))
    assert outcomes(list(check_units([path]))) == dict(zip(NAMES, (True, False, False), strict=True))


def test_a_description_that_is_wrong_is_named_with_its_reason(tmp_path: Path) -> None:
    """Expected: an output without its entry in ModelStructure, which the standard requires."""
    path = build(tmp_path, fmi=["3.0"], platform=UNEVEN)[0]
    wrong = changed(path, "modelDescription.xml", lambda text: re.sub(r" *<Output [^>]*/>\n", "", text, count=1))
    found = list(check_units([wrong]))
    assert outcomes(found)["validation"] is False
    assert "ModelStructure/Outputs" in found[0].found


def test_units_that_do_not_run_fail_with_the_reason(tmp_path: Path) -> None:
    """Expected: another token, no results, and no file at all."""
    path = build(tmp_path, fmi=["2.0"], platform=UNEVEN)[0]
    token = changed(path, "modelDescription.xml", lambda text: re.sub(r'guid="\{.', 'guid="{x', text))
    found = list(check_units([token]))
    assert [each.passed for each in found] == [True, False, False]
    assert all("wrong token" in each.found for each in found[1:])
    with zipfile.ZipFile(path) as archive:
        contents = {name: archive.read(name) for name in archive.namelist() if not name.startswith("extra/")}
    path.write_bytes(to_zip(contents))
    found = list(check_units([path]))
    assert all("has no reference results in extra/gough_stewart" in each.found for each in found[1:])
    found = list(check_units([tmp_path / "nowhere.fmu"]))
    assert [each.passed for each in found] == [False] * 3


def test_a_discarded_step_fails_with_the_units_message(tmp_path: Path) -> None:
    """Expected: without actuator forces the paper's platform falls into the plane of its base within a second."""
    path = build(tmp_path, fmi=["3.0"], platform=replace(UNEVEN, leg_armature=0.0))[0]
    none = " ".join(["0.0"] * 6)

    def without(text: str) -> str:
        return re.sub(r"^([\d.e-]+),[^,]*,", rf"\1,{none},", text, flags=re.M)

    found = list(check_units([changed(path, "gough_stewart_in.csv", without)]))
    assert outcomes(found)["Co-Simulation"] is False
    assert outcomes(found)["Model Exchange"] is False


def test_the_command_says_a_line_for_each_check_and_fails_with_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: exit code 0 with six lines; 3 where a check failed, with its name, and the files are there."""
    monkeypatch.chdir(tmp_path)
    done = invoke("build", "--check", "--out", "fmus")
    assert done.exit_code == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].endswith("; all 6 checks passed")
    for version in (2, 3):
        for name in NAMES:
            (line,) = [line for line in lines if f"_fmi{version}.fmu" in line and f" {name} " in line]
            assert " passed " in line
    failed = UnitCheck("a.fmu", "Model Exchange", "2.0e-03 (open_loop)", passed=False, deviation=2e-3)
    passed = UnitCheck("a.fmu", "Co-Simulation", "1.0e-09 (open_loop)", passed=True, deviation=1e-9)
    monkeypatch.setattr("gough_stewart.harness.plants.unit_check.check_units", lambda _paths: iter([passed, failed]))
    done = invoke("build", "--check", "--fmi", "3.0", "--out", "other", "--require", "checks.deviation <= 0.01")
    assert done.exit_code == 3
    assert "; 1 of 2 checks failed: Model Exchange of a.fmu" in done.stdout.splitlines()[0]
    assert re.search(r"Model Exchange +│ FAILED +│ +2.0e-03 \(open_loop\)", done.stdout)
    assert {p.name for p in Path("other").iterdir()} == {"gough_stewart_fmi3.fmu", "report.json"}
    assert invoke("build", "--fmi", "3.0", "--out", "other").exit_code == 0


def test_units_for_other_machines_are_not_checked_here(tmp_path: Path) -> None:
    """Expected: refused before anything is built, with the remedy."""
    done = invoke("build", "--check", "--target", "x86_64-windows", "--out", str(tmp_path / "out"))
    assert done.exit_code == 2
    assert "the targets are x86_64-windows; add `--target native`" in done.stderr
    assert not (tmp_path / "out").exists()
