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
from tests.support.fmu_plants import DISCARD, POSE, Fmu, by_element, plant
from tests.support.lagrangian import FloatArray
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
}


def simulate_paper(fmu: Fmu, fmi_type: str, **options: Any) -> Any:
    """FMPy's own simulation of the paper's case for 1.5 s; times and poses (n, 6)."""
    values = {name: getattr(PAPER, name) for name in fmu.variables if hasattr(PAPER, name)} | PAPER_START
    result = simulate_fmu(
        str(fmu.path),
        fmi_type=fmi_type,
        start_values=by_element(fmu, values),
        output=[declared.name for name in POSE for declared in fmu.variables[name].declared],
        stop_time=1.5,
        output_interval=0.015,
        relative_tolerance=1e-8,
        **options,
    )
    return result["time"], poses_of(result)


def poses_of(result: Any) -> FloatArray:
    names = [name for name in result.dtype.names if name.startswith(POSE)]
    return np.concatenate([np.asarray(result[name]).reshape(len(result), -1) for name in names], axis=1)


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
    time, poses = simulate_paper(
        fmu, "ModelExchange", debug_logging=True, logger=lambda *a: messages.append(a[-1].decode())
    )
    assert 1.136 - 2 * 0.015 < time[-1] < 1.136 + 0.015
    signs = np.sign(np.linalg.det(gs.leg_jacobian(PAPER, poses[:, :3], poses[:, 3:])))
    assert (signs == signs[0]).all()
    (message,) = messages
    assert "must end" in message
    assert "singular" in message
    if fmu.is_fmi2:
        time, _ = simulate_paper(fmu, "CoSimulation", timeout=20.0)
        assert 1.136 - 2 * 0.015 < time[-1] < 1.136
    else:
        with pytest.raises(FMICallException, match="discard"):
            simulate_paper(fmu, "CoSimulation", timeout=20.0)


def test_casadis_dae_builder_has_the_units_equations(fmu2: Fmu) -> None:
    """Expected: the unit's own derivatives and outputs through FMPy, with other states, inputs and parameters."""
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


def times_of(fmu: Fmu, n: int, step: float, time: float, fixed_step_size: float) -> list[list[float]]:
    """Ends of the internal steps of each communication step, as the intermediate updates have them."""
    seen: list[float] = []
    found = []
    with plant(fmu, intermediateUpdate=lambda *arguments: seen.append(arguments[1])) as p:
        p.start({**MOVING, "fixed_step_size": fixed_step_size}, time=time)
        for _ in range(n):
            seen.clear()
            p.do_step(time, step)
            time += step
            found.append(seen.copy())
            assert p.time == seen[-1] == time
    return found


@pytest.mark.parametrize(("start", "parts"), [(0.0, 1), (0.01, 5), (-0.1, 3), (-0.1, 7), (1e6, 100), (-1e9, 10)])
def test_fixed_steps_are_equal_and_fit_into_the_communication_step(fmu3: Fmu, start: float, parts: int) -> None:
    """Expected: ⌈step/size⌉, early and late; the last ends where it should, to the last bit.

    Of steps from -0.1 s, start + (end - start) is less than the end.
    """
    step = 0.35000000000000003 if start == -0.1 else 0.01
    assert (start + ((start + step) - start) < start + step) == (start == -0.1)
    for seen in times_of(fmu3, 2, step, start, 1.001 * step / parts):
        assert len(seen) == parts
        assert np.allclose(np.diff(seen), step / parts, rtol=1e-6 + abs(start) * 1e-13)
    (seen,) = times_of(fmu3, 1, step, start, step / parts)
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
    with plant(fmu3, **options) as p, plant(fmu3) as exact:
        p.start({**MOVING, "fixed_step_size": 0.01})
        *_, early, last = p.do_step(0.0, 0.2)
        assert (early, last) == (True, 0.0512)
        assert seen == pytest.approx([0.01, 0.02, 0.0278, 0.0356, 0.0434, 0.0512], rel=1e-12)
        exact.start(MOVING, 1e-12)
        exact.do_step(0.0, last)
        assert p.pose == pytest.approx(exact.pose, abs=1e-7)


T = 4e-3


@pytest.fixture(scope="module")
def in_a_system(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Fmu]:
    """Plant and controller in an SSP, whose experiment asks for a tolerance of 1e-9 and a delay of 15 samples."""
    folder = tmp_path_factory.mktemp("system")
    loop = {"duration": 0.74, "sample_time": T, "delay": 15}
    experiment = experiment_of("pid", plant={"tolerance": 1e-9}, loop=loop, actuators={"force_limit": 300.0})
    (path,) = gs.export(experiment, forms="ssp", out=folder, allow_unstable=True)
    with zipfile.ZipFile(path) as archive:
        return {name: Fmu(Path(archive.extract(f"resources/{name}.fmu", folder))) for name in ("plant", "controller")}


def test_a_controllers_forces_wait_for_the_delay_of_the_loop_however_long(in_a_system: dict[str, Fmu]) -> None:
    """Expected: start forces for 14 samples, then those of the unit with a delay of 1; a delay of 16 is refused."""
    lengths = gs.leg_geometry(UNEVEN, POSE_AWAY[:3], POSE_AWAY[3:]).length
    rows = lengths + 0.05 * np.random.default_rng(1).normal(size=(20, 6))
    found = []
    for delay in (1.0, 15.0):
        with plant(in_a_system["controller"]) as p:
            assert p.get("output_delay") == 15
            p.refuses("expected a whole number of samples from 1 to 15", DISCARD, p.set, "output_delay", 16.0)
            p.set("output_delay", delay)
            p.initialise(time=0.5)
            start = p.get_all(["start_force", "force_limited"])
            for k, row in enumerate(rows):
                p.set("leg_length", row)
                p.do_step(0.5 + k * T, T)
                found.append(p.get_all(["actuator_force", "force_limited"]))
    prompt, late = np.array(found[:20]), np.array(found[20:])
    assert 0.2 < prompt[:, 6:].mean() < 0.8
    np.testing.assert_array_equal(late[14:], prompt[:6])
    np.testing.assert_array_equal(late[:14], np.tile(start, (14, 1)))


def test_zeros_in_the_very_first_step_stand_for_the_forces_of_the_start(in_a_system: dict[str, Fmu]) -> None:
    """Expected: the unit under the forces themselves; zeros later, or beside one force that is not, are meant."""

    def pose_after(*forces: FloatArray, tolerance: float | None = None, resets: bool = False) -> FloatArray:
        with plant(in_a_system["plant"]) as p:
            for _ in range(1 + resets):
                p.fmu.reset()
                p.start(time=12.3, tolerance=tolerance)
                for k, force in enumerate(forces):
                    p.set("actuator_force", force)
                    p.do_step(12.3 + k * 0.004, 0.004)
            return p.pose

    with plant(in_a_system["plant"]) as p:
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
