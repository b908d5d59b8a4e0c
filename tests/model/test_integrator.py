"""The integration over one step, on equations with closed forms."""

import numpy as np
import pytest

from gough_stewart.model import integrator
from gough_stewart.model.errors import StepError
from gough_stewart.model.integrator import integrate, integrate_fixed, number_of_steps, rk4_step
from gough_stewart.model.vectors import FloatArray

START = np.array([1.0, 0.0, 0.5])


def rate(x: FloatArray) -> FloatArray:
    """An oscillator of 2 rad/s, and a decay at 3/s."""
    return np.array([2 * x[1], -2 * x[0], -3 * x[2]])


def solution(t: float) -> FloatArray:
    """From `START`."""
    return np.array([np.cos(2 * t), -np.sin(2 * t), 0.5 * np.exp(-3 * t)])


def nothing(_x: FloatArray, _t: float) -> None:
    """A check that is always passed."""


@pytest.mark.parametrize("tolerance", [1e-4, 1e-7, 1e-10])
def test_the_end_is_that_of_the_closed_form_within_the_tolerance(tolerance: float) -> None:
    """Expected: cos, −sin and exp; from 7.3 s, as the equations do not know the time."""
    x, _ = integrate(rate, START, (7.3, 9.1), tolerance, None, nothing)
    assert np.abs(x - solution(1.8)).max() < 10 * tolerance
    assert np.abs(x - solution(1.8)).max() > 1e-4 * tolerance  # a tighter one would be slower than was asked for


def test_every_internal_step_is_checked_with_its_state_and_time() -> None:
    """Expected: times that rise from the start to the end, and the closed form's state at each."""
    seen: list[tuple[FloatArray, float]] = []
    x, proposed = integrate(rate, START, (7.3, 9.1), 1e-9, None, lambda x, t: seen.append((x.copy(), t)))
    times = [t for _, t in seen]
    assert len(seen) > 3
    assert times == sorted(set(times))
    assert times[0] > 7.3
    assert times[-1] == 9.1
    assert all(np.abs(x - solution(t - 7.3)).max() < 1e-8 for x, t in seen)
    assert np.array_equal(seen[-1][0], x)
    # the size that carries over is that of a whole step, not of the shortened last one
    assert proposed > 0.5 * max(np.diff(times))


def test_the_first_internal_step_is_the_one_that_is_given_but_not_beyond_the_end() -> None:
    """Expected: one step where the span is shorter, and its size kept for the next span."""
    seen: list[float] = []

    def check(_x: FloatArray, t: float) -> None:
        seen.append(t)

    for span, given in ((0.01, 0.05), (0.4, 0.05)):
        seen.clear()
        _, proposed = integrate(rate, START, (2.0, 2.0 + span), 1e-6, given, check)
        assert seen[0] == pytest.approx(2.0 + min(span, given), abs=1e-15)
        assert proposed >= min(span, given)
    seen.clear()
    integrate(rate, START, (2.0, 2.4), 1e-6, None, check)
    assert abs(seen[0] - 2.05) > 1e-3


def test_a_check_that_raises_ends_the_integration() -> None:
    times: list[float] = []

    def check(_x: FloatArray, t: float) -> None:
        times.append(t)
        if t > 7.5:
            raise StepError("t", t, t, "far enough")

    with pytest.raises(StepError, match="far enough"):
        integrate(rate, START, (7.3, 20.0), 1e-9, None, check)
    assert times[-2] <= 7.5 < times[-1] < 9


def test_as_many_internal_steps_as_are_allowed_and_not_one_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the number of checks of a free run is enough; one less is refused where it ends, with the data."""
    times: list[float] = []
    integrate(rate, START, (7.3, 9.1), 1e-9, None, lambda _x, t: times.append(t))
    monkeypatch.setattr(integrator, "MOST_INTERNAL_STEPS", len(times))
    integrate(rate, START, (7.3, 9.1), 1e-9, None, nothing)
    monkeypatch.setattr(integrator, "MOST_INTERNAL_STEPS", len(times) - 1)
    with pytest.raises(StepError) as caught:
        integrate(rate, START, (7.3, 9.1), 1e-9, None, nothing)
    error = caught.value
    assert (error.quantity, error.value, error.time) == ("internal steps", len(times), times[-2])
    assert str(error).endswith(
        "too many for one step to time 9.1 s at tolerance 1e-09; forces too large, leg_friction_velocity too small, "
        "or step too long"
    )


@pytest.mark.parametrize("kind", ["pole", "nan", "overflow", "huge"])
def test_a_tolerance_that_cannot_be_met_is_told_with_size_and_time(kind: str) -> None:
    """Expected: x' = x² from 1 has its pole at 1 s; a rate that is not a number, or overflows, fails at the start.

    A constant rate of 1e306 has no error, and is infinite after 1500 s.
    """

    def wild(x: FloatArray) -> FloatArray:
        return {"pole": x**2, "nan": x * np.nan, "overflow": x * 1e308 * 1e10, "huge": np.full(3, 1e306)}[kind]

    with pytest.raises(StepError, match="the tolerance 1e-06 cannot be met; forces too large, or pose n") as caught:
        integrate(wild, np.ones(3), (7.3, 2007.3), 1e-6, {"nan": 1e-3, "huge": 1500.0}.get(kind), nothing)
    assert caught.value.quantity == "internal step size"
    if kind == "huge":
        assert caught.value.time == 1507.3
    else:
        assert not caught.value.value > 1e-3
        assert caught.value.time == pytest.approx(8.3 if kind == "pole" else 7.3, abs=1e-4)


def test_fixed_steps_are_equal_and_grow_as_the_exponential_series_of_rk4() -> None:
    """Closed form: ẋ = λ x has the factor 1 + z + z²/2 + z³/6 + z⁴/24 with z = λ h in each of ⌈0.5/0.13⌉ steps."""
    rates, seen = np.array([-3.0, 1.5]), list[float]()

    def step(x: FloatArray, _time: float, h: float) -> FloatArray:
        return rk4_step(lambda y: rates * y, x, h)

    start, check = np.array([1.0, 2.0]), lambda _x, time: seen.append(time)
    end = integrate_fixed(step, start, (2.0, 2.5), 0.13, check)
    z = rates * 0.125
    assert end == pytest.approx(start * (1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24) ** 4, rel=1e-14)
    assert seen == [2.125, 2.25, 2.375, 2.5]
    # the rounding of times makes no more steps
    assert number_of_steps((0.3, 0.3 + 3 * 0.1), 0.1) == 3
    assert number_of_steps((0.0, 0.31), 0.1) == 4


def test_fixed_steps_that_diverge_or_are_too_many_are_refused() -> None:
    """Expected: the size, the time, and how many are allowed."""
    with pytest.raises(StepError, match=r"^fixed_step_size = 0\.1 at time 0\.2 s: the motion is not finite"):
        integrate_fixed(
            lambda x, time, _h: x if time < 0.05 else x + np.inf, np.zeros(2), (0.0, 0.5), 0.1, lambda _x, _t: None
        )
    with pytest.raises(StepError, match=r"takes 30000 steps to time 0\.3 s; expected at most 20000$"):
        integrate_fixed(lambda x, _time, _h: x, np.zeros(2), (0.0, 0.3), 1e-5, lambda _x, _t: None)
