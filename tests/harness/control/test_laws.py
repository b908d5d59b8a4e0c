"""Controllers at work, against their recursions written out with loops; every number is another one."""

from collections.abc import Iterator
from typing import Any

import control
import numpy as np
import pytest

from gough_stewart.harness.control.laws import LinearController, controller_of
from gough_stewart.harness.control.makers import Sample
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.plants import signals
from gough_stewart.model.vectors import FloatArray
from tests.support.laws import OneLaw, law_of

T = 0.02
LENGTHS = slice(12, 18)
PLACES = {"leg_length": range(12, 18), "leg_velocity": range(18, 24), "position": range(3), "orientation": range(3, 6)}
NO_JACOBIANS = np.zeros((0, 6, 6))


def system(inputs: int, seed: int, states: int = 4) -> Any:
    """Some stable system of six outputs in which everything depends on everything."""
    rng = np.random.default_rng(seed)
    A = rng.uniform(-0.2, 0.2, (states, states))
    return control.ss(A, *(rng.normal(size=s) for s in ((states, inputs), (6, states), (6, inputs))), T)


def run(law: OneLaw, wanted: FloatArray, measured: FloatArray, excess: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Forces, and the state before each."""
    forces, states = [], []
    for k, (r, y, cut) in enumerate(zip(wanted, measured, excess, strict=True)):
        states.append(law.state)
        forces.append(law.force(k, k * T, r, y, cut))
    return np.array(forces), np.array(states)


def recursion(plain: Any, inputs: Iterator[list[float]], excess: bool) -> tuple[FloatArray, FloatArray]:
    """x⁺ = A x + B u and w = C x + D u, element by element, from the x that stays under the first u without excess."""
    A, B, C, D = (np.asarray(part).tolist() for part in (plain.A, plain.B, plain.C, plain.D))
    n, outputs, states, x = len(A), [], [], None
    for u in inputs:
        if x is None:
            rest = [*u[:-6], *[0.0] * 6] if excess else u
            x = np.linalg.solve(np.eye(n) - plain.A, plain.B @ rest).tolist()
        states.append(x)
        outputs.append([sum(c * v for c, v in zip([*C[i], *D[i]], [*x, *u], strict=True)) for i in range(6)])
        x = [sum(a * v for a, v in zip([*A[i], *B[i]], [*x, *u], strict=True)) for i in range(n)]
    return np.array(outputs), np.array(states)


def signals_at(rng: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """References (n, 30), measurements (n, 24), excess (n, 6); angles within half a turn of each other."""
    wanted, measured = rng.normal(size=(n, 30)), rng.normal(size=(n, signals.SIZE))
    for each in (wanted, measured):
        each[:, PLACES["orientation"]] *= 0.5
    return wanted, measured, 10 * rng.normal(size=(n, 6))


@pytest.mark.parametrize("names", [("leg_length",), ("leg_velocity", "position"), ("position", "orientation")])
@pytest.mark.parametrize("form", ["errors", "both", "excess"])
def test_in_leg_space_it_is_its_recursion(form: str, names: tuple[str, ...]) -> None:
    """Expected: on errors; on references and measurements; and on the excess; signals as they are named."""
    chosen = [k for name in names for k in PLACES[name]]
    plain = system({"errors": 1, "both": 2, "excess": 2}[form] * len(chosen) + 6 * (form == "excess"), seed=3)
    wanted, measured, excess = signals_at(np.random.default_rng(4), 7)
    law = law_of(LinearController(plain, names), T, NO_JACOBIANS, wanted[0], measured[0])
    assert law.used == names

    def inputs() -> Iterator[list[float]]:
        for r, y, cut in zip(wanted.tolist(), measured.tolist(), excess.tolist(), strict=True):
            if form == "errors":
                yield [r[k] - y[k] for k in chosen]
            else:
                yield [r[k] for k in chosen] + [y[k] for k in chosen] + (cut if form == "excess" else [])

    forces, states = run(law, wanted, measured, excess)
    expected, expected_states = recursion(plain, inputs(), form == "excess")
    assert forces == pytest.approx(expected, rel=1e-10)
    assert states == pytest.approx(expected_states, rel=1e-9)


@pytest.mark.parametrize("form", ["errors", "both", "excess"])
def test_in_task_space_it_is_its_recursion_through_the_jacobian_of_each_sample(form: str) -> None:
    """Expected: y = Σ J⁻¹ ΔL, r = y + J⁻¹ (L_r − L), the excess as the wrench Jᵀ ΔF, and F with Jᵀ F = w.

    Six Jacobians, none symmetric; the first excess is what a limit cut off before the first sample.
    """
    rng = np.random.default_rng(5)
    J = rng.normal(size=(7, 6, 6)) + 3 * np.eye(6)
    plain = system({"errors": 6, "both": 12, "excess": 18}[form], seed=6)
    wanted, measured, excess = signals_at(rng, 7)
    law = law_of(LinearController(plain, space="task"), T, J, wanted[0], measured[0])

    def inputs() -> Iterator[list[float]]:
        pose, before = np.zeros(6), measured[0, LENGTHS]
        for k in range(7):
            length = measured[k, LENGTHS]
            pose = pose + np.linalg.solve(J[k], length - before)
            error = np.linalg.solve(J[k], wanted[k, LENGTHS] - length)
            wrench = [sum(J[k, leg, axis] * excess[k, leg] for leg in range(6)) for axis in range(6)]
            before = length
            if form == "errors":
                yield error.tolist()
            else:
                yield [*(pose + error), *pose, *(wrench if form == "excess" else [])]

    forces, states = run(law, wanted, measured, excess)
    wrenches, expected_states = recursion(plain, inputs(), form == "excess")
    assert np.einsum("kla,kl->ka", J, forces) == pytest.approx(wrenches, rel=1e-8, abs=1e-9)
    assert states == pytest.approx(expected_states, rel=1e-8, abs=1e-9)


def test_anti_windup_in_task_space_stops_what_a_limited_leg_cannot_do() -> None:
    """Expected: six integrators with back-calculation come to rest where legs at their limits leave the wrench.

    With x⁺ = x + T (ki e + (w_limited − w)/Tt) of w = x they rest at w − w_limited = Tt ki e, axis by axis.
    """
    rng = np.random.default_rng(8)
    J = rng.normal(size=(6, 6)) + 3 * np.eye(6)
    ki, tracking, limit = np.array([3.0, 5.0, 2.0, 7.0, 4.0, 6.0]), 0.2, 2.0
    feed = np.hstack([T * np.diag(ki), -T * np.diag(ki), T / tracking * np.eye(6)])
    integrators = control.ss(np.eye(6), feed, np.eye(6), np.zeros((6, 18)), T)
    wanted, measured = np.zeros(30), np.zeros(signals.SIZE)
    wanted[LENGTHS] = J @ (error := np.array([0.9, -1.2, 0.7, 1.1, -0.8, 1.0]))
    law = law_of(LinearController(integrators, space="task"), T, np.tile(J, (2000, 1, 1)), wanted, measured)
    excess = np.zeros(6)
    for k in range(2000):
        force = law.force(k, k * T, wanted, measured, excess)
        excess = np.clip(force, -limit, limit) - force
    assert (excess != 0).all()
    assert J.T @ -excess == pytest.approx(tracking * ki * error, rel=1e-6)


def test_a_function_gets_numbers_and_gives_forces() -> None:
    """Expected: whole numbers and lists become floats; the law looks at all signals and has no memory."""
    law = law_of(controller_of(lambda _sample: [1, 2, 3, 4, 5, -6]), T, NO_JACOBIANS, np.zeros(30), np.zeros(24))
    force = law.force(0, 0.0, np.zeros(30), np.zeros(24), np.zeros(6))
    assert force.dtype == float
    assert force.tolist() == [1, 2, 3, 4, 5, -6]
    assert law.used == signals.NAMES
    assert law.state.shape == (0,)


def ends_it(_sample: Sample) -> None:
    raise SystemExit(3)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda _sample: None, "returned None at time 0.06 s; expected 6 forces"),
        (lambda _sample: 3.0, "returned 3.0"),
        (lambda _sample: [1, 2, 3], r"returned \[1, 2, 3\]"),
        (lambda _sample: ["1"] * 6, "expected 6 forces"),
        (lambda _sample: np.zeros(6) + 1j, "expected 6 forces"),
        (lambda _sample: [True] * 6, "expected 6 forces"),
        (lambda _sample: [[1], [2, 3]], "expected 6 forces"),
        (lambda _sample: np.zeros((6, 1)), "expected 6 forces"),
        (lambda sample: sample.measured["leg_lenght"], "failed at time 0.06 s with KeyError: 'leg_lenght'"),
        (ends_it, "failed at time 0.06 s with SystemExit: 3"),
    ],
)
def test_a_function_that_gives_no_six_forces_is_an_error(function: Any, message: str) -> None:
    law = law_of(controller_of(function), T, NO_JACOBIANS, np.zeros(30), np.zeros(24))
    with pytest.raises(ControllerError, match=message):
        law.force(3, 0.06, np.zeros(30), np.zeros(24), np.zeros(6))
