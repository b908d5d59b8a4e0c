"""FMUs that must not be unpacked are refused by name and size, before anything is."""

import re
import zipfile
from pathlib import Path

import pytest

from gough_stewart import GoughStewartError
from gough_stewart.harness.plants.unit import UnitFile
from tests.support.fmu_plants import Fmu


def archive(path: Path, **files: bytes) -> Path:
    """An archive with these files."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as made:
        for name, content in files.items():
            entry = zipfile.ZipInfo("harmless")
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.filename = entry.orig_filename = name  # as no library would write it
            made.writestr(entry, content)
    return path


def copy_of(fmu: Fmu, path: Path, old: bytes = b"", new: bytes = b"", **more: bytes) -> Path:
    """A copy with another description, and more files."""
    with zipfile.ZipFile(fmu.path) as unit:
        files = {name: unit.read(name) for name in unit.namelist()}
    files["modelDescription.xml"] = (
        files["modelDescription.xml"].replace(old, new) if old else files["modelDescription.xml"] + new
    )
    return archive(path, **files, **more)


@pytest.mark.parametrize(
    "name",
    [
        *("/etc/unit", "//host/unit", "../outside", "resources/../../outside", ".."),
        *("resources\\..\\..\\outside", "\\outside", "C:/outside", "c:outside", "resources\\unit", "a\0b"),
    ],
)
def test_an_entry_that_leads_out_is_refused_by_name(name: str, tmp_path: Path) -> None:
    path = archive(tmp_path / "unit.fmu", **{"modelDescription.xml": b"<fmiModelDescription/>", name: b"x"})
    reason = re.escape(f"the entry {name!r} points outside the archive; expected relative paths with slashes")
    with pytest.raises(GoughStewartError, match=rf"unit\.fmu: {reason}.*nothing was unpacked"):
        UnitFile(path)
    assert [file.name for file in tmp_path.iterdir()] == ["unit.fmu"]


def test_what_is_too_large_is_refused_by_name_and_size(
    fmus: dict[str, Fmu], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: sizes and numbers from the archive's directory; beside each limit, one at the limit is no bomb."""
    unit = tmp_path / "unit.fmu"

    def reason() -> str:
        with pytest.raises(GoughStewartError) as caught:
            UnitFile(unit)
        return str(caught.value)

    archive(unit, **{"modelDescription.xml": b"<fmiModelDescription/>", "resources/bomb": bytes(300_000_000)})
    assert unit.stat().st_size < 1_000_000
    assert "300 MB of it the entry 'resources/bomb'; expected at most 256 MB; nothing was unpacked" in reason()
    sizes = {"a": 1_000_000, "b": 3_000_000, "c": 2_000_000}
    archive(unit, **{name: bytes(size) for name, size in sizes.items()})
    monkeypatch.setattr("gough_stewart.harness.plants.unit.MOST_BYTES", 6_000_000)
    assert "modelDescription.xml" in reason()  # which it does not have, and no reason of size
    monkeypatch.setattr("gough_stewart.harness.plants.unit.MOST_BYTES", 5_999_999)
    assert "would unpack to 6 MB, 3 MB of it the entry 'b'; expected at most 6 MB" in reason()
    monkeypatch.undo()
    files = {f"resources/{k}": b"" for k in range(10_000)}
    archive(unit, **files)
    assert "modelDescription.xml" in reason()
    archive(unit, **files, more=b"")
    assert "contains 10,001 files; expected an FMU of at most 10,000" in reason()
    copy_of(fmus["3.0"], unit, new=b" " * 20_000_000)
    assert re.search(r"its modelDescription\.xml has 20\.\d MB; expected at most 20 MB; nothing was parsed$", reason())
    (tmp_path / "unit.fmu").write_text("hello")
    assert reason().endswith("unit.fmu: is not an FMU (File is not a zip file)")
