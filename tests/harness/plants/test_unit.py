"""FMUs as units in FMPy: files that are refused before anything is unpacked, or after; values and failures."""

import re
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart import GoughStewartError, StepError
from gough_stewart.harness.plants import unit
from gough_stewart.harness.plants.fmu import FmuPlant
from gough_stewart.harness.plants.unit import UnitFile
from gough_stewart.model import interface
from tests.support.fmu_plants import Fmu
from tests.support.uneven import STATE, UNEVEN

DESCRIPTION = {"modelDescription.xml": b"<fmiModelDescription/>"}
CO_SIMULATION = rb"<CoSimulation\b[^>]*/>|<CoSimulation\b.*?</CoSimulation>"


def archive(path: Path, files: dict[str, bytes]) -> Path:
    """An archive with these files, also with names that no library would write."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as made:
        for name, content in files.items():
            entry = zipfile.ZipInfo("harmless")
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.filename = entry.orig_filename = name
            made.writestr(entry, content)
    return path


def files_of(fmu: Fmu) -> dict[str, bytes]:
    with zipfile.ZipFile(fmu.path) as opened:
        return {name: opened.read(name) for name in opened.namelist()}


def described(pattern: bytes, new: bytes) -> Callable[[dict[str, bytes]], dict[str, bytes]]:
    """A changed description."""
    name = "modelDescription.xml"
    return lambda files: files | {name: re.sub(pattern, new, files[name], flags=re.DOTALL)}


# What is done to the files of an FMU, and why it is refused.
FILES: dict[str, tuple[Callable[[dict[str, bytes]], dict[str, bytes]], str]] = {
    "of another model": (described(rb"leg_upper_com", b"somewhat_else"), "is the FMU of another model.*leg_upper_com"),
    "Model Exchange alone": (
        described(CO_SIMULATION, b""),
        r"FMI 3.0, .*; expected Co-Simulation of FMI 2.0 or 3.0; make",
    ),
    "no binary": (
        lambda files: {name: content for name, content in files.items() if not name.startswith("binaries")},
        r"does not run on this machine",
    ),
    "a description that is too long": (
        described(rb"$", b" " * 20_000_000),
        r"its modelDescription\.xml has \d\d\.\d MB; expected at most 20 MB; nothing was parsed$",
    ),
}


@pytest.mark.parametrize("case", FILES)
def test_a_file_that_is_no_unit_of_the_plant_is_refused(case: str, fmus: dict[str, Fmu], tmp_path: Path) -> None:
    change, reason = FILES[case]
    path = archive(tmp_path / "unit.fmu", change(files_of(fmus["3.0"])))
    with pytest.raises(GoughStewartError, match=rf"unit\.fmu: {reason}"):
        FmuPlant(path, UNEVEN)


@pytest.mark.parametrize(
    "name",
    [
        *("/etc/unit", "//host/unit", "../outside", "resources/../../outside", ".."),
        *("resources\\..\\..\\outside", "\\outside", "C:/outside", "c:outside", "resources\\unit", "a\0b"),
    ],
)
def test_an_entry_that_leads_out_is_refused_by_name(name: str, tmp_path: Path) -> None:
    path = archive(tmp_path / "unit.fmu", {**DESCRIPTION, name: b"x"})
    reason = re.escape(f"the entry {name!r} points outside the archive; expected relative paths with slashes")
    with pytest.raises(GoughStewartError, match=rf"unit\.fmu: {reason}.*nothing was unpacked"):
        UnitFile(path)
    assert [file.name for file in tmp_path.iterdir()] == ["unit.fmu"]


def test_what_is_too_large_is_refused_by_name_and_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: sizes and numbers from the archive's directory; beside each limit, one at the limit is no bomb."""
    path, sizes = tmp_path / "unit.fmu", {"a": 1_000_000, "b": 3_000_000, "c": 2_000_000}
    empty = {f"resources/{k}": b"" for k in range(10_000)}
    for files, most, reason in (
        (
            {**DESCRIPTION, "bomb": bytes(300_000_000)},
            None,
            r"300 MB of it the entry 'bomb'; expected at most 256 MB; not",
        ),
        ({name: bytes(size) for name, size in sizes.items()}, 6_000_000, "modelDescription.xml"),  # no reason of size
        (
            {name: bytes(size) for name, size in sizes.items()},
            5_999_999,
            r"would unpack to 6 MB, 3 MB of it the entry 'b'",
        ),
        (empty, None, "modelDescription.xml"),
        ({**empty, "more": b""}, None, r"contains 10,001 files; expected an FMU of at most 10,000"),
    ):
        with monkeypatch.context() as limits:
            if most is not None:
                limits.setattr(unit, "MOST_BYTES", most)
            with pytest.raises(GoughStewartError, match=reason):
                UnitFile(archive(path, files))
    path.write_text("hello")
    with pytest.raises(GoughStewartError, match=r"unit.fmu: is not an FMU \(File is not a zip file\)$"):
        UnitFile(path)


