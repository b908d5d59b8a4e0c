"""Leg motion of a reference, whether the platform can reach it, and how much slower or smaller it would fit."""

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.errors import ReachError
from gough_stewart.harness.motion.limits.shares import GEOMETRIC, WORST_CONDITION_NUMBER, shares_along
from gough_stewart.harness.motion.motion import Motion, distinct_rows, motion_of, slower, smaller
from gough_stewart.model.interface import State
from gough_stewart.model.kinematics import leg_geometry, rates_of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

WhenBeyond = Literal["refuse", "warn"]
# Share of the limit that a fitted motion uses: below 1 by more than rounding, but not visibly.
_FULL = 1 - 1e-7
_FIRST, _LAST = 1.1, 1e6
_TOLERANCE = 1e-12
_MOST = 700.0  # larger than the logarithm of any share
# Rows that a factor is first found with: the highest local maxima, these rows about each, and some all over the motion.
_PEAKS, _NEAR, _SPREAD = 50, 3, 500


class LegMotion(NamedTuple):
    """A motion of the legs at n times; each (n, 6)."""

    leg_length: FloatArray  # [m]
    leg_velocity: FloatArray  # [m/s]


def legs_of(platform: Platform, motion: Motion) -> LegMotion:
    """Leg lengths and velocities of a motion, by inverse kinematics."""
    rows, of_row = distinct_rows(motion)
    legs = leg_geometry(platform, rows.position, rows.orientation)
    rates = rates_of_legs(legs, State(*rows[:4]))
    return LegMotion(np.asarray(legs.length)[of_row], np.asarray(rates.length_rate)[of_row])


def check_reach(
    platform: Platform,
    time: FloatArray,  # of the motion's rows (n,) [s]
    motion: Motion,
    largest_condition_number: float = WORST_CONDITION_NUMBER,
    *,
    centre: FloatArray | None = None,  # pose (6,) about which a smaller motion is scaled; by default the first row's
    dynamic: WhenBeyond = "refuse",  # or accept what exceeds limits of velocity, acceleration, force or power
    geometric: WhenBeyond = "refuse",  # or what exceeds the stroke, or comes near a singular pose
) -> list[str]:
    """Refuse a motion that exceeds a limit of the platform or comes near a singular pose; see `shares_along`.

    A `ReachError` has the first time at which a limit is exceeded, the quantity, its value, the leg, and how much
    slower or smaller the motion has to be. Gives a warning for each limit that is exceeded and accepted.
    """
    shares = shares_along(platform, time, motion, largest_condition_number)
    exceeded = [limited for limited in shares.limited if not limited.within.all()]
    beyond = [limited.first_beyond for limited in exceeded]
    texts = [f"at time {time[first.row]:.6g} s {first.text}" for first in beyond]
    refused = [k for k, limited in enumerate(exceeded)
               if (geometric if limited.limit in GEOMETRIC else dynamic) == "refuse"]  # fmt: skip
    if not refused:
        return [f"the reference exceeds a limit: {text}" for text in texts]
    k = min(refused, key=lambda k: beyond[k].row)
    about = np.concatenate([motion.position[0], motion.orientation[0]]) if centre is None else centre

    # the remedy, with factors rounded to the safe side
    ways = []
    scales: list[tuple[FloatArray | None, Callable[[float], int], str]] = [
        (None, math.ceil, "times as long (reference.time_scale)"),
        (about, math.floor, "times as large (reference.amplitude_scale)"),
    ]
    for scaled_about, to, words in scales:
        factor = scale_that_fits(platform, motion, scaled_about, largest_condition_number)
        if factor is not None:
            unit = 10.0 ** (math.floor(math.log10(factor)) - 2)
            ways.append(f"{to(factor / unit) * unit:.3g} {words}")
    helps = f"it would fit if it were {' or '.join(ways)}"
    if not ways:
        none = np.zeros((1, 6))
        at_rest = motion_of(about + none, none, none)
        largest = shares_along(platform, np.zeros(1), at_rest, largest_condition_number).largest
        helps = (
            "neither slower nor smaller helps: at rest in the pose that it is about, "
            f"{largest.limit.replace('_', ' ')} is already at {100 * largest.share:.4g} %; move the motion elsewhere"
        )
    raise ReachError(
        f"the reference cannot be reached: {texts[k]}; {helps}",
        float(time[beyond[k].row]),
        exceeded[k].quantity,
        beyond[k].value,
        beyond[k].leg,
    )


