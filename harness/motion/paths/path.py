"""A smooth path through poses: positions and rotation vectors as splines of one path parameter."""

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.harness.errors import MotionError
from gough_stewart.harness.motion.motion import Motion, polynomials_of_spline
from gough_stewart.model.rotations import angles_of, matrix_from_orientation, nearest_angle, orientation_from_matrix
from gough_stewart.model.vectors import Array, FloatArray, cross, dot, less, skew, where

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

# No curvature at the ends, so that the path between two poses is a straight line. For degree 3 this is the natural
# spline; that of degree 5 has zero third and fourth derivatives instead, and does not exist through two poses.
_DERIVATIVES_ZERO_AT_ENDS = {5: (2, 4), 3: (2,)}
DEGREES = {"quintic": 5, "cubic": 3}
# Share of the largest coordinate below which two poses are the same: rounding, 1e-16 of it, leaves the direction
# between poses that are farther apart certain to 1e-6 rad.
_SAME = 1e-9
# Angles [rad] below which the coefficients of the exponential are computed by series.
_SMALL_ANGLE = 1e-2


class PathPoint(NamedTuple):
    """Poses on a path and their derivatives with respect to its parameter s; each (n, 3)."""

    position: FloatArray  # [m]
    orientation: FloatArray  # roll, pitch, yaw [rad]
    tangent: FloatArray  # p' [m]
    turning: FloatArray  # τ: the angular velocity is τ ṡ, world components [rad]
    curvature: FloatArray  # p'' [m]
    turning_rate: FloatArray  # τ' [rad]

    def motion(self, rate: FloatArray, acceleration: FloatArray) -> Motion:
        """The motion with rates ṡ (n,) [1/s] and s̈ (n,) [1/s²]: v = p' ṡ, v̇ = p' s̈ + p'' ṡ²; likewise ω."""
        first, second = rate[:, None], acceleration[:, None]
        return Motion(
            self.position,
            self.orientation,
            self.tangent * first,
            self.turning * first,
            self.tangent * second + self.curvature * first**2,
            self.turning * second + self.turning_rate * first**2,
        )