def test_a_damaged_file_is_refused_and_leaves_nothing(
    fmus: dict[str, Fmu], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: a flipped byte in the middle of the binary is seen by the archive's checksums."""
    content, path = bytearray(fmus["3.0"].path.read_bytes()), tmp_path / "damaged.fmu"
    with zipfile.ZipFile(fmus["3.0"].path) as opened:
        binary = max((i for i in opened.infolist() if i.filename.startswith("binaries/")), key=lambda i: i.file_size)
    content[binary.header_offset + binary.compress_size // 2] ^= 0xFF
    path.write_bytes(content)
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    for refused, reason in (
        (path, r"damaged.fmu: cannot be unpacked .*; make one with `gough-stewart build`"),
        ("nowhere.fmu", r"nowhere.fmu: no such file.*gough-stewart build"),
    ):
        with pytest.raises(GoughStewartError, match=reason):
            FmuPlant(refused, UNEVEN)
    assert list((tmp_path / "temporary").iterdir()) == []


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_failed_step_of_a_unit_has_its_version_step_and_time(version: str, fmus: dict[str, Fmu]) -> None:
    """Expected: the quantity with the version, the step and the time that were asked for, and the unit's reason."""
    with FmuPlant(fmus[version].path, UNEVEN, STATE) as plant:
        plant.do_step(0.0, 0.003)
        plant.set_inputs(np.append(np.tile([1e5, -1e5], 3), np.zeros(6)))
        with pytest.raises(StepError) as caught:
            plant.do_step(0.003, 0.7)
        error = caught.value
        assert (error.quantity, error.value, error.time) == (f"FMU, FMI {version}: step", 0.7, 0.003)
        assert len(str(error).partition(" s: ")[2]) > 20
        with pytest.raises(GoughStewartError, match=rf"^{re.escape(str(plant.path))}: .*time"):
            plant.do_step(0.5, 0.001)
        plant.set_inputs(np.zeros(12))
        plant.do_step(0.003, 0.001)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_parameters_of_a_unit_are_all_and_each_in_its_place(version: str, fmus: dict[str, Fmu]) -> None:
    """Expected: each number of the uneven platform as the unit gives it back; start values and inputs too."""
    parameters, tunable = interface.PLATFORM_PARAMETERS, [v.name for v in gs.VARIABLES if v.variability == "tunable"]
    variables = (*parameters, *interface.INPUTS, *interface.STATES)
    expected: dict[str, Any] = {v.name: getattr(UNEVEN, v.name) for v in parameters} | STATE._asdict()
    expected |= dict.fromkeys(("external_force", "external_torque"), np.zeros(3))
    expected["actuator_force"] = UNEVEN.home_actuator_force
    with FmuPlant(fmus[version].path, UNEVEN, STATE, fixed_step_size=0.004) as plant:
        values = plant._unit.values_of([*(v.name for v in variables), "fixed_step_size"])

        def is_as_expected() -> bool:
            values.read()
            found = interface.unpack(variables, values.array[:-1])
            assert values.array[-1] == 0.004
            return all(np.allclose(value, expected[name], rtol=1e-12) for name, value in found.items())

        assert is_as_expected()
        new = {"gravity": [1, 2, -3], "leg_viscous_friction_factor": np.arange(6), "platform_mass": 9}
        plant.set_parameters(new)
        expected |= new
        assert is_as_expected()
        for name in ("leg_armature", "gravity[3]"):
            reason = re.escape(f"{name}: cannot be set during a run; expected one of {', '.join(tunable)}")
            with pytest.raises(GoughStewartError, match=f"^{reason}$"):
                plant.set_parameters({"platform_mass": 1.0, name: 1.0})
        assert is_as_expected()
