"""Steps in time: their ends, and tolerances of the integration, the same for the stepping model and the FMU."""

import math

from gough_stewart.model.errors import StepError

DEFAULT_TOLERANCE = 1e-8
# Below this range rounding dominates the error estimate; above it the estimate is meaningless.
TOLERANCES = (1e-13, 1e-2)
# In one communication step.
MOST_INTERNAL_STEPS = 20_000


def end_of_step(time: float, step: float, current: float) -> float:
    """End of a step from `time`, which must be the model's time `current` within rounding; all in s.

    Raises
    ------
    StepError
        Another time, or a step that is not > 0 or too small to advance the time.
    """
    if not step > 0:
        raise StepError("step", step, current, "expected a communication step > 0 s")
    # the rounding error of a master's clock, but never a significant part of the step
    rounding = max(min(1e-9 * max(1.0, current), 1e-3 * step), 4 * math.ulp(current))
    if not abs(time - current) <= rounding:
        raise StepError("time", time, current, "expected the model's current time, since steps must be consecutive")
    end = time + step
    if not end > current:
        raise StepError("step", step, current, "too small to advance the time in double precision")
    return end
