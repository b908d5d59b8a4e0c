"""How finely each unit is shown: what is less is rounding, and neither fills an axis nor a cell of a table."""

import math

from gough_stewart.harness.quantities import UNITS

# By unit, the smallest difference worth looking at, in that unit: a micrometre, a ten-thousandth of a degree.
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
# Of numbers without a unit of their own, such as the states of a controller.
_LEAST_OF_OTHERS = 1e-6
# Of the values themselves; single precision, in which curves are kept, has little more.
_LEAST_SHARE = 1e-6


def least_span(unit: str, largest: float = 0.0) -> float:
    """The smallest difference worth looking at in a unit, among values up to a largest magnitude."""
    return max(LEAST_SPANS.get(unit, _LEAST_OF_OTHERS), _LEAST_SHARE * abs(largest))


def factor_to(unit: str) -> float:
    """What a number in SI units is multiplied by to be in a unit, 1e3 for mm; 1 where the unit is SI's own."""
    if unit in UNITS:  # rad/s is the unit of a rate, and in the row of Hz as well
        return 1.0
    return next((1 / others[unit] for others in UNITS.values() if unit in others), 1.0)


def widened(low: float, high: float, unit: str) -> tuple[float, float]:
    """Both ends of an axis, moved apart about their middle to `least_span` where they are closer; NaN counts as 0."""
    if not (math.isfinite(low) and math.isfinite(high)):
        low = high = 0.0
    span = max(high - low, least_span(unit, max(abs(low), abs(high))))
    middle = low + (high - low) / 2
    return middle - span / 2, middle + span / 2
