"""One communication step by error-controlled integration, Dormand–Prince 8(5,3) of SciPy."""

from collections.abc import Callable

import numpy as np
from scipy.integrate import DOP853

from gough_stewart.model.errors import StepError
from gough_stewart.model.vectors import FloatArray

# In one communication step: after ten to twenty seconds it has failed, rather than still being on its way.
MOST_INTERNAL_STEPS = 20_000


def integrate(
    derivatives: Callable[[FloatArray], FloatArray],
    x: FloatArray,
    span: tuple[float, float],
    tolerance: float,
    internal_step: float | None,
    check: Callable[[FloatArray, float], object],
) -> tuple[FloatArray, float]:
    """State at the end of a time span, and the internal step size to go on with.

    Parameters
    ----------
    derivatives
        ẋ of a state; a new array at every call.
    span
        Start and end [s].
    tolerance
        Relative, and absolute in SI units.
    internal_step
        Size to begin with [s], from the span before; None lets the integrator find one.
    check
        Called with state and time after every internal step; raises to end the integration.

    Raises
    ------
    StepError
        The tolerance cannot be held, or only with more than `MOST_INTERNAL_STEPS`.
    """
    start, end = span
    first = None if internal_step is None else min(internal_step, end - start)
    # A pole may be met at a trial step: infinities there are a rejected step, not a warning to the user.
    with np.errstate(all="ignore"):
        solver = DOP853(
            lambda _time, x: derivatives(x), start, x, end, rtol=tolerance, atol=tolerance, first_step=first
        )
        # where ẋ overflows SciPy finds no size to begin with, and would look for a smaller one for ever
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
                    "friction too sharp (leg_friction_velocity), or a step too long",
                )
            proposed = float(solver.h_abs)
            solver.step()
            if solver.status == "failed" or not np.isfinite(solver.y).all():
                raise _not_held(float(solver.h_abs), float(solver.t), tolerance)
            check(solver.y, float(solver.t))
    # The last step was cut to end on time: what it would have been carries over.
    return solver.y, max(proposed, float(solver.h_abs))


def _not_held(size: float, time: float, tolerance: float) -> StepError:
    return StepError(
        "internal step size",
        size,
        time,
        f"the tolerance {tolerance:g} cannot be held; forces too large, or nearly singular",
    )
