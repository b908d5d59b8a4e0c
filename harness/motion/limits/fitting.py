"""How much slower or smaller a motion has to be to stay within the limits of a platform."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.motion.limits.shares import shares_along
from gough_stewart.harness.motion.motion import Motion, motion_of, slower, smaller
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# Share of the limit that a fitted motion uses: below 1 by more than rounding, but not visibly.
_FULL = 1 - 1e-7
_FIRST, _LAST = 1.1, 1e6
_TOLERANCE = 1e-12
_MOST = 700.0  # larger than the logarithm of any share
# Rows that a factor is first found with: the highest local maxima, these rows about each, and some all over the motion.
_PEAKS, _NEAR, _SPREAD = 50, 3, 500


def factor_that_fits(share: Callable[[float], float]) -> float | None:
    """The factor x >= 1 that brings the largest share of all limits down to 1; 1 if it is there already.

    The factor grows until it fits, at most to a million. The root of log share over log x is then found between that
    factor and the last one that does not fit, with the exact share at every step.

    Parameters
    ----------
    share
        Largest share at a factor; infinite if a limit cannot be evaluated.

    Returns
    -------
    float or None
        None if no factor fits.
    """
    if share(1.0) <= 1:
        return 1.0
    low, high = 1.0, _FIRST
    while share(high) > _FULL:
        if high >= _LAST:
            return None
        low, high = high, min(high * high, _LAST)
    return _root(share, low, high)


def factor_near(share: Callable[[float], float], guess: float) -> float:
    """As `factor_that_fits`, from a good initial guess."""
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
    """The factor at which the share comes down to 1, between one that does not fit and one that does; it fits."""

    def excess(exponent: float) -> float:
        largest = share(math.exp(exponent))
        return min(math.log(largest / _FULL), _MOST) if largest > 0 else -_MOST

    from scipy.optimize import brentq  # half a second of imports, needed for motions that do not fit

    factor = math.exp(brentq(excess, math.log(low), math.log(high), xtol=_TOLERANCE))
    # if a share jumps, the root may be on its wrong side
    return factor if share(factor) <= 1 else high


def slowing_that_fits(
    platform: Platform, motion: Motion, largest_condition_number: float, total: FloatArray | None = None
) -> float | None:
    """The time scale that a motion needs, with the whole motion checked at the end; None if none fits.

    Parameters
    ----------
    total
        The largest share of all limits in each of its rows (n,), if it is known.
    """
    return _scale_that_fits(platform, motion, slower, largest_condition_number, total)


def shrinking_that_fits(
    platform: Platform,
    motion: Motion,
    centre: FloatArray,
    largest_condition_number: float,
    total: FloatArray | None = None,
) -> float | None:
    """The amplitude scale that a motion may have about a pose (6,), with all of it checked; None if none fits.

    `total` as of `slowing_that_fits`.
    """

    def scaled(rows: Motion, factor: float) -> Motion:
        return smaller(rows, 1 / factor, centre)

    factor = _scale_that_fits(platform, motion, scaled, largest_condition_number, total)
    return None if factor is None else 1 / factor


def _scale_that_fits(
    platform: Platform,
    motion: Motion,
    scaled: Callable[[Motion, float], Motion],
    largest_condition_number: float,
    total: FloatArray | None,
) -> float | None:
    """The factor of `factor_that_fits`, found with the rows that decide it, and held against all of them.

    Fewer rows have no larger share: if no factor fits them, none fits all, and if that which fits them fits all, it is
    the one. Else the rows that are beyond their limits at it join them.
    """

    def shares(rows: Motion, factor: float) -> FloatArray:
        n = np.zeros(len(rows.position))
        return shares_along(platform, n, scaled(rows, factor), largest_condition_number).total

    total = shares(motion, 1.0) if total is None else total
    if total.max(initial=0.0) <= 1:
        return 1.0
    decides = _around_peaks(total)
    while True:
        rows = Motion(*(part[decides] for part in motion))

        def share(factor: float, rows: Motion = rows) -> float:
            return float(shares(rows, factor).max())

        # the share at rest in its poses does not depend on speed
        factor = factor_that_fits(share) if share(math.inf) <= 1 else None
        if factor is None or decides.all():
            return factor
        beyond = shares(motion, factor)
        if beyond.max() <= 1:
            return factor
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


def remedy(platform: Platform, motion: Motion, centre: FloatArray, largest_condition_number: float) -> str:
    """The remedy for a motion that exceeds a limit; factors are rounded to the safe side."""
    slow = slowing_that_fits(platform, motion, largest_condition_number)
    small = shrinking_that_fits(platform, motion, centre, largest_condition_number)
    ways = [] if slow is None else [f"{_rounded(slow, math.ceil)} times as long (reference.time_scale)"]
    ways += [] if small is None else [f"{_rounded(small, math.floor)} times as large (reference.amplitude_scale)"]
    if not ways:
        none = np.zeros((1, 6))
        rest = motion_of(centre + none, none, none)
        largest = shares_along(platform, np.zeros(1), rest, largest_condition_number).largest
        return (
            "neither slower nor smaller helps: at rest in the pose that it is about, "
            f"{largest.limit.replace('_', ' ')} is already at {100 * largest.share:.4g} %; move the motion elsewhere"
        )
    return f"it would fit if it were {' or '.join(ways)}"


def _rounded(factor: float, to: Callable[[float], int]) -> str:
    unit = 10.0 ** (math.floor(math.log10(factor)) - 2)
    return f"{to(factor / unit) * unit:.3g}"
