"""What a motion asks of the legs: velocities, accelerations, forces and power, each evaluated when it is needed."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.motion.motion import Motion
from gough_stewart.model.dynamics import Acceleration, inverse_dynamics
from gough_stewart.model.kinematics import LegGeometry, leg_accelerations, rates_of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray


@dataclass(frozen=True, eq=False)
class LegLoads:
    """Of a motion at n times; each (n, 6)."""

    platform: Platform
    motion: Motion
    legs: LegGeometry
    # rows (n,) in which the legs can hold the pose; all rows by default
    regular: NDArray[np.bool_] | None = None

    @cached_property
    def velocity(self) -> FloatArray:
        """L̇ [m/s]."""
        return np.asarray(rates_of_legs(self.legs, State(*self.motion[:4])).length_rate)

    @cached_property
    def acceleration(self) -> FloatArray:
        """L̈ [m/s²]."""
        return leg_accelerations(self.legs, State(*self.motion[:4]), *self.motion[4:])

    @cached_property
    def force(self) -> FloatArray:
        """F [N] by inverse dynamics without load; 0 where the legs cannot hold the pose, which is refused elsewhere."""
        n = len(self.motion.position)
        regular = np.ones(n, dtype=bool) if self.regular is None else self.regular
        force = np.zeros((n, 6))
        if regular.any():
            rows = [part[regular] for part in self.motion]
            force[regular] = inverse_dynamics(self.platform, State(*rows[:4]), Acceleration(*rows[4:]))
        return force

    @cached_property
    def power(self) -> FloatArray:
        """F L̇ [W]."""
        return self.force * self.velocity
