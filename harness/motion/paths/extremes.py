"""The largest share of the limits of leg velocity, leg acceleration, force and power at any time of a motion.

Not only at rows: in each piece of a motion, leg velocity, leg acceleration, and force and power without Coulomb
friction are smooth, and polynomials through six points stand for them. A polynomial lies between its smallest and its
largest Bernstein coefficient; Coulomb friction increases with the velocity, so its range follows from that of the
velocity. Pieces whose bound is above all values found are halved until bound and values meet (branch and bound).
"""

from typing import NamedTuple

import numpy as np

from gough_stewart.harness.motion.motion import motion_of
from gough_stewart.harness.motion.paths.legs_along import DynamicLimits, dry_friction, without_dry_friction
from gough_stewart.harness.motion.paths.polynomials import Polynomials
from gough_stewart.model.dynamics import Acceleration, inverse_dynamics
from gough_stewart.model.kinematics import leg_accelerations, leg_geometry, rates_of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray

_DEGREE = 5
# Chebyshev–Lobatto points on 0 to 1
_NODES = (1 - np.cos(np.pi * np.arange(_DEGREE + 1) / _DEGREE)) / 2
_POWERS = np.arange(_DEGREE, -1, -1)
# The highest Chebyshev coefficient of the polynomial through the nodes: it stands for what is left out.
_HIGHEST = (-1.0) ** np.arange(_DEGREE + 1) * np.array([0.5, 1, 1, 1, 1, 0.5]) / _DEGREE
_FROM_NODES = np.linalg.inv(
    np.stack([(1 - _NODES) ** (_DEGREE - k) * _NODES**k * n for k, n in enumerate((1, 5, 10, 10, 5, 1))], axis=1)
)
# Bernstein coefficients of the left half, by de Casteljau; the right half is its mirror.
_LEFT = np.array(
    [
        [1, 0, 0, 0, 0, 0],
        [1 / 2, 1 / 2, 0, 0, 0, 0],
        [1 / 4, 2 / 4, 1 / 4, 0, 0, 0],
        [1 / 8, 3 / 8, 3 / 8, 1 / 8, 0, 0],
        [1 / 16, 4 / 16, 6 / 16, 4 / 16, 1 / 16, 0],
        [1 / 32, 5 / 32, 10 / 32, 10 / 32, 5 / 32, 1 / 32],
    ]
)
_HALVES = np.stack([_LEFT, _LEFT[::-1, ::-1]])
# The gap between bound and value, as a share of the limit, that is good enough, and the most halvings.
_GAP, _MOST_HALVINGS = 1e-9, 20


class _Smooth(NamedTuple):
    """What is smooth in a piece, as Bernstein coefficients (m, 6 legs, 6)."""

    velocity: FloatArray  # [m/s]
    acceleration: FloatArray  # [m/s²]
    force: FloatArray  # without Coulomb friction [N]
    power: FloatArray  # of that force [W]


class _Between(NamedTuple):
    """The range of a quantity in each piece; each (m, 6)."""

    low: FloatArray
    high: FloatArray

    @property
    def largest(self) -> FloatArray:
        """Of the absolute value."""
        return np.maximum(-self.low, self.high)


def largest_share(platform: Platform, motion: Polynomials, limits: DynamicLimits, enough: float = 1.0) -> float:
    """An upper bound of the largest share that a motion uses of the limits at any time.

    It exceeds the largest share, or `enough` if that is larger, by at most 1e-9, and by what polynomials of the fifth
    degree through six points of a piece leave out, which their highest coefficients tell: below 1e-9 for pieces of a
    few milliseconds.
    """
    smooth, left_out = _smooth_parts(platform, motion)
    bound, attained = 0.0, enough
    for _ in range(_MOST_HALVINGS):
        upper = _upper(platform, smooth, left_out, limits)
        attained = max(attained, *(_at_ends(platform, smooth, limits, end) for end in (0, -1)))
        unsure = upper > attained + _GAP
        bound = max(bound, float(upper[~unsure].max(initial=0.0)))
        if not unsure.any():
            return bound
        # both halves of every unsure piece (2 m, 6, 6)
        smooth = _Smooth(
            *(np.asarray(np.einsum("hij,mlj->mhli", _HALVES, part[unsure]).reshape(-1, 6, 6)) for part in smooth)
        )
        left_out = _Smooth(*(np.repeat(part[unsure], 2, axis=0) for part in left_out))
    return max(bound, float(_upper(platform, smooth, left_out, limits).max()))


