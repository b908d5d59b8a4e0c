"""Units: numbers in SI units, or strings with a unit, "20 mm", for files of platforms and of experiments.

This small table replaces a units library: those treat Hz and rad/s as the same unit, and would read 31 rad/s as 31 Hz.
"""

import math
import re
from typing import Any

import numpy as np

from gough_stewart.model.vectors import real_array

# Each unit in the SI unit that heads its row.
UNITS: dict[str, dict[str, float]] = {
    "m": {"m": 1, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9},
    "rad": {"rad": 1, "mrad": 1e-3, "urad": 1e-6, "µrad": 1e-6, "deg": math.pi / 180, "°": math.pi / 180},
    "s": {"s": 1, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60},
    "Hz": {"Hz": 1, "kHz": 1e3, "rad/s": 1 / (2 * math.pi), "rpm": 1 / 60},
    "m/s": {"m/s": 1, "mm/s": 1e-3, "um/s": 1e-6, "µm/s": 1e-6},
    "rad/s": {"rad/s": 1, "mrad/s": 1e-3, "urad/s": 1e-6, "µrad/s": 1e-6, "deg/s": math.pi / 180},
    "N": {"N": 1, "kN": 1e3},
    "N/s": {"N/s": 1, "kN/s": 1e3},
    "N.m": {"N.m": 1, "N m": 1, "Nm": 1, "kN.m": 1e3},
    "N/m": {"N/m": 1, "kN/m": 1e3, "N/mm": 1e3, "N/um": 1e6, "N/µm": 1e6},
    "N.m/rad": {"N.m/rad": 1, "N m/rad": 1, "kN.m/rad": 1e3},
    "N.s/m": {"N.s/m": 1, "N s/m": 1, "kN.s/m": 1e3},
    "1": {"1": 1, "%": 1e-2},
    "N/(m.s)": {"N/(m.s)": 1, "N/(m s)": 1, "kN/(m.s)": 1e3},
    "kg": {"kg": 1, "g": 1e-3, "t": 1e3},
    "kg.m2": {"kg.m2": 1, "kg m2": 1, "kg.mm2": 1e-6, "kg mm2": 1e-6, "g.mm2": 1e-9, "g mm2": 1e-9},
    "m/s2": {"m/s2": 1},
    "W": {"W": 1, "mW": 1e-3, "uW": 1e-6, "µW": 1e-6, "kW": 1e3},
    "J": {"J": 1, "uJ": 1e-6, "µJ": 1e-6, "kJ": 1e3},
}

# The unit of plain numbers, never written out.
PLAIN = ""
LARGEST = 1e12
# A number and its unit, with or without a space between them.
_QUANTITY = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)")
# Keyboards and other programs write the Greek letter for the micro sign.
_TYPED = str.maketrans("·²³\N{GREEK SMALL LETTER MU}", ".23\N{MICRO SIGN}")


def unit_typed(text: str) -> str:
    """The unit of `UNITS` that a person wrote: the inverse of `interface.unit_text`."""
    return text.strip().translate(_TYPED)


def number(value: object, unit: str) -> float:
    """A quantity as a number in SI units; `ValueError` unless it is finite, or a string with a unit of this kind."""
    if type(value) is float and abs(value) <= LARGEST:  # of many members most are, and the checks below are slow
        return value
    expected, is_plain = "expected a number", unit == PLAIN
    if not is_plain:
        expected += f" of {unit}, or a string with one of the units {', '.join(UNITS[unit])}"
    if isinstance(value, str) and not is_plain:
        parts = _QUANTITY.fullmatch(value.strip())
        typed = "" if parts is None else unit_typed(parts[2])
        if parts is None or typed not in UNITS[unit]:
            raise ValueError(f"{expected}; found the unit '{typed}'" if typed else expected)
        size = float(parts[1]) * UNITS[unit][typed]
    else:
        try:
            size = float(real_array(value, ()))
        except ValueError:
            raise ValueError(expected) from None
    if not (is_plain or abs(size) <= LARGEST):  # NaN, or so large that its square and cube would overflow
        raise ValueError(f"expected a number of at most {LARGEST:g} in SI units")
    return size


def in_si(name: str, value: Any, unit: str) -> Any:
    """A value with texts in it, "20 mm", as numbers in SI units; `ValueError` with the name for other kinds."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [in_si(name, element, unit) for element in value]
    if not isinstance(value, str):
        return value
    try:
        return number(value, unit)
    except ValueError as error:
        raise ValueError(f"{name} is {value!r}; {error}") from None
