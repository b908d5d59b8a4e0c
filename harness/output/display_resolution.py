"""Resolution of display: smaller differences are rounding, and do not fill axes or table cells; points of a curve."""

import numpy as np

from gough_stewart.harness.quantities import UNITS
from gough_stewart.model.vectors import FloatArray

# The smallest difference that numbers tell, by unit, such as a micrometre or a ten-thousandth of a degree.
LEAST_SPANS: dict[str, float] = {
    "m": 1e-6,
    "mm": 1e-3,
    "rad": 1e-6,
    "mrad": 1e-3,
    "deg": 1e-4,
    "m/s": 1e-5,
    "mm/s": 1e-2,
    "rad/s": 1e-5,
    "deg/s": 1e-3,
    "m/s2": 1e-3,
    "rad/s2": 1e-3,
    "N": 1e-3,
    "N/s": 1e-1,
    "N.m": 1e-3,
    "W": 1e-3,
    "J": 1e-3,
    "kg": 1e-6,
    "kg.m2": 1e-6,
    "s": 1e-9,
    "Hz": 1e-6,
    "%": 1e-3,
    "1": 1e-3,
}
# The same for numbers without a unit, such as the states of a controller.
_LEAST_OF_OTHERS = 1e-6
# The same as a share of the values; single precision, in which curves are stored, has little more.
_LEAST_SHARE = 1e-6
# Axes show this share of it: an error of 1e-5 degrees has a shape, one of 1e-7 degrees is rounding.
_OF_AXES = 0.1


def least_span(unit: str, largest: float = 0.0, least: float | None = None) -> float:
    """The smallest span of an axis in a unit, for values up to a largest magnitude; `least` is that of numbers."""
    told = LEAST_SPANS.get(unit, _LEAST_OF_OTHERS) if least is None else least
    return max(_OF_AXES * told, _LEAST_SHARE * abs(largest))


def factor_to(unit: str) -> float:
    """The factor from SI units to a unit: 1e3 for mm, 1 for SI units."""
    if unit in UNITS:  # rad/s is the SI unit of a rate, but is also listed with Hz
        return 1.0
    return next((1 / units[unit] for units in UNITS.values() if unit in units), 1.0)


def decimated(time: FloatArray, values: FloatArray, points: int) -> tuple[FloatArray, FloatArray]:
    """Times and values (m,), m ≤ max(points, 4), that look the same in a figure as all (n,).

    The first and last row stay. The rows between are divided into buckets; of each, the smallest and the largest finite
    value stay at their times, so no peak is lost. Curves with few enough points are returned unchanged.
    """
    n = len(time)
    if n <= max(points, 4):
        return time, values
    inner = values[1:-1]
    buckets = max(1, (points - 2) // 2)
    width = -(-len(inner) // buckets)
    padding = (0, buckets * width - len(inner))
    finite = np.isfinite(inner)
    low = np.pad(np.where(finite, inner, np.inf), padding, constant_values=np.inf).reshape(buckets, width)
    high = np.pad(np.where(finite, inner, -np.inf), padding, constant_values=-np.inf).reshape(buckets, width)
    starts = 1 + width * np.arange(buckets)
    rows = np.concatenate([[0, n - 1], starts + low.argmin(axis=1), starts + high.argmax(axis=1)])
    # the last buckets may have only padding
    rows = np.unique(np.minimum(rows, n - 1))
    return time[rows], values[rows]
