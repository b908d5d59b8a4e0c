"""Error-controlled integration over one communication step with SciPy's Dormand–Prince 8(5,3)."""

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


def _not_held(size: float, time: float, tolerance: float) -> StepError:
    return StepError(
        "internal step size",
        size,
        time,
        f"the tolerance {tolerance:g} cannot be met; forces too large, or pose nearly singular",
    )
