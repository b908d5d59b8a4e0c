"""Every unit, bound and message of quantities, from a table written for the test."""

from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from gough_stewart.harness import section
from gough_stewart.harness.section import Unit, annotation_in
from gough_stewart.model.interface import unit_text
from gough_stewart.model.units import PLAIN, UNITS, number, unit_typed

PI = 3.141592653589793
# Each unit as so many SI units, from the SI brochure: rad/s as a frequency are turns of 2π, rpm 60 to the minute.
MEANT = {
    "m": [("m", 1.0), ("cm", 0.01), ("mm", 0.001), ("um", 1e-6), ("µm", 1e-6), ("nm", 1e-9)],
    "rad": [("rad", 1.0), ("mrad", 0.001), ("urad", 1e-6), ("µrad", 1e-6), ("deg", PI / 180), ("°", PI / 180)],
    "s": [("s", 1.0), ("ms", 0.001), ("us", 1e-6), ("µs", 1e-6), ("ns", 1e-9), ("min", 60.0)],
    "Hz": [("Hz", 1.0), ("kHz", 1000.0), ("rad/s", 0.5 / PI), ("rpm", 1 / 60)],
    "m/s": [("m/s", 1.0), ("mm/s", 0.001), ("um/s", 1e-6), ("µm/s", 1e-6)],
    "rad/s": [("rad/s", 1.0), ("mrad/s", 0.001), ("urad/s", 1e-6), ("µrad/s", 1e-6), ("deg/s", PI / 180)],
    "N": [("N", 1.0), ("kN", 1000.0)],
    "N/s": [("N/s", 1.0), ("kN/s", 1000.0)],
    "N.m": [("N.m", 1.0), ("N m", 1.0), ("Nm", 1.0), ("kN.m", 1000.0)],
    "N/m": [("N/m", 1.0), ("kN/m", 1000.0), ("N/mm", 1000.0), ("N/um", 1e6), ("N/µm", 1e6)],
    "N.m/rad": [("N.m/rad", 1.0), ("N m/rad", 1.0), ("kN.m/rad", 1000.0)],
    "N.s/m": [("N.s/m", 1.0), ("N s/m", 1.0), ("kN.s/m", 1000.0)],
    "1": [("1", 1.0), ("%", 0.01)],
    "N/(m.s)": [("N/(m.s)", 1.0), ("N/(m s)", 1.0), ("kN/(m.s)", 1000.0)],
    "kg": [("kg", 1.0), ("g", 0.001), ("t", 1000.0)],
    "kg.m2": [
        *(("kg.m2", 1.0), ("kg m2", 1.0), ("kg.mm2", 1e-6), ("kg mm2", 1e-6)),
        *(("g.mm2", 1e-9), ("g mm2", 1e-9)),
    ],
    "m/s2": [("m/s2", 1.0)],
    "W": [("W", 1.0), ("mW", 0.001), ("uW", 1e-6), ("µW", 1e-6), ("kW", 1000.0)],
    "J": [("J", 1.0), ("uJ", 1e-6), ("µJ", 1e-6), ("kJ", 1000.0)],
}


def test_every_unit_is_what_it_means() -> None:
    """Expected: the table above, which is complete; with a space or without, signed, with an exponent."""
    assert list(UNITS) == list(MEANT)
    for kind, units in MEANT.items():
        assert list(UNITS[kind]) == [unit for unit, _ in units]
        for unit, size in units:
            assert number(f"3.7 {unit}", kind) == pytest.approx(3.7 * size, rel=1e-14)
            gap = " " if unit == "1" else ""  # else a digit
            assert number(f" -2.5e2{gap}{unit} ", kind) == pytest.approx(-250 * size, rel=1e-14)
            assert number(f"+.5 {unit}", kind) == pytest.approx(0.5 * size, rel=1e-14)
        assert number(np.float32(1.5), kind) == 1.5
        assert number(np.int64(3), kind) == 3
    assert number("4 \N{GREEK SMALL LETTER MU}m", "m") == pytest.approx(4e-6)


