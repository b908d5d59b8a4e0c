"""How finely units are shown."""

import math

import pytest

from gough_stewart.harness.output.quantities_shown import LEAST_SPANS, factor_to, least_span, widened


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
