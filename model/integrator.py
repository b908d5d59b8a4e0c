"""Integration over one communication step: SciPy's Dormand–Prince 8(5,3) under error control, or fixed steps."""

from collections.abc import Callable

import numpy as np

from gough_stewart.model.errors import StepError
from gough_stewart.model.vectors import FloatArray

# In one communication step; reaching it takes ten to twenty seconds.
MOST_INTERNAL_STEPS = 20_000


def integrate(
    derivatives: Callable[[FloatArray], FloatArray],
    x: FloatArray,
    span: tuple[float, float],
    tolerance: float,
    internal_step: float | None,
    check: Callable[[FloatArray, float], object],
) -> tuple[FloatArray, float]:
    """State at the end of a time span, and the next internal step size.

    Parameters
    ----------
    derivatives
        ẋ for a state; returns a new array in every call.
    span
        Start and end [s].
    tolerance
        Relative tolerance, and absolute tolerance in SI units.
    internal_step
        First step size [s], from the previous span; None lets the integrator choose it.
    check
        Called with state and time after every internal step; raises to end the integration.

    Raises
    ------
    StepError
        The tolerance cannot be met, or needs more than `MOST_INTERNAL_STEPS`.
    """
    from scipy.integrate import DOP853  # a third of a second of imports, needed where steps are made one by one

    start, end = span
    first = None if internal_step is None else min(internal_step, end - start)
    # A trial step can reach a pole: infinities there mean a rejected step and need no warning.
    with np.errstate(all="ignore"):
        solver = DOP853(
            lambda _time, x: derivatives(x), start, x, end, rtol=tolerance, atol=tolerance, first_step=first
        )
        # if ẋ overflows, SciPy finds no first step size and would reduce it for ever
        if not solver.h_abs > 0:
            raise _not_held(float(solver.h_abs), float(solver.t), tolerance)
        proposed, steps = float(solver.h_abs), 0
        while solver.t < end:
            steps += 1
            if steps > MOST_INTERNAL_STEPS:
                raise StepError(
                    "internal steps",
                    steps,
                    float(solver.t),
                    f"too many for one step to time {end:g} s at tolerance {tolerance:g}; forces too large, "
                    "leg_friction_velocity too small, or step too long",
                )
            proposed = float(solver.h_abs)
            solver.step()
            if solver.status == "failed" or not np.isfinite(solver.y).all():
                raise _not_held(float(solver.h_abs), float(solver.t), tolerance)
            check(solver.y, float(solver.t))
    # The last step was shortened to end on time; its original size carries over.
    return solver.y, max(proposed, float(solver.h_abs))


def integrate_fixed(
    step: Callable[[FloatArray, float, float], FloatArray],
    x: FloatArray,
    span: tuple[float, float],
    size: float,
    check: Callable[[FloatArray, float], object],
) -> FloatArray:
    """State at the end of a time span after equal steps of at most `size` [s], the smallest number of them.

    Parameters
    ----------
    step
        The state after a step from x, of time and size [s].
    check
        As `integrate`'s.

    Raises
    ------
    StepError
        More than `MOST_INTERNAL_STEPS`, a state that is not finite, or as `step` and `check`.
    """
    start, end = span
    number = number_of_steps(span, size)
    if number > MOST_INTERNAL_STEPS:
        raise StepError(
            "fixed_step_size",
            size,
            start,
            f"takes {number} steps to time {end:g} s; expected at most {MOST_INTERNAL_STEPS}",
        )
    h = (end - start) / number
    time = start
    for k in range(1, number + 1):
        with np.errstate(all="ignore"):
            x = step(x, time, h)
        time = end if k == number else start + k * h
        if not np.isfinite(x).all():
            raise StepError(
                "fixed_step_size", size, time, "the motion is not finite; the step is too large, or the forces are"
            )
        check(x, time)
    return x


def number_of_steps(span: tuple[float, float], size: float) -> int:
    """Of equal steps of at most `size` [s] in a span, within the rounding of times of this magnitude."""
    start, end = span
    slack = 1e-6 + 2 * np.finfo(float).eps * abs(start) / size
    return max(1, int(np.ceil((end - start) / size - slack)))


def rk4_step(derivatives: Callable[[FloatArray], FloatArray], x: FloatArray, h: float) -> FloatArray:
    """State after a step h [s] of classical RK4; `derivatives` return a new array in every call."""
    k1 = derivatives(x)
    k2 = derivatives(x + h / 2 * k1)
    k3 = derivatives(x + h / 2 * k2)
    k4 = derivatives(x + h * k3)
    return np.asarray(x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))


def _not_held(size: float, time: float, tolerance: float) -> StepError:
    return StepError(
        "internal step size",
        size,
        time,
        f"the tolerance {tolerance:g} cannot be met; forces too large, or pose nearly singular",
    )