def _smooth_parts(platform: Platform, motion: Polynomials) -> tuple[_Smooth, _Smooth]:
    """Bernstein coefficients in every piece, and what the polynomials leave out (m, 6, 1)."""
    begins, coefficients = motion.pieces
    h = np.diff(np.append(begins, motion.end))[:, None, None]
    scaled = coefficients * h**_POWERS  # in τ from 0 to 1
    with np.errstate(divide="ignore", invalid="ignore"):
        first = np.where(_POWERS >= 1, _POWERS * _NODES[:, None] ** np.maximum(_POWERS - 1, 0), 0.0)
        second = np.where(_POWERS >= 2, _POWERS * (_POWERS - 1) * _NODES[:, None] ** np.maximum(_POWERS - 2, 0), 0.0)
    value, rate, half = (
        (np.einsum("mcp,np->mnc", scaled, at) / h**k).reshape(-1, 6)
        for k, at in enumerate((_NODES[:, None] ** _POWERS, first, second))
    )
    at = motion_of(value, rate, half)
    state, accelerations = State(*at[:4]), at[4:]
    legs = leg_geometry(platform, at.position, at.orientation)
    velocity = np.asarray(rates_of_legs(legs, state).length_rate)
    force = np.asarray(inverse_dynamics(without_dry_friction(platform), state, Acceleration(*accelerations)))
    parts = (velocity, leg_accelerations(legs, state, *accelerations), force, force * velocity)
    at_nodes = [np.swapaxes(part.reshape(len(begins), len(_NODES), 6), 1, 2) for part in parts]
    return (
        _Smooth(*(part @ _FROM_NODES.T for part in at_nodes)),
        _Smooth(*(np.abs(part @ _HIGHEST)[:, :, None] for part in at_nodes)),
    )


def _upper(platform: Platform, smooth: _Smooth, left_out: _Smooth, limits: DynamicLimits) -> FloatArray:
    """An upper bound of the largest share over all limits and legs in each piece (m,)."""
    velocity, acceleration, force, power = (
        _Between((part - rest).min(axis=2), (part + rest).max(axis=2))
        for part, rest in zip(smooth, left_out, strict=True)
    )
    low, high = dry_friction(platform, velocity.low), dry_friction(platform, velocity.high)
    # friction times velocity is even, and grows with the speed
    slowest = np.where(velocity.low * velocity.high > 0, np.minimum(np.abs(velocity.low), np.abs(velocity.high)), 0.0)
    lost = [speed * dry_friction(platform, speed) for speed in (slowest, velocity.largest)]
    used = (
        velocity.largest,
        acceleration.largest,
        _Between(force.low + low, force.high + high).largest,
        _Between(power.low + lost[0], power.high + lost[1]).largest,
    )
    return np.asarray(np.max([part / limit for part, limit in zip(used, limits, strict=True)], axis=(0, 2)))


def _at_ends(platform: Platform, smooth: _Smooth, limits: DynamicLimits, end: int) -> float:
    """The largest share at one end of any piece: the first and the last Bernstein coefficients are values."""
    velocity, acceleration, force, power = (part[:, :, end] for part in smooth)
    friction = dry_friction(platform, velocity)
    used = (velocity, acceleration, force + friction, power + friction * velocity)
    return float(max(np.abs(part / limit).max() for part, limit in zip(used, limits, strict=True)))
