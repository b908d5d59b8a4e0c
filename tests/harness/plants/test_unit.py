"""FMUs as units in FMPy: their files, values and messages."""

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
from gough_stewart.harness.plants.fmu import FmuPlant
from gough_stewart.model import interface
from tests.support.fmu_plants import Fmu
from tests.support.lagrangian import FloatArray
from tests.support.uneven import STATE, UNEVEN

Change = Callable[[str, bytes], bytes | None]


def of_description(pattern: bytes, new: bytes) -> Change:
    """A changed description."""
    return lambda name, content: (
        re.sub(pattern, new, content, flags=re.DOTALL) if name == "modelDescription.xml" else content
    )


CO_SIMULATION = rb"<CoSimulation\b[^>]*/>|<CoSimulation\b.*?</CoSimulation>"
# What is done to the files of an FMU, None for one that is left out; and why it is refused.
FILES: dict[str, tuple[Change, str]] = {
    "of another model": (
        of_description(rb"leg_upper_com", b"somewhat_else"),
        r"unit.fmu: is the FMU of another model.*leg_upper_com",
    ),
    "Model Exchange alone": (
        of_description(CO_SIMULATION, b""),
        r"unit.fmu: FMI 3.0, .*; expected Co-Simulation of FMI 2.0 or 3.0; make",
    ),
    "no binary": (
        lambda name, content: None if name.startswith("binaries") else content,
        r"unit.fmu: does not run on this machine",
    ),
}


@pytest.mark.parametrize("case", FILES)
def test_a_file_that_is_no_unit_of_the_plant_is_refused(case: str, fmus: dict[str, Fmu], tmp_path: Path) -> None:
    change, reason = FILES[case]
    with zipfile.ZipFile(fmus["3.0"].path) as old, zipfile.ZipFile(tmp_path / "unit.fmu", "w") as new:
        for name in old.namelist():
            if (content := change(name, old.read(name))) is not None:
                new.writestr(name, content)
    with pytest.raises(GoughStewartError, match=reason):
        gs.run("heave_step", {"loop.duration": 0.01}, plant="fmu3", fmu=tmp_path / "unit.fmu")


def test_a_damaged_file_is_refused_and_leaves_nothing(
    fmus: dict[str, Fmu], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: a flipped byte in the middle of the binary is seen by the archive's checksums."""
    content = bytearray(fmus["3.0"].path.read_bytes())
    with zipfile.ZipFile(fmus["3.0"].path) as archive:
        binary = max((i for i in archive.infolist() if i.filename.startswith("binaries/")), key=lambda i: i.file_size)
    content[binary.header_offset + binary.compress_size // 2] ^= 0xFF
    path = tmp_path / "damaged.fmu"
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
    variables = (*interface.PLATFORM_PARAMETERS, *interface.INPUTS, *interface.STATES)
    expected: dict[str, Any] = {v.name: getattr(UNEVEN, v.name) for v in interface.PLATFORM_PARAMETERS}
    expected |= dict.fromkeys(("external_force", "external_torque"), np.zeros(3)) | STATE._asdict()
    expected["actuator_force"] = UNEVEN.home_actuator_force
    with FmuPlant(fmus[version].path, UNEVEN, STATE, fixed_step_size=0.004) as plant:
        values = plant._unit.values_of([*(v.name for v in variables), "fixed_step_size"])

        def read() -> dict[str, FloatArray]:
            values.read()
            assert values.array[-1] == 0.004
            return dict(interface.unpack(variables, values.array[:-1]))

        def is_as_expected() -> bool:
            return all(np.allclose(value, expected[name], rtol=1e-12) for name, value in read().items())

        assert is_as_expected()
        new = {"gravity": [1, 2, -3], "leg_viscous_friction_factor": np.arange(6), "platform_mass": 9}
        plant.set_parameters(new)
        expected |= new
        assert is_as_expected()
        tunable = ", ".join(v.name for v in interface.VARIABLES if v.variability == "tunable")
        for name in ("leg_armature", "gravity[3]"):
            reason = re.escape(f"{name}: cannot be set during a run; expected one of {tunable}")
            with pytest.raises(GoughStewartError, match=f"^{reason}$"):
                plant.set_parameters({"platform_mass": 1.0, name: 1.0})
        assert is_as_expected()
