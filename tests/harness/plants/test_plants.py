"""Plants by their contract: model, FMI 2.0 and FMI 3.0 give the same, and clean up after themselves."""

import re
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Callable
from ctypes import c_double
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from gough_stewart.harness.errors import PlantError
from gough_stewart.harness.plants.fmu import FmuPlant
from gough_stewart.harness.plants.isolated import IsolatedFmu
from gough_stewart.harness.plants.model import ModelPlant
from gough_stewart.harness.plants.open import open_plant
from gough_stewart.harness.plants.plant import Plant
from gough_stewart.harness.plants.unit import Message, Unit, UnitFile, Values, references, values_of
from gough_stewart.model import interface
from gough_stewart.model.dynamics import forward_dynamics
from gough_stewart.model.errors import GoughStewartError, InterfaceError, PlatformError, StepError
from gough_stewart.model.formulations import newton_euler
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.rotations import matrix_from_orientation, orientation_rate_from_angular_velocity
from gough_stewart.model.state import Inputs, State
from gough_stewart.model.vectors import FloatArray
from tests.support.fmu_plants import Fmu
from tests.support.random_platforms import random_inputs, random_platform, random_state
from tests.support.uneven import INPUTS, STATE, UNEVEN

Open = Callable[[Platform, State | None], Plant]
KINDS = ("model", "2.0", "3.0")


@pytest.fixture(params=KINDS)
def open_one(request: pytest.FixtureRequest, fmus: dict[str, Fmu]) -> Open:
    """Each kind of plant, one after the other."""
    return opener(request.param, fmus)


def opener(kind: str, fmus: dict[str, Fmu]) -> Open:
    if kind == "model":
        return ModelPlant

    def open_fmu(platform: Platform, start: State | None = None) -> Plant:
        return FmuPlant(fmus[kind].path, platform, start)

    return open_fmu


def stepped(plant: Plant, inputs: FloatArray, steps: int = 20, step: float = 0.005) -> FloatArray:
    """Results after every step."""
    rows = []
    with plant:
        for k in range(steps):
            plant.set_inputs(inputs * np.cos(0.1 * k))
            rows.append(plant.results())
            plant.do_step(k * step, step)
        rows.append(plant.results())
    return np.array(rows)


@settings(max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 10_000))
def test_three_plants_give_the_same_on_any_platform(seed: int, fmus: dict[str, Fmu]) -> None:
    """Expected: rule 7, poses within 1e-7 and all results in proportion, on random platforms with all inputs."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    start = random_state(platform, rng)._replace(velocity=np.zeros(3), angular_velocity=np.zeros(3))
    inputs = 0.3 * random_inputs(platform, rng).to_vector()
    try:
        model = stepped(ModelPlant(platform, start), inputs)
    except StepError:
        return  # thrown into a singular pose; not what this test is about
    scale = np.abs(model).max(axis=0) + 1
    for kind in ("2.0", "3.0"):
        unit = stepped(opener(kind, fmus)(platform, start), inputs)
        assert np.abs(unit - model)[:, :6].max() < 1e-7
        assert (np.abs(unit - model) / scale).max() < 1e-5


def test_inputs_and_results_mean_what_the_interface_says(open_one: Open) -> None:
    """Expected: Newton and Euler's accelerations and joint forces under the forces, then the wrench, of the vector."""
    force, wrench, torque = INPUTS
    with open_one(UNEVEN, STATE) as plant:
        plant.set_inputs(np.concatenate([force, wrench, torque]))
        found = interface.unpack(interface.RESULTS, plant.results())
    R = matrix_from_orientation(STATE.orientation)
    expected = newton_euler.solve(
        UNEVEN, STATE.position, R, STATE.velocity, STATE.angular_velocity, force, wrench, torque
    )
    assert found["acceleration"] == pytest.approx(expected.linear, rel=1e-9)
    assert found["angular_acceleration"] == pytest.approx(expected.angular, rel=1e-9)
    assert found["joint_force"] == pytest.approx(expected.joint_force, rel=1e-8, abs=1e-8)
    assert np.concatenate([found[name] for name in State._fields]) == pytest.approx(STATE.to_vector(), abs=0)
    legs = STATE.position + UNEVEN.platform_points @ R.T - UNEVEN.base_points
    assert found["leg_length"] == pytest.approx(np.linalg.norm(legs, axis=1), rel=1e-12)


