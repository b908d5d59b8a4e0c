"""A path with a time law: a motion from rest to rest."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.harness.motion.motion import Motion
from gough_stewart.harness.motion.path import GeometricPath
from gough_stewart.harness.motion.scaling import smaller
from gough_stewart.harness.motion.time_law import TimeLaw
from gough_stewart.model.vectors import FloatArray


@dataclass(frozen=True, eq=False)
class TimedPath:
    """The poses of a path at s(t − start): at rest in the first pose before, in the last pose after."""

    path: GeometricPath
    law: TimeLaw
    start: float = 0.0  # [s]
    amplitude: float = 1.0  # of the deviations from the first pose

    def __call__(self, time: ArrayLike) -> Motion:
        """The motion at times (n,) [s]."""
        return self.since_start(np.asarray(time, dtype=float) - self.start)

    @property
    def end(self) -> float:
        """The time at which the last pose is reached [s]."""
        return self.start + self.law.duration

    def since_start(self, time: FloatArray) -> Motion:
        """The motion at times (n,) [s] of the time law."""
        at = self.law(time)
        motion = self.path(at.value).motion(at.rate, at.acceleration)
        if self.amplitude == 1:
            return motion
        return smaller(motion, self.amplitude, np.concatenate([self.path.position[0], self.path.orientation[0]]))
