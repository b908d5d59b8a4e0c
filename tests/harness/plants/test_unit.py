"""FMUs as units in FMPy: their files, descriptions, values and messages."""

import re
import tempfile
import zipfile
from collections.abc import Callable
from ctypes import c_double
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from scipy.integrate import solve_ivp

from gough_stewart.harness.errors import PlantError
from gough_stewart.harness.plants.fmu import FmuPlant
from gough_stewart.harness.plants.unit import Unit, UnitFile, Values, references, values_of
from gough_stewart.model import interface
from gough_stewart.model.dynamics import forward_dynamics
from gough_stewart.model.errors import InterfaceError, StepError
from gough_stewart.model.formulations import newton_euler
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation, orientation_rate_from_angular_velocity
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray
from tests.support.fmu_plants import Fmu
from tests.support.uneven import INPUTS, STATE, UNEVEN


def test_an_error_that_the_unit_logs_is_one_also_where_the_call_went_well(fmus: dict[str, Fmu]) -> None:
    """Expected: an error of the unit, put in its mouth, raised by whatever is called next, and only once."""
    with FmuPlant(fmus["3.0"].path, UNEVEN) as plant:
        for call in (
            plant.results,
            lambda: plant.set_inputs(np.zeros(12)),
            lambda: plant.set_parameters({"platform_mass": 12.0}),
            lambda: plant.do_step(0.0, 0.001),
        ):
            plant._unit._hear(None, 3, b"logStatusError", b"the oil is cold")
            with pytest.raises(PlantError, match=r"\.fmu: the oil is cold$"):
                call()
        plant.results()


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_an_instance_of_model_exchange_comes_to_continuous_time(version: str, fmus: dict[str, Fmu]) -> None:
    """Expected: its derivatives are Newton and Euler's accelerations at the start; states may be set only there."""
    with UnitFile(fmus[version].path) as file, Unit(file, "ModelExchange") as unit:
        parameters = {v.name: getattr(UNEVEN, v.name) for v in interface.PLATFORM_PARAMETERS}
        unit.write_by_name({**parameters, **STATE._asdict(), **INPUTS._asdict()})
        unit.initialise()
        rates = (c_double * 12)()
        (unit.fmu.getDerivatives if unit.is_fmi2 else unit.fmu.getContinuousStateDerivatives)(rates, 12)
        unit.fmu.setContinuousStates((c_double * 12)(*STATE.to_vector()), 12)
    force, wrench, torque = INPUTS
    R = matrix_from_orientation(STATE.orientation)
    expected = newton_euler.solve(
        UNEVEN, STATE.position, R, STATE.velocity, STATE.angular_velocity, force, wrench, torque
    )
    assert list(rates)[6:] == pytest.approx([*expected.linear, *expected.angular], rel=1e-9)


def test_a_missing_fmu_says_how_to_make_one(paper: Platform) -> None:
    with pytest.raises(PlantError, match=r"nowhere.fmu: no such file.*gough-stewart build"):
        FmuPlant("nowhere.fmu", paper)


def test_a_file_that_is_no_fmu_is_refused(paper: Platform, tmp_path: Path) -> None:
    (tmp_path / "text.fmu").write_text("hello")
    with pytest.raises(PlantError, match=r"text.fmu: is not an FMU"):
        FmuPlant(tmp_path / "text.fmu", paper)


