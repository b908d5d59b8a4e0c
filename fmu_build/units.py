"""Units of the interface in SI base units, and their display units."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Unit:
    """A unit as FMI describes it: exponents of base units; the factor is always 1."""

    name: str
    exponents: dict[str, int]
    # displayed value = factor · value
    display: tuple[str, float] | None = None


_DEGREES = float(np.rad2deg(1.0))
UNITS = (
    Unit("N", {"kg": 1, "m": 1, "s": -2}),
    Unit("N.m", {"kg": 1, "m": 2, "s": -2}),
    Unit("m", {"m": 1}, ("mm", 1e3)),
    Unit("rad", {"rad": 1}, ("deg", _DEGREES)),
    Unit("m/s", {"m": 1, "s": -1}, ("mm/s", 1e3)),
    Unit("rad/s", {"s": -1, "rad": 1}, ("deg/s", _DEGREES)),
    Unit("m/s2", {"m": 1, "s": -2}),
    Unit("rad/s2", {"s": -2, "rad": 1}, ("deg/s2", _DEGREES)),
    Unit("J", {"kg": 1, "m": 2, "s": -2}),
    Unit("kg", {"kg": 1}),
    Unit("kg.m2", {"kg": 1, "m": 2}),
    Unit("N.s/m", {"kg": 1, "s": -1}),
    Unit("s", {"s": 1}),
    Unit("N/m", {"kg": 1, "s": -2}),
    Unit("N/(m.s)", {"kg": 1, "s": -3}),
    Unit("1", {}),
    Unit("N/s", {"kg": 1, "m": 1, "s": -3}),
    Unit("Hz", {"s": -1}),
)
BY_NAME = {unit.name: unit for unit in UNITS}