def test_steps_follow_each_other_from_any_state_under_any_inputs(open_one: Open) -> None:
    """Expected: SciPy's integration of the NumPy dynamics, over steps of unequal length with inputs that change."""
    steps, factors = (0.01, 0.004, 0.013), (1.0, -0.4, 0.7)

    def rate(_time: float, x: FloatArray, factor: float) -> FloatArray:
        state = State.from_vector(x)
        a = forward_dynamics(UNEVEN, state, Inputs(*(factor * part for part in INPUTS)))
        turning = orientation_rate_from_angular_velocity(state.orientation, state.angular_velocity)
        return np.concatenate([state.velocity, turning, *a])

    x, time = STATE.to_vector(), 0.0
    with open_one(UNEVEN, STATE) as plant:
        for step, factor in zip(steps, factors, strict=True):
            plant.set_inputs(factor * INPUTS.to_vector())
            plant.do_step(time, step)
            time += step
            x = solve_ivp(rate, (0, step), x, args=(factor,), rtol=1e-10, atol=1e-12).y[:, -1]
            assert plant.results()[:12] == pytest.approx(x, abs=1e-7)


def test_a_plant_begins_at_home_at_rest(open_one: Open) -> None:
    """Expected: rule 1, on a platform that the FMU was not built for; the forces that hold it there, and no wrench."""
    with open_one(UNEVEN, None) as plant:
        results = interface.unpack(interface.RESULTS, plant.results())
    assert np.abs(results["acceleration"]).max() < 1e-9
    assert np.abs(results["angular_acceleration"]).max() < 1e-9
    assert (results["position"] == UNEVEN.home_position).all()
    assert (results["orientation"] == UNEVEN.home_orientation).all()
    assert (results["velocity"] == 0).all()
    assert (results["angular_velocity"] == 0).all()


def test_results_are_copies_and_change_nothing(open_one: Open, paper: Platform) -> None:
    """Expected: rule 4."""
    with open_one(paper, None) as plant:
        one = plant.results()
        kept = one.copy()
        plant.set_inputs(np.arange(12.0))
        plant.do_step(0.0, 0.01)
        two = plant.results()
        assert (one == kept).all()
        assert (plant.results() == two).all()


def test_a_failed_step_leaves_the_plant_as_it_was(open_one: Open, paper: Platform) -> None:
    """Expected: rule 6; 1e5 N turn the paper's platform through its singular pose within a second."""
    with open_one(paper, None) as plant:
        plant.set_inputs(np.append(np.tile([1e4, -1e4], 3), np.zeros(6)))
        before = plant.results()
        with pytest.raises(StepError) as caught:
            plant.do_step(0.0, 1.0)
        assert (plant.results() == before).all()
    assert "singular" in str(caught.value) or "90°" in str(caught.value) or "collapsed" in str(caught.value)


def test_parameters_change_together_or_not_at_all(open_one: Open, paper: Platform) -> None:
    """Expected: rule 3; without gravity and forces nothing accelerates at rest."""
    with open_one(paper, None) as plant:
        plant.set_inputs(np.zeros(12))
        at_rest = interface.unpack(interface.RESULTS, plant.results())["acceleration"]
        plant.do_step(0.0, 0.01)
        plant.set_parameters({"gravity": np.zeros(3), "platform_mass": 20.0})
        floating = interface.unpack(interface.RESULTS, plant.results())["acceleration"]
        with pytest.raises(InterfaceError, match="base_points"):
            plant.set_parameters({"platform_mass": 30.0, "base_points": np.zeros((6, 3))})
        with pytest.raises(InterfaceError, match="platform_com"):
            plant.set_parameters({"platform_mass": 30.0, "platform_com": [1.0, 2.0]})
        assert (interface.unpack(interface.RESULTS, plant.results())["acceleration"] == floating).all()
    assert at_rest[2] < -5
    assert abs(floating[2]) < 0.1


def test_an_inertia_that_no_body_has_is_refused_at_once_and_changes_nothing(open_one: Open) -> None:
    """Expected: rule 3, and rule 6 of a step under the old payload; no parameters at all are none."""
    with open_one(UNEVEN, None) as plant, open_one(UNEVEN, None) as other:
        with pytest.raises(PlatformError, match="triangle"):
            plant.set_parameters({"platform_mass": 30.0, "platform_inertia": np.diag([1.0, 1.0, 3.0])})
        plant.set_parameters({})
        for each in (plant, other):
            each.set_inputs(1.1 * np.append(UNEVEN.home_actuator_force, np.zeros(6)))
            each.do_step(0.0, 0.01)
        assert (plant.results() == other.results()).all()
        plant.set_parameters({"platform_inertia": np.diag([1.0, 1.0, 1.5])})
        with pytest.raises(PlatformError, match="triangle"):
            plant.set_parameters({"platform_inertia": np.diag([1.0, 2.0, 3.1])})
        plant.do_step(0.01, 0.01)