def test_a_damaged_fmu_is_refused_and_leaves_nothing(
    fmus: dict[str, Fmu], paper: Platform, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
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
    with pytest.raises(PlantError, match=r"damaged.fmu: cannot be unpacked .*; make one with `gough-stewart build`"):
        FmuPlant(path, paper)
    assert list((tmp_path / "temporary").iterdir()) == []


def changed_copy(fmu: Fmu, target: Path, change: Callable[[str, bytes], bytes | None]) -> Path:
    """The archive with members changed, or left out where the change is None."""
    with zipfile.ZipFile(fmu.path) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            content = change(name, old.read(name))
            if content is not None:
                new.writestr(name, content)
    return target


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_the_fmu_of_another_model_is_refused(
    version: str, fmus: dict[str, Fmu], paper: Platform, tmp_path: Path
) -> None:
    """Expected: a description in which a variable of the interface has another name."""

    def rename(name: str, content: bytes) -> bytes:
        return content.replace(b"leg_upper_com", b"somewhat_else") if name == "modelDescription.xml" else content

    path = changed_copy(fmus[version], tmp_path / "other.fmu", rename)
    with pytest.raises(PlantError, match=r"other.fmu: is the FMU of another model.*leg_upper_com"):
        FmuPlant(path, paper)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_an_fmu_without_co_simulation_is_refused(
    version: str, fmus: dict[str, Fmu], paper: Platform, tmp_path: Path
) -> None:
    """Expected: a description with Model Exchange alone is named with its version and model."""

    def drop(name: str, content: bytes) -> bytes:
        if name != "modelDescription.xml":
            return content
        return re.sub(rb"<CoSimulation\b[^>]*/>|<CoSimulation\b.*?</CoSimulation>", b"", content, flags=re.DOTALL)

    path = changed_copy(fmus[version], tmp_path / "half.fmu", drop)
    with pytest.raises(
        PlantError, match=rf"half.fmu: FMI {version}, .*; expected Co-Simulation of FMI 2.0 or 3.0; make"
    ):
        FmuPlant(path, paper)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_parameter_is_set_as_a_whole(version: str, fmus: dict[str, Fmu]) -> None:
    """Expected: an element of it is refused, and changes nothing."""
    with FmuPlant(fmus[version].path, UNEVEN, STATE) as plant:
        before = plant.results()
        with pytest.raises(
            InterfaceError, match=r"gravity\[3\]: cannot be set during a run; expected one of .*gravity"
        ):
            plant.set_parameters({"gravity[3]": -1.6})
        assert (plant.results() == before).all()


def test_an_fmu_without_a_binary_for_this_machine_is_refused(
    fmus: dict[str, Fmu], paper: Platform, tmp_path: Path
) -> None:
    path = changed_copy(fmus["3.0"], tmp_path / "bare.fmu", lambda n, c: None if n.startswith("binaries") else c)
    with pytest.raises(PlantError, match=r"bare.fmu: does not run on this machine"):
        FmuPlant(path, paper)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_unit_takes_the_tolerance_and_the_step_of_its_integration(version: str, fmus: dict[str, Fmu]) -> None:
    """Expected: classical RK4 by hand with the fixed step; errors of the order of the tolerance with none."""

    def rate(x: FloatArray) -> FloatArray:
        state = State.from_vector(x)
        a = forward_dynamics(UNEVEN, state, INPUTS)
        turning = orientation_rate_from_angular_velocity(state.orientation, state.angular_velocity)
        return np.concatenate([state.velocity, turning, *a])

    h, x = 0.02, STATE.to_vector()
    for _ in range(2):
        k1 = rate(x)
        k2 = rate(x + h / 2 * k1)
        k3 = rate(x + h / 2 * k2)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + h * k3))
    exact = solve_ivp(lambda _t, x: rate(x), (0, 0.5), STATE.to_vector(), method="DOP853", rtol=1e-12, atol=1e-12).y
    ends = {}
    for tolerance, step, span in ((1e-8, h, 2 * h), (1e-10, 0.0, 0.5), (1e-4, 0.0, 0.5)):
        with FmuPlant(fmus[version].path, UNEVEN, STATE, tolerance, step) as plant:
            plant.set_inputs(INPUTS.to_vector())
            plant.do_step(0.0, span)
            ends[tolerance] = plant.signals()[:12].copy()
    assert ends[1e-8] == pytest.approx(x, abs=1e-11)
    assert np.abs(ends[1e-10] - exact[:, -1]).max() < 1e-8
    assert 1e-9 < np.abs(ends[1e-4] - exact[:, -1]).max() < 1e-2


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
        with pytest.raises(PlantError, match=rf"^{re.escape(str(plant.path))}: .*time"):
            plant.do_step(0.5, 0.001)
        plant.set_inputs(np.zeros(12))
        plant.do_step(0.003, 0.001)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_parameters_of_a_unit_are_all_and_each_in_its_place(version: str, fmus: dict[str, Fmu]) -> None:
    """Expected: each number of the uneven platform as the unit gives it back; start values and inputs too."""
    with FmuPlant(fmus[version].path, UNEVEN, STATE, fixed_step_size=0.004) as plant:
        assert plant.fmi_version == version
        assert plant.path == fmus[version].path
        names = [v.name for v in (*interface.PLATFORM_PARAMETERS, *interface.INPUTS, *interface.STATES)]
        values = plant._unit.values_of([*names, "fixed_step_size"])
        values.read()
        expected: list[float] = [x for v in interface.PLATFORM_PARAMETERS for x in np.ravel(getattr(UNEVEN, v.name))]
        expected += [*UNEVEN.home_actuator_force, *[0.0] * 6, *STATE.to_vector(), 0.004]
        assert values.array == pytest.approx(expected, rel=1e-12)
        new: dict[str, Any] = {"gravity": [1, 2, -3], "leg_viscous_friction_factor": np.arange(6), "platform_mass": 9}
        plant.set_parameters(new)
        values.read()
        changed = interface.unpack(
            (*interface.PLATFORM_PARAMETERS, *interface.INPUTS, *interface.STATES), values.array[:-1]
        )
        for name in names:
            own = new.get(name)
            before = interface.unpack(
                (*interface.PLATFORM_PARAMETERS, *interface.INPUTS, *interface.STATES), np.array(expected[:-1])
            )[name]
            assert changed[name] == pytest.approx(np.asarray(before if own is None else own), rel=1e-12), name
        with pytest.raises(InterfaceError) as caught:
            plant.set_parameters({"leg_armature": 1.0})
        tunable = [v.name for v in interface.VARIABLES if v.variability == "tunable"]
        assert str(caught.value) == f"leg_armature: cannot be set during a run; expected one of {', '.join(tunable)}"


