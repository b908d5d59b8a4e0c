"""How finely units are shown."""

import math

import pytest

from gough_stewart.harness.output.display_resolution import LEAST_SPANS, factor_to, least_span, widened


@pytest.mark.parametrize(
    ("unit", "factor"), [("mm", 1e3), ("deg", 180 / math.pi), ("mrad", 1e3), ("%", 100), ("J", 1), ("rad/s", 1)]
)
def test_numbers_in_si_units_become_those_of_the_unit(unit: str, factor: float) -> None:
    assert factor_to(unit) == pytest.approx(factor, rel=1e-15)


def test_units_of_one_quantity_agree_on_what_is_worth_looking_at() -> None:
    """Expected: the same length, angle or rate in each of its units, up to a factor of two."""
    for same in (("m", "mm"), ("rad", "mrad", "deg"), ("m/s", "mm/s"), ("rad/s", "deg/s")):
        sizes = [LEAST_SPANS[unit] / factor_to(unit) for unit in same]
        assert max(sizes) < 2 * min(sizes)


def test_an_axis_of_values_that_rest_is_widened_about_them() -> None:
    """Expected: 0.001 mm about 5 mm; a millionth of what is large; what moves stays as it is."""
    assert widened(5.0, 5.0 + 1e-9, "mm") == pytest.approx((4.9995, 5.0005))
    assert widened(-2e6, -2e6, "mm") == pytest.approx((-2e6 - 1, -2e6 + 1))
    assert widened(-1.0, 3.0, "mm") == (-1.0, 3.0)
    assert widened(math.nan, math.nan, "mm") == (-0.0005, 0.0005)
    assert least_span("a unit of nobody") == 1e-6


def test_the_least_of_every_unit() -> None:
    """Expected: by quantity in SI units, times the units' factors by definition; a ten-thousandth of a degree."""
    of_quantities = {
        1e-6: ("m", "rad", "kg", "kg.m2", "Hz"),
        1e-5: ("m/s", "rad/s"),
        1e-3: ("m/s2", "rad/s2", "N", "N.m", "W", "J", "1"),
        1e-1: ("N/s",),
        1e-9: ("s",),
    }
    expected = {unit: least for least, units in of_quantities.items() for unit in units}
    expected |= {"mm": 1e3 * 1e-6, "mrad": 1e3 * 1e-6, "mm/s": 1e3 * 1e-5, "deg": 1e-4, "deg/s": 1e-3, "%": 1e-3}
    assert pytest.approx(expected) == LEAST_SPANS


@pytest.mark.parametrize(
    ("unit", "largest", "least"),
    [
        ("mm", 0.0, 1e-3),
        ("mm", 999.0, 1e-3),
        ("mm", -1001.0, 1.001e-3),
        ("none of these", 5.0, 5e-6),
        ("N/s", 2.0, 0.1),
    ],
)
def test_the_least_grows_with_what_is_shown(unit: str, largest: float, least: float) -> None:
    """Expected: a millionth of the largest value, if that is more than the unit's own."""
    assert least_span(unit, largest) == pytest.approx(least)


@pytest.mark.parametrize(
    ("ends", "axis"),
    [
        ((math.nan, 3.0), (-0.0005, 0.0005)),
        ((3.0, math.inf), (-0.0005, 0.0005)),
        ((-math.inf, 3.0), (-0.0005, 0.0005)),
        ((2.0, 2.0009), (1.99995, 2.00095)),
        ((2.0, 2.0011), (2.0, 2.0011)),
        ((-5000.0, -4999.9999), (-5000.00245, -4999.99745)),
    ],
)
def test_both_ends_of_an_axis(ends: tuple[float, float], axis: tuple[float, float]) -> None:
    """Expected: half of what lacks on each side of the middle; nothing finite is an axis about 0."""
    assert widened(*ends, "mm") == pytest.approx(axis, rel=1e-12)


@pytest.mark.parametrize(("unit", "factor"), [("kN", 1e-3), ("cm", 100), ("°", 180 / math.pi), ("Hz", 1), ("xyz", 1)])
def test_further_units(unit: str, factor: float) -> None:
    assert factor_to(unit) == pytest.approx(factor, rel=1e-15)