@dataclass(frozen=True, eq=False)
class GeometricPath:
    """A path exactly through a list of poses, from s = 0 to 1.

    The pose at s is p(s) and R(s) = exp(ρ̃(s)) R₀, with R₀ the orientation of the first pose; p and ρ are splines of s.
    Roll, pitch and yaw are counted in the turns of the first pose.
    At both ends their second derivatives are zero, for degree 5 also the fourth.
    From pose to pose s grows with the distance √(|Δp|² + ℓ² |Δρ|²).
    """

    position: FloatArray  # of the via poses (n, 3) [m]
    orientation: FloatArray  # roll, pitch, yaw (n, 3) [rad]
    length: float  # ℓ, the length per angle [m]
    degree: int = 5
    at: FloatArray = field(init=False)  # s of the via poses (n,)
    _spline: "BSpline" = field(init=False, repr=False)
    _first: FloatArray = field(init=False, repr=False)  # R₀

    def __post_init__(self) -> None:
        n = len(self.position)
        if n < 2:
            raise MotionError(f"a path of {n} poses; expected at least 2")
        from scipy.interpolate import make_interp_spline
        from scipy.spatial.transform import Rotation

        rotation = matrix_from_orientation(self.orientation)
        rho = np.asarray(Rotation.from_matrix(rotation @ rotation[0].T).as_rotvec())
        jumps = np.flatnonzero(~(np.linalg.norm(np.diff(rho, axis=0), axis=1) < math.pi - 1e-6))
        if jumps.size:  # at half a turn rotation vectors jump
            k = int(jumps[0]) + 2
            raise MotionError(f"pose {k} of the path is rotated by half a turn or more from the first; expected less")
        steps = np.diff(np.hstack([self.position, self.length * rho]), axis=0)
        distance = np.sqrt((steps**2).sum(axis=1))
        near = distance <= _SAME * max(np.abs(self.position).max(), self.length)
        if near.any():
            k = int(near.argmax())
            apart = f"or {distance[k]:.2g} m apart"
            raise MotionError(f"poses {k + 1} and {k + 2} of the path are the same, {apart}; remove one")
        at = np.concatenate([[0.0], np.cumsum(distance)])
        at /= at[-1]
        ends: Any = [(k, np.zeros(6)) for k in _DERIVATIVES_ZERO_AT_ENDS[self.degree]]
        spline = make_interp_spline(at, np.hstack([self.position, rho]), k=self.degree, bc_type=(ends, ends))
        object.__setattr__(self, "at", at)
        object.__setattr__(self, "_spline", spline)
        object.__setattr__(self, "_first", rotation[0])

    def __call__(self, s: ArrayLike) -> PathPoint:
        """Poses and their derivatives at path parameters (n,) from 0 to 1."""
        s = np.asarray(s, dtype=float)
        return self.point(*(self._spline(s, k) for k in range(3)))

    def point(self, value: Array, first: Array, second: Array) -> PathPoint:
        """The poses of positions and rotation vectors (n, 6) and their derivatives; also of symbols.

        R = 1 + a ρ̃ + b ρ̃², a = sin θ/θ, b = (1 − cos θ)/θ², θ = |ρ|. The turning is τ = ρ' + b ρ × ρ' + c ρ × (ρ × ρ'),
        c = (θ − sin θ)/θ³, and τ' follows by the product rule; b' and c' are 2 ρ·ρ' times their derivatives by θ².
        """
        rho, rate, acceleration = (part[:, 3:] for part in (value, first, second))
        a, b, c, db, dc = (coefficient[:, None] for coefficient in _coefficients(rho))
        x = skew(rho)
        rotation = np.asarray(np.eye(3) + a[:, :, None] * x + b[:, :, None] * (x @ x)) @ self._first
        angles = angles_of(rotation) if rotation.dtype == object else orientation_from_matrix(rotation)
        growth = 2 * dot(rho, rate)[:, None]
        once = cross(rho, rate)
        twice = cross(rho, once)
        turning = rate + b * once + c * twice
        turning_rate = (
            acceleration
            + b * cross(rho, acceleration)
            + c * (cross(rate, once) + cross(rho, cross(rho, acceleration)))
            + growth * (db * once + dc * twice)
        )
        orientation = nearest_angle(angles, self.orientation[0])
        return PathPoint(value[:, :3], orientation, first[:, :3], turning, second[:, :3], turning_rate)

    @property
    def pieces(self) -> tuple[FloatArray, FloatArray]:
        """Positions and rotation vectors as polynomials: begins (m,), and coefficients (m, 6, k), highest first."""
        return polynomials_of_spline(self._spline)


def _coefficients(rho: FloatArray) -> tuple[FloatArray, ...]:
    """For θ² = |ρ|²: sin θ/θ, (1 − cos θ)/θ², (θ − sin θ)/θ³, and θ²-derivatives of the last two; each (n,)."""
    q = dot(rho, rho)
    is_small = less(q, _SMALL_ANGLE**2)
    safe = where(is_small, 1.0, q)
    theta = np.sqrt(safe)
    a, b, c = np.sin(theta) / theta, (1 - np.cos(theta)) / safe, (theta - np.sin(theta)) / (safe * theta)
    # db/dq = (a − 2 b)/(2 q), dc/dq = (b − 3 c)/(2 q)
    exact = (a, b, c, (a - 2 * b) / (2 * safe), (b - 3 * c) / (2 * safe))
    # Σ (−q)ⁿ/(2n + 1 + k)! to the fourth term, and the derivatives for k = 1 and 2
    series = [sum((-q) ** n / math.factorial(2 * n + 1 + k) for n in range(4)) for k in range(3)]
    series += [sum(-n * (-q) ** (n - 1) / math.factorial(2 * n + 1 + k) for n in range(1, 5)) for k in (1, 2)]
    return tuple(where(is_small, near, formula) for near, formula in zip(series, exact, strict=True))