def test_value_references_are_those_of_the_description(fmus: dict[str, Fmu]) -> None:
    """Expected: those that the XML of each unit states: each element's in FMI 2.0, the array's in 3.0."""
    for version, is_fmi2 in (("2.0", True), ("3.0", False)):
        stated = {v.name: v.valueReference for v in fmus[version].description.modelVariables}
        for variable in interface.VARIABLES:
            names = variable.scalar_names if is_fmi2 else (variable.name,)
            assert references(variable.name, is_fmi2) == [stated[name] for name in names]
        assert fmus[version].is_fmi2 == is_fmi2
        assert fmus[version].token == fmus[version].description.guid or not is_fmi2
    values = values_of(["leg_length", "kinetic_energy"], True)
    assert values.array.shape == (7,)
    assert len(values.arguments) == 3
    three = values_of(["leg_length", "kinetic_energy"], False)
    assert [three.arguments[k].value for k in (1, 3)] == [2, 7]


def test_a_unit_knows_its_name_and_where_time_begins(fmus: dict[str, Fmu]) -> None:
    """Expected: steps from the start time on, refused before it and beyond the stop time; the name in its words."""
    for version in ("2.0", "3.0"):
        with UnitFile(fmus[version].path) as file, Unit(file, name="left") as unit:
            unit.initialise(1e-8, 7.3, 7.4)
            unit.do_step(7.3, 0.05)
            for time, step in ((0.0, 0.05), (7.35, 0.2)):
                unit.messages.clear()
                with pytest.raises(FMICallException):
                    unit.do_step(time, step)
                assert unit.messages
                assert unit.messages[0].instance == ("left" if version == "2.0" else None)
                assert unit.messages[0].text in unit.take_messages()
            unit.do_step(7.35, 0.05)


def test_a_unit_without_a_name_is_the_plant(fmus: dict[str, Fmu]) -> None:
    """Expected: the word of an unknown value reference, under the name that the documentation has."""
    with UnitFile(fmus["2.0"].path) as file, Unit(file) as unit:
        with pytest.raises(FMICallException):
            unit.read(Values([9999], 1, is_fmi2=True))
        assert {message.instance for message in unit.messages} == {"plant"}


def test_a_file_is_unpacked_where_it_is_told_and_stays_open(fmus: dict[str, Fmu], tmp_path: Path) -> None:
    """Expected: a folder of the caller is kept, one of its own goes; several plants use one file."""
    with UnitFile(fmus["3.0"].path, tmp_path) as kept:
        assert kept.folder == tmp_path
    assert (tmp_path / "modelDescription.xml").is_file()
    with UnitFile(str(fmus["3.0"].path)) as own:
        assert own.path == fmus["3.0"].path
        assert own.version == "3.0"
        for _ in range(2):
            with FmuPlant(own, UNEVEN, STATE) as plant:
                plant.do_step(0.0, 0.001)
        assert (own.folder / "modelDescription.xml").is_file()
        folder = own.folder
    assert not folder.exists()
    own.close()
