"""Motions of a unit in FMPy, in importers as they come, and its internal steps."""

import zipfile
from pathlib import Path
from typing import Any

import casadi
import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.fmi1 import FMICallException

import gough_stewart as gs
from tests.support.fmu_plants import POSE, Fmu, by_element, plant
from tests.support.lagrangian import FloatArray
from tests.support.plain_motion import trajectory
from tests.support.uneven import MOVING, UNEVEN
from tests.support.uneven_loops import POSE as POSE_AWAY
from tests.support.uneven_loops import experiment_of

PAPER = gs.load_preset("liu2000")
# The paper's case; at 1.136 s it passes a singular pose.
PAPER_START = {
    "position": [0.0, 0.0, 3.0],
    "orientation": [0.0, 0.0, -0.1],
    "velocity": [0.0, 0.2, 0.0],
    "angular_velocity": [0.0, 0.1, 0.0],
    "actuator_force": [55, 49.5] * 3,
    "external_force": [0.0] * 3,
    "external_torque": [0.0] * 3,
}
CASES: dict[str, tuple[gs.Platform, dict[str, Any], float]] = {
    "paper": (PAPER, PAPER_START, 1.0),
    "uneven": (UNEVEN, MOVING, 0.5),
}


def simulate(fmu: Fmu, case: str, fmi_type: str, duration: float | None = None, **options: Any) -> Any:
    """FMPy's own simulation of a case; times and poses (n, 6)."""
    platform, values, stop = CASES[case]
    parameters = {
        name: getattr(platform, name)
        for name, whole in fmu.variables.items()
        if whole.declared[0].causality == "parameter" and name != "fixed_step_size"
    }
    result = simulate_fmu(
        str(fmu.path),
        fmi_type=fmi_type,
        start_values=by_element(fmu, parameters | values),
        output=[declared.name for name in POSE for declared in fmu.variables[name].declared],
        stop_time=duration or stop,
        output_interval=(duration or stop) / 100,
        relative_tolerance=1e-8,
        **options,
    )
    return result["time"], poses_of(result)


def poses_of(result: Any) -> FloatArray:
    names = [name for name in result.dtype.names if name.startswith(POSE)]
    return np.concatenate([np.asarray(result[name]).reshape(len(result), -1) for name in names], axis=1)


def run(fmu: Fmu, steps: list[float], case: str = "uneven", tolerance: float = 1e-8, fixed: float = 0.0) -> FloatArray:
    platform, values, _ = CASES[case]
    with plant(fmu) as p:
        p.start({**values, "fixed_step_size": fixed}, tolerance, platform=platform)
        time = 0.0
        for step in steps:
            p.do_step(time, step)
            time += step
        return p.pose


# --- against another integration of other equations ------------------------------------------------------------------


@pytest.mark.parametrize("fmi_type", ["CoSimulation", "ModelExchange"])
def test_fmpys_simulation_ends_where_the_lagrangian_does(fmu: Fmu, fmi_type: str) -> None:
    time, poses = simulate(fmu, "paper", fmi_type)
    assert time[-1] == pytest.approx(1.0, rel=1e-12)
    flat = np.concatenate([np.ravel(value) for value in PAPER_START.values()])
    end = trajectory(PAPER, flat[:12], lambda _t: flat[12:], np.array([0.0, 1.0]))[-1, :6]
    assert np.abs(poses[-1] - end).max() <= 1e-7


# --- importers -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fmi_type", ["CoSimulation", "ModelExchange"])
def test_a_unit_with_default_settings_stands_still_to_its_default_stop_time(fmu: Fmu, fmi_type: str) -> None:
    """Expected: the home pose, for a second; six different forces hold an uneven platform in gravity aslant."""
    result = simulate_fmu(str(fmu.path), fmi_type=fmi_type)
    assert result["time"][-1] == 1.0
    home = np.concatenate([UNEVEN.home_position, UNEVEN.home_orientation])
    assert np.abs(poses_of(result) - home).max() < 1e-11


