"""Controllers in whole runs: what they are told, what linear ones compute, and members of an ensemble as alone."""

from typing import Any

import casadi
import control
import numpy as np
import pytest

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.uneven import UNEVEN
from tests.support.uneven_loops import POSE, experiment_of

T, STEP, DURATION = 5e-3, 1e-3, 0.1
FORCE_LIMIT, RATE_LIMIT = 70.0, 1100.0
SIGNALS = ("position", "orientation", "velocity", "angular_velocity", "leg_length", "leg_velocity")
PLACES = {name: 3 if k < 4 else 6 for k, name in enumerate(SIGNALS)}
TABLES: dict[str, Any] = {
    "reference": {
        **{"type": "sine", "position": POSE[:3].tolist(), "orientation": POSE[3:].tolist()},
        **{"position_amplitude": [0.02, -0.01, 0.015], "orientation_amplitude": [0.03, -0.02, 0.04]},
        **{"frequency": 2.3, "phase": 0.6},
    },
    "start": {
        "position": (POSE[:3] + np.array([0.004, 0.002, -0.003])).tolist(),
        "orientation": (POSE[3:] + np.array([-0.003, 0.005, 0.004])).tolist(),
    },
    "loop": {"duration": DURATION, "sample_time": T, "plant_step": STEP, "delay": 1},
    "sensors": {"noise": {"leg_length": 1e-4, "velocity": 3e-3}, "seed": 5},
    "actuators": {"force_limit": FORCE_LIMIT, "rate_limit": RATE_LIMIT},
    "limits": {"reference": "warn", "position_error": 10.0},
}
SETTINGS = {"controller.feedforward": "computed_torque"}


def injected(time: float) -> FloatArray:
    """Another force on each leg."""
    return np.asarray(3 * np.sin(40 * time + np.arange(6)))


def run_of(controller: Any, plant: Any = None, **tables: Any) -> gs.Record:
    experiment = experiment_of("pd", **(TABLES | tables))
    return gs.run(experiment, SETTINGS, controller=controller, injection=injected, plant=plant)


def at_samples(record: gs.Record, name: str) -> FloatArray:
    """The first row of each sample."""
    return np.asarray(record[name][: -1 : round(T / STEP)])


def excesses(record: gs.Record) -> FloatArray:
    """What both limits left of the last command, minus it, from the static forces of the start on; at first nothing."""
    commands, planned, found = at_samples(record, "controller.force"), record["actuator_force"][0], [np.zeros(6)]
    for command in commands[:-1]:
        clipped = np.clip(command, -FORCE_LIMIT, FORCE_LIMIT)
        planned = planned + np.clip(clipped - planned, -RATE_LIMIT * T, RATE_LIMIT * T)
        found.append(planned - command)
    return np.array(found)


def test_a_function_is_told_what_the_record_shows() -> None:
    """Expected: every field of every sample by the columns of the record; the excess from them by the limits."""
    seen: list[gs.Sample] = []

    def law(sample: gs.Sample) -> FloatArray:
        seen.append(sample)
        error = sample.reference["leg_length"] - sample.measured["leg_length"]
        return 900 * error - 60 * sample.measured["leg_velocity"] + np.arange(6)

    record = run_of(law)
    n = round(DURATION / T)
    assert [sample.index for sample in seen] == list(range(n))
    assert [sample.time for sample in seen] == pytest.approx(np.arange(n) * T, abs=1e-15)
    assert {sample.sample_time for sample in seen} == {T}
    assert all(sample.platform == seen[0].platform for sample in seen)
    assert seen[0].platform.platform_mass == UNEVEN.platform_mass  # not the machine's
    for name in SIGNALS:
        told = np.array([sample.measured[name] for sample in seen])
        assert told == pytest.approx(at_samples(record, f"measured.{name}"), abs=0)
        assert told.shape == (n, PLACES[name])
        assert (np.abs(told - at_samples(record, name)) > 1e-6).any() == (name in TABLES["sensors"]["noise"])
    for name in (*SIGNALS, "acceleration", "angular_acceleration"):
        told = np.array([sample.reference[name] for sample in seen])
        assert told == pytest.approx(at_samples(record, f"reference.{name}"), abs=0)
        assert np.abs(told).min() > 0
    commands = at_samples(record, "controller.force")
    assert np.array([sample.command for sample in seen[1:]]) == pytest.approx(commands[:-1], abs=1e-12)
    assert not seen[0].command.any()
    ahead = at_samples(record, "controller.feedforward")
    assert np.array([sample.feedforward for sample in seen]) == pytest.approx(ahead, abs=0)
    assert np.ptp(ahead, axis=0).min() > 0.1
    expected = excesses(record)
    assert np.array([sample.excess for sample in seen]) == pytest.approx(expected, abs=1e-9)
    assert (np.abs(expected) > 1).any(axis=0).sum() >= 3
    own = np.array([law(sample) for sample in list(seen)])
    injections = at_samples(record, "controller.injection")
    assert injections == pytest.approx(np.array([injected(k * T) for k in range(n)]), abs=1e-12)
    assert commands == pytest.approx(own + ahead + injections, abs=1e-9)