def test_a_centre_of_mass_beyond_the_shortest_leg_of_the_start_is_refused(open_one: Open) -> None:
    """Expected: legs are alike, so that what is not on the shortest lies beside it; home has longer legs."""
    long = replace(UNEVEN, leg_lower_com=2.35)
    low = State(UNEVEN.home_position - [0.0, 0.0, 0.9], np.zeros(3), np.zeros(3), np.zeros(3))
    lengths = leg_geometry(long, low.position, low.orientation).length
    assert lengths.min() < 2.35 < lengths.max()
    with open_one(long, None) as plant:
        plant.do_step(0.0, 0.01)
    with pytest.raises(GoughStewartError, match=r"leg_lower_com.* is 2.35 m"), open_one(long, low) as plant:
        plant.do_step(0.0, 0.01)


@pytest.mark.skipif(sys.platform != "linux", reason="mapped files are read from /proc")
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_failed_instance_does_not_keep_the_library(version: str, fmus: dict[str, Fmu]) -> None:
    """Expected: no file of the unit's folder is mapped into this process afterwards."""
    with UnitFile(fmus[version].path) as file:
        with Unit(file):
            assert str(file.folder) in Path("/proc/self/maps").read_text()
        assert str(file.folder) not in Path("/proc/self/maps").read_text()
        with pytest.raises(PlantError, match="wrong token"):
            Unit(file, token="another")
        assert str(file.folder) not in Path("/proc/self/maps").read_text()


