"""Every pair of a unit's modes of use, against equations of motion by a Lagrangian under SciPy's DOP853.

Neither the equations nor the integration are the unit's. In Model Exchange, DOP853 integrates the unit's derivatives.
"""

from ctypes import c_double
from dataclasses import replace
from itertools import combinations, pairwise, product
from typing import Any

import numpy as np
import pytest
from allpairspy import AllPairs
from scipy.integrate import solve_ivp

from gough_stewart.model.platform import Platform
from tests.support.documented_loop import accelerations, twist_of_rates
from tests.support.fmu_plants import Fmu, Plant, plant
from tests.support.lagrangian import Pose, legs_along
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
CHANGED: dict[str, Any] = {
    "platform_mass": 14.2,
    "platform_inertia": np.array([[5.1, 0.2, -0.3], [0.2, 6.3, 0.4], [-0.3, 0.4, 9.2]]),
    "gravity": np.array([0.7, -1.2, -9.5]),
    "leg_viscous_friction": 21.0,
}
HOME = np.concatenate([UNEVEN.home_position, UNEVEN.home_orientation])
POSE = HOME + np.array([0.05, -0.08, 0.07, -0.06, 0.09, 0.11])
RATES = np.array([0.11, -0.2, 0.15, 0.21, -0.13, 0.3])
FORCES, SLOPES = np.array([61.0, 55.0, 78.0, 49.0, 66.0, 83.0]), np.array([300.0, -500, 200, 700, -400, 600.0])
WRENCH, WRENCH_SLOPES = np.array([7.0, -12.0, 20.0, 3.0, -5.0, 4.0]), np.array([90.0, 60.0, -80.0, 30.0, 20.0, -70.0])


def test_rows_hold_every_pair_of_values() -> None:
    for (a, of_a), (b, of_b) in combinations(OPTIONS.items(), 2):
        assert {(str(r[a]), str(r[b])) for r in ROWS} == {(str(x), str(y)) for x, y in product(of_a, of_b)}


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{ROWS.index(row)}")
def test_the_unit_moves_as_the_machine_does(row: dict[str, Any], fmus: dict[str, Fmu]) -> None:
    """Expected: pose, velocities, accelerations and legs at the end, within what the tolerance allows."""
    fmu = fmus[row["version"]]
    times = np.array([0.0, *np.cumsum(row["communication"])]) + row["begin"]
    assert times[-1] == pytest.approx(row["begin"] + END)
    expected, machine = trajectory(row, times)
    is_co_simulation = row["kind"] == "Co-Simulation"
    with plant(fmu, is_co_simulation, logging=row["logging"]) as first, plant(fmu, is_co_simulation) as other:
        p = started(first, row)
        for k, (t, after) in enumerate(pairwise(times.tolist())):
            if k == 2:
                p = kept(first, other, row)
                change(p, row)
            step(p, row, t, after, times[0])
        q, twist = expected[:6], twist_of_rates(expected[:6]) @ expected[6:]
        accuracy = {1e-9: 2e-8, 1e-6: 2e-5, 1e-3: 2e-7}[row["integrator"][1]]
        if row["kind"] == "Model Exchange":
            accuracy = 2e-8
        assert p.pose == pytest.approx(q, abs=accuracy)
        found = np.concatenate([p.get("velocity"), p.get("angular_velocity")])
        assert found == pytest.approx(twist, abs=30 * accuracy)
        lengths, velocities = legs_along(machine, Pose(*(each[None] for each in (q, expected[6:], np.zeros(6)))))
        assert p.get("leg_length") == pytest.approx(lengths[0], abs=2 * accuracy)
        assert p.get("leg_velocity") == pytest.approx(velocities[0], abs=30 * accuracy)
        force, wrench = inputs(row, times[-1] - times[0], times - times[0])
        expected_rates = accelerations(machine, q, expected[6:], force, wrench)
        # v̇ and ω̇ = d/dt (E q̇), the second part by a difference along the motion
        h = 1e-6
        ahead, behind = (twist_of_rates(q + s * h * expected[6:]) for s in (1, -1))
        both = twist_of_rates(q) @ expected_rates + (ahead - behind) / (2 * h) @ expected[6:]
        given = np.concatenate([p.get("acceleration"), p.get("angular_acceleration")])
        assert given == pytest.approx(both, abs=3e3 * accuracy + 1e-6)
        assert first.messages == []


