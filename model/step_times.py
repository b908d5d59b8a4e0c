"""When a step may begin and where it ends."""

import numpy as np

from gough_stewart.model.errors import StepError


def end_of_step(time: float, step: float, present: float) -> float:
    """End of a step from `time`, which must be the `present` one of the model but for rounding; all in s.

    Raises
    ------
    StepError
        Another time, or a step that is not above 0 or too small to advance the time.
    """
    if not step > 0:
        raise StepError("step", step, present, "expected a communication step > 0 s")
    # rounding of a master's clock, but never a noticeable share of the step
    rounding = max(min(1e-9 * max(1.0, present), 1e-3 * step), 4 * float(np.spacing(present)))
    if not abs(time - present) <= rounding:
        raise StepError("time", time, present, "expected the model's present time; steps follow each other")
    end = time + step
    if not end > present:
        raise StepError("step", step, present, "too small to advance the time in double precision")
    return end
