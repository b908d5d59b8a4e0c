"""How finely units are shown."""

import math

import pytest

from gough_stewart.harness.report.quantities import LEAST_SPANS, factor_to, least_span


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        *(("mm", 1e3), ("deg", 180 / math.pi), ("mrad", 1e3), ("%", 100), ("J", 1), ("rad/s", 1)),
        *(("kN", 1e-3), ("cm", 100), ("°", 180 / math.pi), ("Hz", 1), ("xyz", 1)),
    ],
)
def test_numbers_in_si_units_become_those_of_the_unit(unit: str, factor: float) -> None:
    assert factor_to(unit) == pytest.approx(factor, rel=1e-15)


def test_units_of_one_quantity_agree_on_what_is_worth_looking_at() -> None:
    """Expected: the same length, angle or rate in each of its units, up to a factor of two."""
    for same in (("m", "mm"), ("rad", "mrad", "deg"), ("m/s", "mm/s"), ("rad/s", "deg/s")):
        sizes = [LEAST_SPANS[unit] / factor_to(unit) for unit in same]
        assert max(sizes) < 2 * min(sizes)


@pytest.mark.parametrize(
    ("unit", "largest", "least"),
    [
        ("mm", 0.0, 1e-4),
        ("mm", 99.9, 1e-4),
        ("mm", -100.1, 1.001e-4),
        ("deg", 2e-5, 1e-5),
        ("none of these", 5.0, 5e-6),
        ("none of these", 0.0, 1e-7),
        ("N/s", 2.0, 1e-2),
    ],
)
def test_the_least_grows_with_what_is_shown(unit: str, largest: float, least: float) -> None:
    """Expected: a tenth of what numbers tell, or a millionth of the largest value, if that is more."""
    assert least_span(unit, largest) == pytest.approx(least)