def inputs(row: dict[str, Any], t: float, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forces and wrench at a time since the start: on a straight line, or its value at the last communication point.

    At the end, the values of the last step still act.
    """
    steps = times[:-1]
    at = t if row["inputs"] == "linear" and can_be_linear(row) else float(steps[np.searchsorted(steps, t, "right") - 1])
    wrench = WRENCH + WRENCH_SLOPES * at if row["wrench"] else np.zeros(6)
    return FORCES + SLOPES * at, wrench


def can_be_linear(row: dict[str, Any]) -> bool:
    """FMI 3.0 has no rates of inputs in Co-Simulation."""
    return bool(row["kind"] == "Model Exchange" or row["version"] == "2.0")


def machines(row: dict[str, Any]) -> tuple[Platform, Platform]:
    """Before and after the third communication point."""
    first = replace(UNEVEN, **SET_AT_FIRST) if row["machine"] in ("set at first", "both") else UNEVEN
    return first, replace(first, **CHANGED) if row["machine"] in ("changed", "both") else first


def trajectory(row: dict[str, Any], times: np.ndarray) -> tuple[np.ndarray, Platform]:
    x = np.concatenate([POSE, RATES]) if row["start"] == "elsewhere" else np.concatenate([HOME, np.zeros(6)])
    machine = UNEVEN
    since = times - times[0]
    for k, (t, after) in enumerate(pairwise(since.tolist())):
        machine = machines(row)[k >= 2]

        def slope(t: float, x: np.ndarray, machine: Platform = machine, after: float = after) -> np.ndarray:
            # an instant before the next point, whose inputs are others
            force, wrench = inputs(row, min(t, np.nextafter(after, 0)), since)
            return np.concatenate([x[6:], accelerations(machine, x[:6], x[6:], force, wrench)])

        x = solve_ivp(slope, (t, after), x, method="DOP853", rtol=1e-11, atol=1e-11).y[:, -1]
    return x, machine


def started(p: Plant, row: dict[str, Any]) -> Plant:
    """Initialised with the row's values; a reset brings the unit back from others."""
    kind, size = row["integrator"]
    values: dict[str, Any] = {"fixed_step_size": size if kind == "fixed" else 0.0}
    if row["start"] == "elsewhere":
        twist = twist_of_rates(POSE) @ RATES
        values |= {"position": POSE[:3], "orientation": POSE[3:], "velocity": twist[:3], "angular_velocity": twist[3:]}
    if row["machine"] in ("set at first", "both"):
        values |= SET_AT_FIRST
    if row["state"] == "after a reset":
        p.start({"platform_mass": 3.3, "position": POSE[:3] + 0.1, "actuator_force": -FORCES})
        p.fmu.terminate()
        p.fmu.reset()
    force, wrench = inputs(row, 0.0, np.array([0.0, 1.0]))
    values |= {"actuator_force": force, "external_force": wrench[:3], "external_torque": wrench[3:]}
    stop = row["begin"] + END if row["stop"] else None
    return p.start(values, size if kind == "tolerance" else 1e-8, row["begin"], stop)


def kept(p: Plant, other: Plant, row: dict[str, Any]) -> Plant:
    """The instance that goes on: with a state that was saved, gone astray and restored, or taken to another one."""
    if row["state"] == "saved and restored":
        state = p.fmu.getFMUState()
        p.set("actuator_force", 3 * FORCES)
        if row["kind"] == "Co-Simulation":
            p.step(float(row["begin"] + sum(row["communication"][:2])), 0.01)
        else:
            p.set("position", POSE[:3] + 0.05)
        p.fmu.setFMUState(state)
        p.fmu.freeFMUState(state)
    if row["state"] == "in another instance":
        other.start(time=0.0)
        other.restore(p.serialized())
        return other
    return p


def change(p: Plant, row: dict[str, Any]) -> None:
    """Tunable parameters, during the run; in Model Exchange in event mode."""
    if row["machine"] not in ("changed", "both"):
        return
    exchange = row["kind"] == "Model Exchange"
    if exchange:
        p.fmu.enterEventMode()
    for name, value in CHANGED.items():
        p.set(name, value)
    if exchange:
        (p.fmu.newDiscreteStates if p.is_fmi2 else p.fmu.updateDiscreteStates)()
        p.fmu.enterContinuousTimeMode()


def step(p: Plant, row: dict[str, Any], t: float, after: float, begin: float) -> None:
    """From one communication point to the next."""
    since = np.array([t, after]) - begin

    def put(at: float) -> None:
        force, wrench = inputs(row, at, since)
        p.set("actuator_force", force)
        p.set("external_force", wrench[:3])
        p.set("external_torque", wrench[3:])

    put(since[0])
    if row["kind"] == "Co-Simulation":
        if row["inputs"] == "linear" and p.is_fmi2:
            p.set_input_rates("actuator_force", SLOPES)
            p.set_input_rates("external_force", WRENCH_SLOPES[:3] * row["wrench"])
            p.set_input_rates("external_torque", WRENCH_SLOPES[3:] * row["wrench"])
        p.step(t, after - t)
        return
    x, xdot = (c_double * 12)(), (c_double * 12)()

    def derivatives(now: float, state: np.ndarray) -> np.ndarray:
        put(min(now, after) - begin if row["inputs"] == "linear" else since[0])
        p.fmu.setTime(now)
        x[:] = state.tolist()
        p.fmu.setContinuousStates(x, 12)
        (p.fmu.getDerivatives if p.is_fmi2 else p.fmu.getContinuousStateDerivatives)(xdot, 12)
        return np.array(xdot)

    p.fmu.getContinuousStates(x, 12)
    end = solve_ivp(derivatives, (t, after), np.array(x), method="DOP853", rtol=1e-10, atol=1e-10).y[:, -1]
    derivatives(after, end)
    p.fmu.completedIntegratorStep()
