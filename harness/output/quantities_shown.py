"""Display resolution of each unit: smaller differences are rounding, and do not fill axes or table cells."""

import math

from gough_stewart.harness.quantities import UNITS

# The smallest relevant difference by unit, such as a micrometre or a ten-thousandth of a degree.
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


def least_span(unit: str, largest: float = 0.0) -> float:
    """The smallest relevant difference in a unit, for values up to a largest magnitude."""
    return max(LEAST_SPANS.get(unit, _LEAST_OF_OTHERS), _LEAST_SHARE * abs(largest))


def factor_to(unit: str) -> float:
    """The factor from SI units to a unit: 1e3 for mm, 1 for SI units."""
    if unit in UNITS:  # rad/s is the SI unit of a rate, but is also listed with Hz
        return 1.0
    return next((1 / others[unit] for others in UNITS.values() if unit in others), 1.0)


def widened(low: float, high: float, unit: str) -> tuple[float, float]:
    """Both ends of an axis, widened about their middle to at least `least_span`; NaN counts as 0."""
    if not (math.isfinite(low) and math.isfinite(high)):
        low = high = 0.0
    span = max(high - low, least_span(unit, max(abs(low), abs(high))))
    middle = low + (high - low) / 2
    return middle - span / 2, middle + span / 2
