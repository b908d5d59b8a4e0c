"""Every pair of a unit's modes of use, against equations of motion by a Lagrangian under SciPy's DOP853."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from allpairspy import AllPairs
from scipy.integrate import solve_ivp

from gough_stewart import Platform
from tests.support.documented_loop import accelerations, twist_of_rates
from tests.support.fmu_plants import STATES, Fmu, Plant, plant
from tests.support.lagrangian import FloatArray, Pose, legs_along
from tests.support.plain_motion import trajectory
from tests.support.uneven import UNEVEN

END = 0.12
OPTIONS: dict[str, list[Any]] = {
    "version": ["2.0", "3.0"],
    "kind": ["Co-Simulation", "Model Exchange"],
    "integrator": [("tolerance", 1e-9), ("tolerance", 1e-6), ("fixed", 1e-3)],
    "communication": [[0.02] * 6, [0.003, 0.037, 0.0005, 0.0295, 0.05]],
    "inputs": ["held", "linear"],
    "begin": [0.0, 7.3],
    "stop": [False, True],
    "start": ["home", "elsewhere"],
    "machine": ["as built", "set at first", "changed", "both"],
    "state": ["kept", "saved and restored", "in another instance", "after a reset"],
    "wrench": [False, True],
    "logging": [False, True],
}
ROWS = [dict(zip(OPTIONS, row, strict=True)) for row in AllPairs(list(OPTIONS.values()))]

SET_AT_FIRST: dict[str, Any] = {
    "base_points": UNEVEN.base_points + np.arange(18).reshape(6, 3) * 1e-3,
    "leg_upper_mass": 1.7,
    "leg_armature": 4.1,
    "platform_com": np.array([0.03, -0.09, 0.12]),
}
CHANGED: dict[str, Any] = {  # all tunable parameters
    "platform_mass": 14.2,
    "platform_com": np.array([0.02, -0.05, 0.15]),
    "platform_inertia": np.array([[5.1, 0.2, -0.3], [0.2, 6.3, 0.4], [-0.3, 0.4, 9.2]]),
    "gravity": np.array([0.7, -1.2, -9.5]),
    "leg_viscous_friction": 21.0,
    "leg_coulomb_friction": 3.0,
    "leg_friction_velocity": 0.09,
    "leg_viscous_friction_factor": np.array([0.4, 1.7, 0.9, 1.2, 0.0, 1.1]),
    "leg_coulomb_friction_factor": np.array([1.5, 0.6, 1.9, 0.3, 1.0, 0.8]),
}
HOME = np.concatenate([UNEVEN.home_position, UNEVEN.home_orientation])
ELSEWHERE = HOME + np.array([0.05, -0.08, 0.07, -0.06, 0.09, 0.11])
TWIST = twist_of_rates(ELSEWHERE) @ np.array([0.11, -0.2, 0.15, 0.21, -0.13, 0.3])
INPUTS = ("actuator_force", "external_force", "external_torque")
FIRST = np.array([61.0, 55, 78, 49, 66, 83, 7, -12, 20, 3, -5, 4])
SLOPE = np.array([300.0, -500, 200, 700, -400, 600, 90, 60, -80, 30, 20, -70])


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{ROWS.index(row)}")
def test_the_unit_moves_as_the_machine_does(row: dict[str, Any], fmus: dict[str, Fmu]) -> None:
    """Expected: pose, velocities, accelerations and legs at the end, within what the tolerance allows."""
    times = np.array([0.0, *np.cumsum(row["communication"])])
    assert times[-1] == pytest.approx(END)
    is_co_simulation = row["kind"] == "Co-Simulation"
    fmu = fmus[row["version"]]
    with plant(fmu, is_co_simulation, logging=row["logging"]) as first, plant(fmu, is_co_simulation) as other:
        p = started(first, row)
        for k, (t, after) in enumerate(pairwise(times.tolist())):
            if k == 2:
                p = kept(first, other, row)
                change(p, row)
            step(p, row, t, after)
        found = {name: p.get(name) for name in ("acceleration", "angular_acceleration", "leg_length", "leg_velocity")}
        state = p.get_all(STATES)
        assert first.messages == []
    x, machine = expected_end(row, times)
    accuracy = {1e-9: 2e-8, 1e-6: 2e-5, 1e-3: 2e-7}[row["integrator"][1]] if is_co_simulation else 2e-8
    assert state[:6] == pytest.approx(x[:6], abs=accuracy)
    assert state[6:] == pytest.approx(x[6:], abs=30 * accuracy)
    q, rate = x[:6], np.asarray(np.linalg.solve(twist_of_rates(x[:6]), x[6:]), dtype=float)
    lengths, velocities = legs_along(machine, Pose(*(vector[None] for vector in (q, rate, np.zeros(6)))))
    assert found["leg_length"] == pytest.approx(lengths[0], abs=2 * accuracy)
    assert found["leg_velocity"] == pytest.approx(velocities[0], abs=30 * accuracy)
    u = inputs(row, times[-1], times)
    # v̇ and ω̇ = d/dt (E q̇), the second part by a difference along the motion
    h = 1e-6
    ahead, behind = (twist_of_rates(q + s * h * rate) for s in (1, -1))
    both = twist_of_rates(q) @ accelerations(machine, q, rate, u[:6], u[6:]) + (ahead - behind) / (2 * h) @ rate
    accelerated = np.concatenate([found["acceleration"], found["angular_acceleration"]])
    assert accelerated == pytest.approx(both, abs=3e3 * accuracy + 1e-6)


def inputs(row: dict[str, Any], t: float, times: FloatArray) -> FloatArray:
    """Forces and wrench at a time since the start: on a straight line, or held from the last communication point."""
    is_linear = row["inputs"] == "linear" and (row["kind"] == "Model Exchange" or row["version"] == "2.0")
    at = t if is_linear else float(times[:-1][np.searchsorted(times[:-1], t, "right") - 1])
    return np.asarray((FIRST + SLOPE * at) * np.repeat([1, row["wrench"]], 6))


def expected_end(row: dict[str, Any], times: FloatArray) -> tuple[FloatArray, Platform]:
    """Pose and twist at the end, and the machine then."""
    x = np.concatenate([ELSEWHERE, TWIST] if row["start"] == "elsewhere" else [HOME, np.zeros(6)])
    machine = replace(UNEVEN, **SET_AT_FIRST) if row["machine"] in ("set at first", "both") else UNEVEN
    # where inputs jump, or the machine changes
    kinks = times if row["inputs"] == "held" or row["version"] == "3.0" else times[[0, 2, -1]]
    for t, after in pairwise(kinks.tolist()):
        if t == times[2] and row["machine"] in ("changed", "both"):
            machine = replace(machine, **CHANGED)

        def u(at: float, after: float = after) -> FloatArray:
            # an instant before the next point, whose inputs are others
            return inputs(row, min(at, np.nextafter(after, 0)), times)

        x = trajectory(machine, x, u, np.array([t, after]))[-1]
    return x, machine


def put(p: Plant, u: FloatArray) -> None:
    for name, values in zip(INPUTS, (u[:6], u[6:9], u[9:]), strict=True):
        p.set(name, values)


def started(p: Plant, row: dict[str, Any]) -> Plant:
    """Initialised with the row's values; a reset brings the unit back from others."""
    kind, size = row["integrator"]
    values: dict[str, Any] = {"fixed_step_size": size if kind == "fixed" else 0.0}
    if row["start"] == "elsewhere":
        values |= dict(zip(STATES, np.concatenate([ELSEWHERE, TWIST]).reshape(4, 3), strict=True))
    if row["machine"] in ("set at first", "both"):
        values |= SET_AT_FIRST
    if row["state"] == "after a reset":
        p.start({"platform_mass": 3.3, "position": HOME[:3] + 0.1, "actuator_force": -FIRST[:6]})
        p.fmu.terminate()
        p.fmu.reset()
    put(p, inputs(row, 0.0, np.array([0.0, 1.0])))
    stop = row["begin"] + END if row["stop"] else None
    return p.start(values, size if kind == "tolerance" else 1e-8, row["begin"], stop)