def test_fmpys_loops_end_at_a_singular_pose(fmu: Fmu) -> None:
    """Expected: at 1.136 s in Model Exchange with one message; in Co-Simulation fmi2Terminated, or an error."""
    messages: list[str] = []
    time, poses = simulate(
        fmu, "paper", "ModelExchange", 1.5, debug_logging=True, logger=lambda *a: messages.append(a[-1].decode())
    )
    assert 1.136 - 2 * 0.015 < time[-1] < 1.136 + 0.015
    signs = np.sign(np.linalg.det(gs.leg_jacobian(PAPER, poses[:, :3], poses[:, 3:])))
    assert (signs == signs[0]).all()
    (message,) = messages
    assert "must end" in message
    assert "singular" in message
    if fmu.is_fmi2:
        time, _ = simulate(fmu, "paper", "CoSimulation", 1.5, timeout=20.0)
        assert 1.136 - 2 * 0.015 < time[-1] < 1.136
    else:
        with pytest.raises(FMICallException, match="discard"):
            simulate(fmu, "paper", "CoSimulation", 1.5, timeout=20.0)


def test_casadis_dae_builder_has_the_units_equations_and_jacobians(fmu2: Fmu) -> None:
    """Expected: the unit's own derivatives and outputs through FMPy, and central differences of them, by x, u and p."""
    dae = casadi.DaeBuilder("plant", str(fmu2.folder))
    parts, functions = ("x", "u", "p"), ("ode", "y")
    point = [np.array(dae.start(getattr(dae, part)())) for part in parts]
    values = by_element(fmu2, MOVING)
    for part, vector in zip(parts, point, strict=True):
        vector[:] = [values.get(name, 1.1 * v) for name, v in zip(getattr(dae, part)(), vector, strict=True)]
    evaluate = dae.create("found", list(parts), list(functions))
    found = [np.array(each).ravel() for each in evaluate(*point)]
    with plant(fmu2, co_simulation=False) as p:
        p.start()
        p.fmu.enterEventMode()
        references = {v.name: v.valueReference for v in fmu2.description.modelVariables}
        for part, vector in zip(("u", "p"), point[1:], strict=True):
            p.fmu.setReal([references[name] for name in getattr(dae, part)()], vector.tolist())
        p.leave_event_mode()
        p.set_states(point[0])
        assert found[0] == pytest.approx(p.state_rates(), rel=1e-12)
        assert found[1] == pytest.approx(p.fmu.getReal([references[name] for name in dae.y()]), rel=1e-12)
    jacobians = dae.create("jacobians", list(parts), [f"jac_{f}_{part}" for f in functions for part in parts])(*point)
    for k, jacobian in enumerate(np.array(each) for each in jacobians):
        at, h = k % 3, 1e-6
        for column in range(len(point[at])):
            ends = []
            for sign in (1, -1):
                moved = [vector.copy() for vector in point]
                moved[at][column] += sign * h
                ends.append(np.array(evaluate(*moved)[k // 3]).ravel())
            expected = (ends[0] - ends[1]) / (2 * h)
            assert jacobian[:, column] == pytest.approx(expected, rel=1e-5, abs=1e-5), (k, column)


# --- internal steps --------------------------------------------------------------------------------------------------


def times_of(fmu: Fmu, case: str, steps: list[float], tolerance: float = 1e-8, time: float = 0.0, **values: Any) -> Any:
    """Ends of the internal steps of each communication step, as the intermediate updates have them."""
    platform, starts, _ = CASES[case]
    seen: list[float] = []
    found = []
    with plant(fmu, intermediateUpdate=lambda *arguments: seen.append(arguments[1])) as p:
        p.start({**starts, **values}, tolerance, time, platform=platform)
        for step in steps:
            seen.clear()
            p.do_step(time, step)
            time += step
            found.append(seen.copy())
            assert p.time == seen[-1] == time
    return found


@pytest.mark.parametrize(("start", "parts"), [(0.0, 1), (0.01, 5), (-0.1, 3), (-0.1, 7), (1e6, 100), (-1e9, 10)])
def test_fixed_steps_are_equal_and_fit_into_the_communication_step(fmu3: Fmu, start: float, parts: int) -> None:
    """Expected: ⌈step/size⌉, early and late; the last ends where it should, to the last bit."""
    step = 0.35000000000000003 if start == -0.1 else 0.01
    assert (start + ((start + step) - start) < start + step) == (start == -0.1)
    for seen in times_of(fmu3, "uneven", [step] * 2, time=start, fixed_step_size=1.001 * step / parts):
        assert len(seen) == parts
        assert np.allclose(np.diff(seen), step / parts, rtol=1e-6 + abs(start) * 1e-13)
    (seen,) = times_of(fmu3, "uneven", [step], time=start, fixed_step_size=step / parts)
    assert len(seen) == parts


def test_a_fixed_step_that_ends_early_has_equal_steps_up_to_there(fmu3: Fmu) -> None:
    """Expected: asked at 0.02 s to end at 0.0512 s, four more steps of 7.8 ms, not above 10 ms."""
    seen: list[float] = []

    def update(_e: Any, time: float, _s: bool, _g: bool, _f: bool, _m: bool, wanted: Any, at: Any) -> None:
        seen.append(time)
        if time > 0.015:
            wanted[0], at[0] = True, 0.0512

    options: dict[str, Any] = {
        "intermediateUpdate": update,
        "requiredIntermediateVariables": [0, 3],
        "earlyReturnAllowed": True,
    }
    with plant(fmu3, **options) as p:
        p.start({**MOVING, "fixed_step_size": 0.01})
        *_, early, last = p.do_step(0.0, 0.2)
        assert (early, last) == (True, 0.0512)
        assert seen == pytest.approx([0.01, 0.02, 0.0278, 0.0356, 0.0434, 0.0512], rel=1e-12)
        assert p.pose == pytest.approx(run(fmu3, [last], tolerance=1e-12), abs=1e-7)


# --- beside a controller ---------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def in_a_system(tmp_path_factory: pytest.TempPathFactory) -> Fmu:
    """The plant in an SSP, whose experiment asks for a tolerance of 1e-9."""
    folder = tmp_path_factory.mktemp("system")
    (path,) = gs.export(experiment_of("pid", plant={"tolerance": 1e-9}), forms="ssp", out=folder, allow_unstable=True)
    with zipfile.ZipFile(path) as archive:
        return Fmu(Path(archive.extract("resources/plant.fmu", folder)))


def test_zeros_in_the_very_first_step_stand_for_the_forces_of_the_start(in_a_system: Fmu) -> None:
    """Expected: the unit under the forces themselves; zeros later, or beside one force that is not, are meant."""

    def pose_after(*forces: FloatArray, tolerance: float | None = None, resets: bool = False) -> FloatArray:
        with plant(in_a_system) as p:
            for _ in range(1 + resets):
                p.fmu.reset()
                p.start(time=12.3, tolerance=tolerance)
                for k, force in enumerate(forces):
                    p.set("actuator_force", force)
                    p.do_step(12.3 + k * 0.004, 0.004)
            return p.pose

    with plant(in_a_system) as p:
        held = p.get("actuator_force")
        assert p.get("position") == pytest.approx(POSE_AWAY[:3])
    zero, one = np.zeros(6), np.array([0.0, 0, 0, 0, 0, 1e-3])
    assert np.abs(held).min() > 1
    assert np.array_equal(pose_after(zero, held), pose_after(held, held))
    assert np.array_equal(pose_after(zero, resets=True), pose_after(held))
    assert np.abs(pose_after(held, zero) - pose_after(held, held)).max() > 1e-5
    assert np.abs(pose_after(one) - pose_after(held)).max() > 1e-5
    many = [1.5 * held] * 20
    assert np.array_equal(pose_after(*many), pose_after(*many, tolerance=1e-9))
    assert not np.array_equal(pose_after(*many), pose_after(*many, tolerance=1e-13))