def scale_that_fits(
    platform: Platform,
    motion: Motion,
    centre: FloatArray | None,
    largest_condition_number: float,
    total: FloatArray | None = None,
) -> float | None:
    """The time scale that a motion needs, or about a centre (6,) the amplitude scale that it may have; None if none.

    Found with the rows that decide it, and held against all of them: fewer rows have no larger share. If no factor fits
    them, none fits all, and if that which fits them fits all, it is the one; else the rows that are beyond their limits
    at it join them. `total` is the largest share of all limits in each row (n,), if it is known.
    """

    def shares(rows: Motion, factor: float) -> FloatArray:
        scaled = slower(rows, factor) if centre is None else smaller(rows, 1 / factor, centre)
        return shares_along(platform, np.zeros(len(rows.position)), scaled, largest_condition_number).total

    total = shares(motion, 1.0) if total is None else total
    if total.max(initial=0.0) <= 1:
        return 1.0
    decides = _around_peaks(total)
    while True:
        rows = Motion(*(part[decides] for part in motion))

        def share(factor: float, rows: Motion = rows) -> float:
            return float(shares(rows, factor).max())

        # from 1 on it grows until it fits, at most to a million; at rest in its poses the share is that at any speed
        if share(math.inf) > 1:
            return None
        low, high = 1.0, _FIRST
        while share(high) > _FULL:
            if high >= _LAST:
                return None
            low, high = high, min(high * high, _LAST)
        factor = _root(share, low, high)
        beyond = np.zeros(1) if decides.all() else shares(motion, factor)
        if beyond.max() <= 1:
            return factor if centre is None else 1 / factor
        decides |= (beyond > 1) & (_around_peaks(beyond) | (beyond == beyond.max()))


def _around_peaks(total: FloatArray) -> NDArray[np.bool_]:
    """Rows (n,) near the highest of the local maxima of a share, and a few all over the motion."""
    n = len(total)
    inner = np.append(True, total[1:] >= total[:-1]) & np.append(total[:-1] >= total[1:], True)
    peaks = np.flatnonzero(inner)
    peaks = peaks[np.argsort(-total[peaks], kind="stable")[:_PEAKS]]
    chosen = np.zeros(n, dtype=bool)
    chosen[:: max(1, n // _SPREAD)] = True
    for shift in range(-_NEAR, _NEAR + 1):
        chosen[np.clip(peaks + shift, 0, n - 1)] = True
    return chosen


def factor_near(share: Callable[[float], float], guess: float) -> float:
    """The factor that brings the largest share of all limits down to 1, from a good initial guess."""
    low, high, width = guess, guess, 1e-5
    while share(high) > _FULL and width < 1:
        high *= 1 + width
        width *= 4
    width = 1e-5
    while share(low) <= _FULL and width < 1:
        low /= 1 + width
        width *= 4
    return _root(share, low, high)


def _root(share: Callable[[float], float], low: float, high: float) -> float:
    """The factor at which the share comes down to 1, between one that does not fit and one that does; it fits.

    The root of log share over log factor, with the exact share at every step, infinite where a limit has no value.
    """

    def excess(exponent: float) -> float:
        largest = share(math.exp(exponent))
        return min(math.log(largest / _FULL), _MOST) if largest > 0 else -_MOST

    from scipy.optimize import brentq  # half a second of imports, needed for motions that do not fit

    factor = math.exp(brentq(excess, math.log(low), math.log(high), xtol=_TOLERANCE))
    # if a share jumps, the root may be on its wrong side
    return factor if share(factor) <= 1 else high