def test_closing_twice_is_fine_and_leaves_nothing(
    fmus: dict[str, Fmu], paper: Platform, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: rule 8; the temporary folder is as empty as before."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    plant = FmuPlant(fmus["3.0"].path, paper)
    assert len(list(tmp_path.iterdir())) == 1
    plant.close()
    plant.close()
    assert list(tmp_path.iterdir()) == []


def test_a_refused_start_leaves_nothing(
    fmus: dict[str, Fmu], paper: Platform, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: an error with the unit's words (a pitch beyond 90°), and no folder."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    start = State(paper.home_position, np.array([0.0, 2.0, 0.0]), np.zeros(3), np.zeros(3))
    with pytest.raises(PlantError, match=r"\.fmu: start values refused: .*orientation"):
        FmuPlant(fmus["2.0"].path, paper, start)
    assert list(tmp_path.iterdir()) == []


def test_a_word_of_the_unit_is_an_error_also_where_the_call_went_well(fmus: dict[str, Fmu]) -> None:
    """Expected: a warning of the unit, put in its mouth, raised by whatever is called next, and only once."""
    with FmuPlant(fmus["3.0"].path, UNEVEN) as plant:
        for call in (
            plant.results,
            lambda: plant.set_inputs(np.zeros(12)),
            lambda: plant.set_parameters({"platform_mass": 12.0}),
            lambda: plant.do_step(0.0, 0.001),
        ):
            plant._unit.messages.append(Message(1, "logStatusWarning", "the oil is warm", None))
            with pytest.raises(PlantError, match=r"\.fmu: the oil is warm$"):
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


def test_open_plant_builds_what_is_not_given_and_keeps_it(
    paper: Platform, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: the first time progress is told and the cache has a file, the second time neither more."""
    monkeypatch.setattr("gough_stewart.fmu_build.cached.cache_folder", lambda: tmp_path)
    for count in (1, 0):
        told: list[str] = []
        with open_plant("fmu3", paper, progress=told.append) as plant:
            plant.do_step(0.0, 0.01)
        assert sum("FMI 3.0: sources" in text for text in told) == count
    names = ["gough_stewart_fmi3.fmu", "gough_stewart_fmi3.fmu.sha256"]
    assert sorted(file.name for file in tmp_path.rglob("*") if file.is_file()) == names


def test_open_plant_opens_the_model_where_it_starts() -> None:
    """Expected: the state of the start, and of the platform its legs there."""
    with open_plant("model", UNEVEN, STATE) as plant:
        found = interface.unpack(interface.RESULTS, plant.results())
    assert np.concatenate([found[name] for name in State._fields]) == pytest.approx(STATE.to_vector(), abs=0)
    assert found["leg_length"] == pytest.approx(leg_geometry(UNEVEN, STATE.position, STATE.orientation).length)


def test_open_plant_refuses_what_does_not_fit(fmus: dict[str, Fmu], paper: Platform) -> None:
    with (
        pytest.raises(PlantError, match=r"is FMI 3.0; expected FMI 2.0"),
        open_plant("fmu2", paper, fmu=fmus["3.0"].path),
    ):
        pass
    with pytest.raises(PlantError, match="'model' does not accept"), open_plant("model", paper, fmu=fmus["3.0"].path):
        pass
    with pytest.raises(PlantError, match="expected model, fmu2 or fmu3"), open_plant("simulink", paper):  # type: ignore[arg-type]
        pass


def test_runs_that_follow_each_other_unpack_the_unit_once(
    fmus: dict[str, Fmu], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Expected: one extraction for three plants, the second from another start, each as if it were the first."""
    unit = shutil.copy(fmus["3.0"].path, tmp_path)
    extract = mock.Mock(side_effect=fmpy.extract)
    monkeypatch.setattr(fmpy, "extract", extract)
    monkeypatch.setattr("gough_stewart.harness.plants.open.cached_build", lambda *_: unit)
    platform = load_preset("liu2000")
    moved = State(platform.home_position + 0.1, platform.home_orientation, np.ones(3), np.zeros(3))
    ends = []
    for start in (None, moved, None):
        with open_plant("fmu3", platform, start) as plant:
            plant.do_step(0.0, 0.01)
            ends.append(plant.results())
    assert extract.call_count == 1
    assert (ends[0] == ends[2]).all()
    assert (ends[0] != ends[1]).any()


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
        values = values_of([*names, "fixed_step_size"], version == "2.0")
        plant._unit.read(values)
        expected: list[float] = [x for v in interface.PLATFORM_PARAMETERS for x in np.ravel(getattr(UNEVEN, v.name))]
        expected += [*UNEVEN.home_actuator_force, *[0.0] * 6, *STATE.to_vector(), 0.004]
        assert values.array == pytest.approx(expected, rel=1e-12)
        new: dict[str, Any] = {"gravity": [1, 2, -3], "leg_viscous_friction_factor": np.arange(6), "platform_mass": 9}
        plant.set_parameters(new)
        plant._unit.read(values)
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
    assert three.arguments[1] == 2
    assert three.arguments[3:] == (7,)


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


def test_open_plant_refuses_in_whole_sentences(fmus: dict[str, Fmu]) -> None:
    """Expected: what does not fit to what, with a number or a file."""
    path = fmus["3.0"].path
    for kind, options, text in (
        ("model", {"fmu": path}, f"plant 'model' does not accept the file {path}; choose the plant fmu2 or fmu3"),
        (
            "model",
            {"fixed_step_size": 0.002},
            "plant 'model' does not accept fixed_step_size 0.002 s; choose the plant f",
        ),
        ("fmu2", {"fmu": path}, f"{path}: is FMI 3.0; expected FMI 2.0 for the plant fmu2"),
        ("fmu3", {"fmu": fmus["2.0"].path}, f"{fmus['2.0'].path}: is FMI 2.0; expected FMI 3.0 for the plant fmu3"),
        ("fmu", {}, "plant is 'fmu'; expected model, fmu2 or fmu3"),
    ):
        with pytest.raises(PlantError) as caught, open_plant(kind, UNEVEN, **options):  # type: ignore[arg-type]
            pass
        assert str(caught.value).startswith(text)


@pytest.mark.usefixtures("units_in_process")
@pytest.mark.parametrize("kind", ["model", "fmu2", "fmu3", "file"])
def test_open_plant_hands_on_start_tolerance_and_step(kind: str, fmus: dict[str, Fmu]) -> None:
    """Expected: to the last bit the plants themselves with the same options; a file in a process of its own."""
    version = {"fmu2": "2.0", "fmu3": "3.0", "file": "2.0"}.get(kind)
    ends = []
    for tolerance, step in ((1e-3, 0.0), (1e-9, 0.0), (1e-8, 0.004)):
        if kind == "model" and step:
            continue
        if version is None:
            own: Plant = ModelPlant(UNEVEN, STATE, tolerance)
        else:
            own = FmuPlant(fmus[version].path, UNEVEN, STATE, tolerance, step)
        fmu = fmus["2.0"].path if kind == "file" else None
        name = "fmu2" if kind == "file" else kind
        options = {"tolerance": tolerance, "fixed_step_size": step, "fmu": fmu}
        with own, open_plant(name, UNEVEN, STATE, **options) as opened:  # type: ignore[arg-type]
            assert isinstance(opened, IsolatedFmu) == (kind == "file")
            for plant in (own, opened):
                plant.set_inputs(INPUTS.to_vector())
                plant.do_step(0.0, 0.05)
            assert np.array_equal(opened.results(), own.results())
            assert np.array_equal(opened.signals(), own.results()[:24])
            ends.append(own.results().tobytes())
    assert len(set(ends)) == len(ends)


def test_a_plant_of_one_platform_has_no_members(open_one: Open) -> None:
    """Expected: no leading axis; actions of members are refused by the name of the plant."""
    with open_one(UNEVEN, STATE) as plant:
        assert plant.shape == ()
        assert plant.results().shape == (50,)
        assert plant.signals().tolist() == plant.results()[:24].tolist()
        name = type(plant).__name__
        text = f"^{name} is a plant of one platform; expected a plant of many platforms for member actions$"
        with pytest.raises(PlantError, match=text):
            plant.freeze(np.array([True]))
        with pytest.raises(PlantError, match=text):
            plant.set_parameters_of(np.array([True]), {"platform_mass": 3.0})
