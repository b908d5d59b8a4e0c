"""Controllers in whole runs: what they are told, what linear ones compute, and members of an ensemble as alone."""

from typing import Any

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
    return np.asarray(3 * np.sin(40 * time + np.arange(6)))


def run_of(controller: Any, plant: Any = None, **tables: Any) -> gs.Record:
    experiment = experiment_of("pd", **(TABLES | tables))
    return gs.run(experiment, SETTINGS, controller=controller, injection=injected, plant=plant)


def at_samples(record: gs.Record, name: str) -> FloatArray:
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


def recursion(plain: Any, u: FloatArray, u_at_rest: FloatArray) -> tuple[FloatArray, FloatArray]:
    """x⁺ = A x + B u, w = C x + D u from the rest of the first input without excess: (w, x) of every sample."""
    x = np.linalg.solve(np.eye(len(plain.A)) - plain.A, plain.B @ u_at_rest)
    outputs, states = [], []
    for each in u:
        states.append(x)
        outputs.append(plain.C @ x + plain.D @ each)
        x = plain.A @ x + plain.B @ each
    return np.array(outputs), np.array(states)


BY_LEGS, BY_OTHERS = ("leg_length",), ("leg_velocity", "position", "angular_velocity")


@pytest.mark.parametrize(
    ("form", "names"),
    [*((form, names) for form in ("errors", "both", "excess") for names in (BY_LEGS, BY_OTHERS)), ("task", BY_LEGS)],
    ids=str,
)
@pytest.mark.parametrize("plant", ["model", "fmu3"])
def test_a_linear_controller_is_its_recursion_over_the_record(form: str, names: tuple[str, ...], plant: str) -> None:
    """Expected: of the record's references, measurements and limits, plus feedforward and injection; on both plants.

    In task space y = ∑ J⁻¹ ΔL, r = y + J⁻¹ (L_r − L), Jᵀ times the excess, F = J⁻ᵀ w, J of the nominal platform and
    the reference.
    """
    n = sum(PLACES[name] for name in names)
    plain = system({"errors": n, "both": 2 * n}.get(form, 2 * n + 6))
    record = run_of(gs.LinearController(plain, names, "task" if form == "task" else "leg"), plant)
    wanted, measured = (
        np.hstack([at_samples(record, f"{kind}.{name}") for name in names]) for kind in ("reference", "measured")
    )
    J, excess = np.tile(np.eye(6), (len(wanted), 1, 1)), excesses(record)
    if form == "task":
        poses = (at_samples(record, "reference.position"), at_samples(record, "reference.orientation"))
        J = np.array([gs.leg_jacobian(UNEVEN, *pose) for pose in zip(*poses, strict=True)])
        moves = np.vstack([np.zeros(6), np.diff(measured, axis=0)])
        error = np.linalg.solve(J, (wanted - measured)[..., None])[..., 0]
        measured = np.cumsum(np.linalg.solve(J, moves[..., None])[..., 0], axis=0)
        wanted, excess = measured + error, np.einsum("nji,nj->ni", J, excess)
    inputs = wanted - measured if form == "errors" else np.hstack([wanted, measured])
    rest = inputs[0]
    if form in ("excess", "task"):
        inputs, rest = np.hstack([inputs, excess]), np.append(rest, np.zeros(6))
    forces, states = recursion(plain, inputs, rest)
    expected = np.linalg.solve(np.swapaxes(J, 1, 2), forces[..., None])[..., 0]
    expected = expected + at_samples(record, "controller.feedforward") + at_samples(record, "controller.injection")
    assert at_samples(record, "controller.force") == pytest.approx(expected, rel=1e-8, abs=1e-7)
    assert at_samples(record, "controller.state") == pytest.approx(states, rel=1e-8, abs=1e-9)
    assert np.abs(excesses(record)).max() > 1


def test_the_memory_at_rest_leaves_integrators_at_zero_in_any_coordinates() -> None:
    """Expected: a lag of gain 5 settled beside a double integrator at zero; coordinates mixed at random.

    Slow filters behind a PI are no integrators, though singular values take them for some: without an error no force.
    """
    rng = np.random.default_rng(6)
    A = np.array([[0.9, 0, 0], [0, 1, T], [0, 0, 1]])
    B, C = np.array([[0.5], [0.0], [T]]), np.array([[1.0, 1.0, 0.0]])
    mix = rng.normal(size=(3, 3))
    one = control.ss(mix @ A @ np.linalg.inv(mix), mix @ B, C @ np.linalg.inv(mix), 0, T)
    pi, slow = control.tf([1.2, -1.19], [1, -1], T), control.tf([1e-7], np.poly([0.999, 0.9989, 0.9988]), T)
    record, still = (
        run_of(control.append(*[one] * 6)),
        run_of(control.append(*[control.ss(pi * slow)] * 6), start={}, sensors={}),
    )
    first, at_rest = (
        each["controller.force"][0] - each["controller.feedforward"][0] - each["controller.injection"][0]
        for each in (record, still)
    )
    error = record["reference.leg_length"][0] - record["measured.leg_length"][0]
    assert np.abs(error).min() > 1e-5
    assert first == pytest.approx(5 * error, rel=1e-7)
    assert at_rest == pytest.approx(np.zeros(6), abs=1e-9)
    assert np.abs(still["controller.state"][0]).max() < 1e-9


def test_warnings_of_a_users_arithmetic_are_seen_in_a_run_and_not_in_an_ensemble() -> None:
    """Expected: NumPy's warning for one; of many members, whose numbers may be anything once they have ended, none."""

    def divides(sample: gs.Sample) -> FloatArray:
        return np.where(np.ones(6) / np.zeros(6) > 0, 30.0 + 0 * sample.measured["leg_length"], 0.0)

    with pytest.warns(RuntimeWarning, match="divide by zero"):
        run_of(divides)
    ensemble = {"members": 2, "platform_mass": {"normal": "1 kg"}}
    found = gs.ensemble(experiment_of("pd", **TABLES, ensemble=ensemble), controller=divides, workers=1)
    assert found.members["outcome"].to_list() == ["completed"] * 2