def kept(p: Plant, other: Plant, row: dict[str, Any]) -> Plant:
    """The instance that goes on: with a state that was saved, gone astray and restored, or taken to another one."""
    if row["state"] == "saved and restored":
        state = p.fmu.getFMUState()
        p.set("actuator_force", 3 * FIRST[:6])
        if p.co_simulation:
            p.do_step(float(row["begin"] + sum(row["communication"][:2])), 0.01)
        else:
            p.set("position", ELSEWHERE[:3] + 0.05)
        p.fmu.setFMUState(state)
        p.fmu.freeFMUState(state)
    if row["state"] == "in another instance":
        other.start()
        other.restore(p.serialized())
        return other
    return p


def change(p: Plant, row: dict[str, Any]) -> None:
    """Tunable parameters, during the run; in Model Exchange in event mode."""
    if row["machine"] not in ("changed", "both"):
        return
    if not p.co_simulation:
        p.fmu.enterEventMode()
    for name, value in CHANGED.items():
        p.set(name, value)
    if not p.co_simulation:
        p.leave_event_mode()


def step(p: Plant, row: dict[str, Any], t: float, after: float) -> None:
    """From one communication point to the next."""
    points, begin = np.array([t, after]), row["begin"]
    put(p, inputs(row, t, points))
    if p.co_simulation:
        if row["inputs"] == "linear" and p.is_fmi2:
            slope = SLOPE * np.repeat([1, row["wrench"]], 6)
            for name, rates in zip(INPUTS, (slope[:6], slope[6:9], slope[9:]), strict=True):
                p.set_input_rates(name, rates)
        p.do_step(begin + t, (begin + after) - (begin + t))
        return

    def derivatives(now: float, state: FloatArray) -> FloatArray:
        put(p, inputs(row, min(now, np.nextafter(after, 0)), points))
        p.fmu.setTime(begin + now)
        p.set_states(state)
        return p.state_rates()

    end = solve_ivp(derivatives, (t, after), p.get_states(), method="DOP853", rtol=1e-10, atol=1e-10).y[:, -1]
    derivatives(after, end)
    p.fmu.completedIntegratorStep()