def system(inputs: int, seed: int = 3, states: int = 4) -> Any:
    """A stable system in which everything depends on everything."""
    rng = np.random.default_rng(seed)
    A = rng.uniform(-0.3, 0.3, (states, states))
    sizes = ((states, inputs), (6, states), (6, inputs))
    return control.ss(A, *(200 * rng.normal(size=size) for size in sizes), T)


def wanted_and_measured(record: gs.Record, names: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
    return tuple(  # type: ignore[return-value]
        np.hstack([at_samples(record, f"{kind}.{name}") for name in names]) for kind in ("reference", "measured")
    )


def recursion(plain: Any, u: FloatArray, u_at_rest: FloatArray) -> tuple[FloatArray, FloatArray]:
    """x⁺ = A x + B u, w = C x + D u from the rest of the first input without excess: (w, x) of every sample."""
    x = np.linalg.solve(np.eye(len(plain.A)) - plain.A, plain.B @ u_at_rest)
    outputs, states = [], []
    for each in u:
        states.append(x)
        outputs.append(plain.C @ x + plain.D @ each)
        x = plain.A @ x + plain.B @ each
    return np.array(outputs), np.array(states)


@pytest.mark.parametrize("names", [("leg_length",), ("leg_velocity", "position", "angular_velocity")], ids=len)
@pytest.mark.parametrize("form", ["errors", "both", "excess"])
@pytest.mark.parametrize("plant", ["model", "fmu3"])
def test_a_linear_controller_is_its_recursion_over_the_record(form: str, names: tuple[str, ...], plant: str) -> None:
    """Expected: of the record's references, measurements and limits, plus feedforward and injection; on both plants."""
    n = sum(PLACES[name] for name in names)
    plain = system({"errors": n, "both": 2 * n, "excess": 2 * n + 6}[form])
    record = run_of(gs.LinearController(plain, names), plant)
    wanted, measured = wanted_and_measured(record, names)
    inputs = wanted - measured if form == "errors" else np.hstack([wanted, measured])
    rest = inputs[0]
    if form == "excess":
        inputs, rest = np.hstack([inputs, excesses(record)]), np.append(inputs[0], np.zeros(6))
    forces, states = recursion(plain, inputs, rest)
    known = at_samples(record, "controller.feedforward") + at_samples(record, "controller.injection")
    assert at_samples(record, "controller.force") == pytest.approx(forces + known, rel=1e-9, abs=1e-8)
    assert at_samples(record, "controller.state") == pytest.approx(states, rel=1e-9, abs=1e-9)
    assert np.abs(excesses(record)).max() > 1


@pytest.mark.parametrize("plant", ["model", "fmu3"])
def test_in_task_space_it_is_its_recursion_through_the_jacobians_of_the_reference(plant: str) -> None:
    """Expected: y = ∑ J⁻¹ ΔL, r = y + J⁻¹ (L_r − L), Jᵀ times the excess, F = J⁻ᵀ w; J of the nominal platform."""
    plain = system(18, seed=8)
    record = run_of(gs.LinearController(plain, space="task"), plant)
    wanted, measured = wanted_and_measured(record, ("leg_length",))
    poses = (at_samples(record, "reference.position"), at_samples(record, "reference.orientation"))
    J = np.array([gs.leg_jacobian(UNEVEN, *pose) for pose in zip(*poses, strict=True)])
    solved = np.array([np.linalg.inv(each) for each in J])
    moved = np.vstack([np.zeros(6), np.diff(measured, axis=0)])
    y = np.cumsum(np.einsum("nij,nj->ni", solved, moved), axis=0)
    r = y + np.einsum("nij,nj->ni", solved, wanted - measured)
    excess = np.einsum("nji,nj->ni", J, excesses(record))
    wrenches, states = recursion(plain, np.hstack([r, y, excess]), np.concatenate([r[0], y[0], np.zeros(6)]))
    forces = np.einsum("nji,nj->ni", solved, wrenches)
    known = at_samples(record, "controller.feedforward") + at_samples(record, "controller.injection")
    assert at_samples(record, "controller.force") == pytest.approx(forces + known, rel=1e-8, abs=1e-7)
    assert at_samples(record, "controller.state") == pytest.approx(states, rel=1e-8, abs=1e-9)


def first_command(controller: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of the controller alone at the first sample, with the errors of the legs that it saw, and J of the reference."""
    record = run_of(controller)
    known = record["controller.feedforward"][0] + record["controller.injection"][0]
    J = gs.leg_jacobian(UNEVEN, record["reference.position"][0], record["reference.orientation"][0])
    error = record["reference.leg_length"][0] - record["measured.leg_length"][0]
    assert np.abs(error).min() > 1e-5
    return record["controller.force"][0] - known, error, J


@pytest.mark.parametrize("notch", [None, gs.Notch(frequency=30, damping=0.4, depth=0.2)], ids=["plain", "notch"])
@pytest.mark.parametrize("space", ["leg", "task"])
def test_a_start_off_the_reference_gives_no_kick_of_the_derivative(space: Any, notch: Any) -> None:
    """Expected: kp e and half a step of the integral by Tustin's rule, in legs or axes; a notch passes what rests."""
    kp, ki = np.array([900.0, 1100, 1000, 800, 950, 1050]), np.array([3e4, 0.0, 2e4, 5e4, 4e4, 1e4])
    gains: dict[str, Any] = {"proportional_gain": kp, "derivative_gain": 60 + 0.01 * kp, "integral_gain": ki}
    pid = gs.PID(space=space, **gains, derivative_filter=0.01, notch=notch)
    force, error, J = first_command(pid.controller(UNEVEN, T))
    J = np.eye(6) if space == "leg" else J
    assert J.T @ force == pytest.approx((kp + ki * T / 2) * np.linalg.solve(J, error), rel=1e-9)


def test_the_memory_at_rest_leaves_integrators_at_zero_in_any_coordinates() -> None:
    """Expected: a lag of gain 5 settled beside a double integrator at zero; coordinates mixed at random.

    Slow filters behind a PI are no integrators, though singular values take them for some: without an error no force.
    """
    rng = np.random.default_rng(6)
    A = np.array([[0.9, 0, 0], [0, 1, T], [0, 0, 1]])
    B, C = np.array([[0.5], [0.0], [T]]), np.array([[1.0, 1.0, 0.0]])
    mix = rng.normal(size=(3, 3))
    one = control.ss(mix @ A @ np.linalg.inv(mix), mix @ B, C @ np.linalg.inv(mix), 0, T)
    force, error, _ = first_command(control.append(*[one] * 6))
    assert force == pytest.approx(5 * error, rel=1e-7)
    pi, slow = control.tf([1.2, -1.19], [1, -1], T), control.tf([1e-7], np.poly([0.999, 0.9989, 0.9988]), T)
    record = run_of(control.append(*[control.ss(pi * slow)] * 6), start={}, sensors={})
    known = record["controller.feedforward"][0] + record["controller.injection"][0]
    assert record["controller.force"][0] == pytest.approx(known, abs=1e-9)
    assert np.abs(record["controller.state"][0]).max() < 1e-9


def of_gain(_platform: gs.Platform, _sample_time: float, gain: float = 1.0) -> gs.LinearController:
    """A linear controller whose states depend on each other, another one for each gain."""
    plain = system(12)
    A = plain.A * gain
    A[0, 0], A[0, 1:] = 1.0, 0.0  # an integrator, which others hear
    made = control.ss(A, plain.B * gain, plain.C * 0.3, plain.D * gain**2, T)
    return gs.LinearController(made, space="task")


VARIES: dict[str, Any] = {
    "members": 5,
    "seed": 4,
    "tolerance": 1e-10,
    "platform_mass": {"normal": "2 kg"},
    "controller": {"parameters": {"gain": {"uniform": [0.5, 1.2]}}},
    "loop": {"delay": {"choice": [0, 1, 3]}, "jitter": {"uniform": [0.0011, 0.0049]}},
    "actuators": {"rate_limit": {"uniform": [700.0, 1500.0]}, "force_limit": {"uniform": [60.0, 80.0]}},
    "sensors": {"noise": {"leg_length": {"uniform": [1e-5, 2e-4]}}},
}


def flat(values: Any, path: str = "") -> dict[str, float]:
    """Numbers of nested tables by their paths, of a list the largest; what is not defined is left out."""
    if isinstance(values, dict):
        return {name: x for key, inner in values.items() for name, x in flat(inner, f"{path}.{key}").items()}
    listed = values if isinstance(values, list) else [values]
    is_left_out = not listed or path.endswith(("shortest", "exceeded"))
    return {} if is_left_out or not all(isinstance(x, int | float) for x in listed) else {path[1:]: max(listed)}


def test_members_with_controllers_of_their_own_have_the_numbers_of_runs_of_their_own() -> None:
    """Expected: the same member alone in the loop of one, by the stepping model with an error-controlled step."""
    python = {"type": "python", "parameters": {"gain": 1.0}, "feedforward": "gravity"}
    tables = TABLES | {"controller": python, "ensemble": VARIES, "loop": {**TABLES["loop"], "jitter": 0.002}}
    experiment = experiment_of("pd", **tables, plant={"tolerance": 1e-10})
    found = gs.ensemble(experiment, controller=of_gain, workers=1)
    delays = found.members["varied.loop.delay"].to_numpy()
    assert np.ptp(delays) > 0
    for member in (0, 2, 4):
        alone = flat(gs.metrics(gs.run(experiment, controller=of_gain, member=member, plant="model")))
        names = [name for name in found.metrics if name in alone]
        assert len(names) > 25
        for name in names:
            assert found.values(name)[member] == pytest.approx(alone[name], rel=1e-6, abs=1e-9), name


def test_warnings_of_a_users_arithmetic_are_seen_in_a_run_and_not_in_an_ensemble() -> None:
    """Expected: NumPy's warning for one; of many members, whose numbers may be anything once they have ended, none."""

    def divides(sample: gs.Sample) -> FloatArray:
        return np.where(np.ones(6) / np.zeros(6) > 0, 30.0 + 0 * sample.measured["leg_length"], 0.0)

    with pytest.warns(RuntimeWarning, match="divide by zero"):
        run_of(divides)
    ensemble = {"members": 2, "platform_mass": {"normal": "1 kg"}}
    found = gs.ensemble(experiment_of("pd", **TABLES, ensemble=ensemble), controller=divides, workers=1)
    assert found.members["outcome"].to_list() == ["completed"] * 2


@pytest.mark.parametrize("plant", ["model", "fmu3"])
def test_a_casadi_function_gets_its_signals_by_name_and_keeps_its_memory(plant: Any) -> None:
    """Expected: of every sample its own readings, reference and time, and a memory that has counted from zero."""
    names = ("memory", "reference_leg_length", "time", "leg_velocity", "leg_length")
    memory, wanted, time = casadi.SX.sym("m", 2, 3), casadi.SX.sym("r", 6), casadi.SX.sym("t")
    velocity, length = casadi.SX.sym("v", 6), casadi.SX.sym("l", 6)
    stiffness, damping = 1e4 * np.arange(1.0, 7), 100.0 * np.arange(7.0, 1, -1)
    force = stiffness * (wanted - length) - damping * velocity + 50 * time + casadi.vec(memory)
    counted = memory + np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    inputs, outputs = [memory, wanted, time, velocity, length], ["memory_next", "actuator_force"]
    function = casadi.Function("law", inputs, [counted, force], list(names), outputs)
    settings = {"loop.duration": 0.06, "loop.sample_time": 2e-3, "loop.plant_step": 1e-3, "loop.delay": 1}
    record = gs.run("circle", settings, controller=function, plant=plant)
    rows = slice(0, -1, 2)
    samples = np.arange(len(record["time"][rows]))[:, None]
    error = record["reference.leg_length"][rows] - record["measured.leg_length"][rows]
    expected = stiffness * error - damping * record["measured.leg_velocity"][rows] + 50 * record["time"][rows][:, None]
    expected += samples * np.array([1.0, 4.0, 2.0, 5.0, 3.0, 6.0])
    found = (record["controller.force"] - record["controller.feedforward"])[rows]
    assert len(samples) == 30
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-6)
