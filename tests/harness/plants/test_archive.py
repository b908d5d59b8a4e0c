"""FMUs that must not be unpacked are refused by name and size, before anything is."""

import re
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from gough_stewart.harness.errors import PlantError
from gough_stewart.harness.plants.fmu import FmuPlant
from gough_stewart.harness.plants.unit import UnitFile, check_archive
from gough_stewart.harness.plants.unit_check import check_units
from tests.support.fmu_plants import Fmu
from tests.support.uneven import UNEVEN


def archive_with(path: Path, name: str) -> Path:
    """An archive whose last entry has this name, as no library would write it."""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", b"<fmiModelDescription/>")
        entry = zipfile.ZipInfo("harmless")
        entry.filename = entry.orig_filename = name
        archive.writestr(entry, b"x")
    return path


@pytest.mark.parametrize(
    "name",
    [
        *("/etc/unit", "//host/unit", "../outside", "resources/../../outside", ".."),
        *("resources\\..\\..\\outside", "\\outside", "C:/outside", "c:outside", "resources\\unit", "a\0b"),
    ],
)
def test_an_entry_that_leads_out_is_refused_by_name(name: str, tmp_path: Path) -> None:
    path = archive_with(tmp_path / "unit.fmu", name)
    with pytest.raises(
        PlantError, match=r"unit\.fmu: the entry .* points outside the archive.*nothing was unpacked"
    ) as caught:
        FmuPlant(path, UNEVEN)
    assert repr(name) in str(caught.value)
    assert [file.name for file in tmp_path.iterdir()] == ["unit.fmu"]


@pytest.mark.parametrize("name", ["resources/a..b", "resources/..hidden", "documentation/d:e.html"])
def test_other_names_are_no_reason(name: str, fmus: dict[str, Fmu], tmp_path: Path) -> None:
    unit = Path(shutil.copy(fmus["3.0"].path, tmp_path / "unit.fmu"))
    with zipfile.ZipFile(unit, "a") as archive:
        archive.writestr(name, b"x")
    with UnitFile(unit) as file:
        assert (file.folder / name).read_bytes() == b"x"


def with_description(fmu: Path, target: Path, change: Callable[[bytes], bytes]) -> Path:
    """A copy of an FMU with a changed description."""
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as new:
        for name in old.namelist():
            content = old.read(name)
            new.writestr(name, change(content) if name == "modelDescription.xml" else content)
    return target


@pytest.mark.parametrize("identifier", ["../../../real", "/tmp/real", "a b", "C:real", "", "1st", "ré"])
def test_the_name_of_the_library_is_an_identifier(identifier: str, fmus: dict[str, Fmu], tmp_path: Path) -> None:
    """Expected: by the standard, a C identifier; a path would name a library outside of the archive."""
    named, other = b'modelIdentifier="gough_stewart"', f'modelIdentifier="{identifier}"'.encode()
    for version, fmu in fmus.items():
        path = with_description(fmu.path, tmp_path / f"{version}.fmu", lambda text: text.replace(named, other))
        with pytest.raises(PlantError, match=f"modelIdentifier '{re.escape(identifier)}'; expected a C identifier"):
            UnitFile(path)


def test_a_description_that_is_too_long_is_not_parsed(fmus: dict[str, Fmu], tmp_path: Path) -> None:
    """Expected: its size from the archive's directory; FMPy would take seconds and hundreds of MB for it."""
    unit = with_description(fmus["3.0"].path, tmp_path / "unit.fmu", lambda text: text + b" " * 20_000_000)
    size = r"its modelDescription\.xml has 20\.\d MB; expected at most 20 MB; nothing was parsed"
    with pytest.raises(PlantError, match=size):
        UnitFile(unit)
    validation = next(iter(check_units([unit])))
    assert re.search(size, validation.found)
    assert not validation.passed


def test_a_bomb_is_refused_by_name_and_size(tmp_path: Path) -> None:
    path = tmp_path / "unit.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", b"<fmiModelDescription/>")
        with archive.open("resources/bomb", "w") as bomb:
            for _ in range(300):
                bomb.write(bytes(1_000_000))
    assert path.stat().st_size < 1_000_000
    with pytest.raises(PlantError, match=r"300 MB of it the entry 'resources/bomb'; expected at most 256 MB"):
        FmuPlant(path, UNEVEN)


def test_an_archive_of_too_many_files_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "unit.fmu", "w") as archive:
        for k in range(10_000):
            archive.writestr(f"resources/{k}", b"")
    check_archive(tmp_path / "unit.fmu")
    with zipfile.ZipFile(tmp_path / "unit.fmu", "a") as archive:
        archive.writestr("resources/one_more", b"")
    with pytest.raises(PlantError, match="contains 10,001 files; expected an FMU of at most 10,000"):
        FmuPlant(tmp_path / "unit.fmu", UNEVEN)


def test_an_archive_at_the_limit_of_size_is_no_bomb(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the sum of all files from both sides of the limit; the largest one by name, wherever it is."""
    path = tmp_path / "unit.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, size in (("a", 1_000_000), ("b", 3_000_000), ("c", 2_000_000)):
            archive.writestr(name, bytes(size))
    monkeypatch.setattr("gough_stewart.harness.plants.unit.MOST_BYTES", 6_000_000)
    check_archive(path)
    monkeypatch.setattr("gough_stewart.harness.plants.unit.MOST_BYTES", 5_999_999)
    with pytest.raises(PlantError) as caught:
        check_archive(path)
    assert str(caught.value) == (
        f"{path}: would unpack to 6 MB, 3 MB of it the entry 'b'; expected at most 6 MB; nothing was unpacked"
    )


def test_what_is_no_archive_is_told_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "text.fmu").write_text("hello")
    with pytest.raises(PlantError, match=r"text\.fmu: is not an FMU \(File is not a zip file\)$"):
        check_archive(tmp_path / "text.fmu")
    with pytest.raises(PlantError, match=r"none\.fmu: is not an FMU \(.*No such file"):
        check_archive(tmp_path / "none.fmu")
