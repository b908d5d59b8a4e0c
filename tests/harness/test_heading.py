"""Headings of tables: name and unit, whichever brackets and blanks; factors are those of the units' definitions."""

import pytest

from gough_stewart.harness.heading import Heading
from gough_stewart.harness.quantities import UNITS


@pytest.mark.parametrize(
    ("text", "name", "unit"),
    [
        ("x", "x", None),
        (" x ", "x", None),
        ("x [mm]", "x", "mm"),
        ("x[mm]", "x", "mm"),
        ("x (mm)", "x", "mm"),
        ("leg_length[4] [mm]", "leg_length[4]", "mm"),
        ("leg_length[4]", "leg_length[4]", None),
        ("base_points[4,3]", "base_points[4,3]", None),
        ("base_points[4,3] ( m )", "base_points[4,3]", "m"),
        ("qx [1]", "qx", "1"),
        ("a b (N m)", "a b", "N m"),
        ("x []", "x", ""),
        ("[mm]", "", "mm"),
    ],
)
def test_a_heading_is_a_name_and_a_unit_and_an_index_is_none(text: str, name: str, unit: str | None) -> None:
    assert Heading.of(text) == (text, name, unit)


def test_a_unit_is_a_factor_and_none_is_si() -> None:
    """Expected: a millimetre is a thousandth of a metre, a minute sixty seconds; what is no length is refused."""
    assert Heading.of("x [mm]").factor(UNITS["m"]) == 1e-3
    assert Heading.of("time (min)").factor(UNITS["s"]) == 60
    assert Heading.of("x[2]").factor(UNITS["m"]) == 1
    with pytest.raises(ValueError, match=r"^x \[s\] has the unit 's'; expected one of m, cm, mm, um, µm, nm$"):
        Heading.of("x [s]").factor(UNITS["m"])