@pytest.mark.parametrize(
    ("unit", "text"),
    [
        *(("m/s2", "m/s²"), ("rad/s2", "rad/s²"), ("N.m", "N·m"), ("kg.m2", "kg·m²"), ("kN.s/m", "kN·s/m")),
        *(("N/(m.s)", "N/(m·s)"), ("1", "1"), ("", ""), ("%", "%"), ("m", "m")),
    ],
)
def test_units_are_written_as_people_write_them_and_read_so(unit: str, text: str) -> None:
    """Expected: exponents raised and products with a point, by the SI brochure, 5.4.1; a unit alone stays."""
    assert unit_text(unit) == text
    assert unit_typed(f" {text} ") == unit
    if any(unit in units for units in UNITS.values()):
        kind = next(kind for kind, units in UNITS.items() if unit in units)
        assert number(f"2.5 {text}", kind) == number(f"2.5 {unit}", kind)


def test_a_number_has_at_most_1e12_si_units() -> None:
    assert number(1e12, "N") == -number("-1e9 kN", "N") == 1e12
    with pytest.raises(ValueError, match="at most"):
        number("-1.01e9 kN", "N")


# The types of fields: unit, size (0 for a number), and what bounds them.
FIELDS: dict[str, tuple[str, int, str]] = {
    "Number": (PLAIN, 0, ""), "PositiveNumber": (PLAIN, 0, "> 0"), "Angle": ("rad", 0, ""), "AnyTime": ("s", 0, ""),
    "Time": ("s", 0, ">= 0"), "PositiveTime": ("s", 0, "> 0"), "PositiveLength": ("m", 0, "> 0"),
    "Frequency": ("Hz", 0, "> 0"), "Band": ("Hz", 2, ""), "PositiveForce": ("N", 0, "> 0"),
    "PositiveForceRate": ("N/s", 0, "> 0"), "Position": ("m", 3, ""), "Orientation": ("rad", 3, ""),
    "Velocity": ("m/s", 3, ""), "AngularVelocity": ("rad/s", 3, ""), "Force": ("N", 3, ""), "Torque": ("N.m", 3, ""),
    "LegForces": ("N", 6, ""), "ProportionalGains": ("N/m", 6, "channels"),
    "DerivativeGains": ("N.s/m", 6, "channels"), "IntegralGains": ("N/(m.s)", 6, "channels"),
}  # fmt: skip


@pytest.mark.parametrize("name", FIELDS)
def test_each_field_has_its_unit_size_and_bound(name: str) -> None:
    """Expected: the table above; a text in the last unit of its row, from both sides of the bound."""
    unit, size, bound = FIELDS[name]
    field, annotation = TypeAdapter(getattr(section, name)), annotation_in(Unit, getattr(section, name))
    last, factor = MEANT[unit][-1] if unit != PLAIN else ("", 1.0)

    def written(value: float) -> Any:
        one = f"{value} {last}" if last else value
        return [one] * size if size else one

    assert annotation is not None
    assert (annotation.unit, getattr(annotation, "size", None) or 0) == (unit, size)
    for value in (0.5, 0.0, -0.5):
        if value > 0 or bound in ("", "channels") or (value == 0 and bound == ">= 0"):
            found = field.validate_python(written(value))
            assert np.ravel(found) == pytest.approx([value * factor] * max(size, 1))
            continue
        with pytest.raises(ValidationError) as caught:
            field.validate_python(written(value))
        said = f"expected {bound}{f' {unit}' if unit else ''}"
        assert [error["msg"] for error in caught.value.errors()] == [f"Value error, {said}"]
    if bound == "channels":
        assert field.validate_python(f"0.5 {last}") == pytest.approx((0.5 * factor,) * 6)
    elif size:
        with pytest.raises(ValidationError, match=f"expected a list of {size}"):
            field.validate_python(0.5)
