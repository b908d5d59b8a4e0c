"""Numbers as they are shown: units, and digits by the machine's size."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.report.quantities import (
    ANGLE,
    ENERGY,
    FORCE,
    LEAST_SPANS,
    LENGTH,
    NUMBER,
    PERCENT,
    POSITION,
    POWER,
    SHARE,
    TIME,
    Quantity,
    at_most,
    fine,
    least_span,
    of_unit,
    percent,
    plain_text,
)
from tests.support.nano import HEAVY, NANO, nano_experiment
from tests.support.records import changed, waving_record

# Stored number, as usual, and of a machine with a stroke of 100 µm, of which a millionth is told.
TEXTS: list[tuple[Quantity, float, str, str]] = [
    (LENGTH, 12.34e-9, "< 0.001 mm", "12.34 nm"),
    (LENGTH, -5.099e-6, "-0.005099 mm", "-5.099 µm"),
    (LENGTH, 4e-11, "< 0.001 mm", "< 0.1 nm"),
    (LENGTH, 0.0, "0 mm", "0 µm"),
    (LENGTH, math.inf, "∞ mm", "∞ µm"),
    (POSITION, 3.24591, "3.2459 m", "3245.91 mm"),
    (POSITION, 1.5e-6, "1.5e-06 m", "1.5 µm"),
    (ANGLE, math.pi / 6, "30 deg", "523599 µrad"),
    (ANGLE, 2.5e-7, "< 0.0001 deg", "0.25 µrad"),
    (POWER, 2.17e-4, "< 0.001 W", "217 µW"),
    (ENERGY, 2.1e-5, "< 0.001 J", "21 µJ"),
    (FORCE, 5e-4, "< 0.001 N", "0.0005 N"),
    (FORCE, 18610.4, "18610 N", "18610 N"),
    (TIME, 1e-10, "< 1e-09 s", "< 1e-09 s"),
    (SHARE, 0.125, "12.5 %", "12.5 %"),
    (PERCENT, 12.5, "12.5 %", "12.5 %"),
    (NUMBER, 2.5, "2.5", "2.5"),
    (of_unit("1"), 2.5, "2.5", "2.5"),
]


@pytest.mark.parametrize(("quantity", "stored", "usual", "small"), TEXTS)
def test_numbers_have_units_and_digits_of_their_own_size(
    quantity: Quantity, stored: float, usual: str, small: str
) -> None:
    """Expected: by hand; nothing changes from a stroke of 1 cm on."""
    assert (quantity.text(stored), fine(quantity, 1.0).text(stored)) == (usual, usual)
    assert fine(quantity, 1e-4).text(stored) == small
    assert (quantity.text(None), quantity.range_text(None, stored)) == ("–", f"at most {usual}")


def test_numbers_of_sentences_hold_on_their_side_and_100_percent_is_all() -> None:
    """Expected: by hand; metres from a metre on, and what is below the resolution is within it."""
    bounds = {0.8012e-3: "0.81 mm", 0.8e-3: "0.8 mm", 0.999: "1000 mm", 1.0: "1 m", 4e-8: "0.001 mm"}
    assert {size: at_most(LENGTH, size) for size in bounds} == bounds
    shares = {0.9996: "99.96 %", 1.0: "100 %", 0.126: "13 %", 12.34: "1234 %", math.inf: "beyond"}
    assert {share: percent(share) for share in shares} == shares
    assert plain_text({"a": np.array([[0.1234567], [2.0]]), "b": [1, True]}) == "a 0.123457; 2, b 1, True"


def test_numbers_in_any_unit_are_stored_in_that_of_the_quantity() -> None:
    """Expected: by hand; a unit of another kind is refused with those that are known."""
    for quantity, number, unit, stored in (
        (LENGTH, 2.0, "mm", 2e-3), (LENGTH, 2.0, "m", 2.0), (ANGLE, 90.0, "deg", math.pi / 2),
        (ANGLE, 3.0, "mrad", 3e-3), (PERCENT, 5.0, "%", 5.0), (SHARE, 5.0, "%", 0.05),
        (of_unit("rad/s"), 180.0, "deg/s", math.pi),
    ):  # fmt: skip
        assert quantity.stored(number, unit) == pytest.approx(stored, rel=1e-14)
    with pytest.raises(ValueError, match="the unit 'deg'; expected m, cm, mm"):
        LENGTH.stored(1.0, "deg")
    with pytest.raises(ValueError, match="the unit 'mm'; expected no unit"):
        NUMBER.stored(1.0, "mm")
    degrees = 180 / math.pi
    factors = {"mm": 1e3, "deg": degrees, "°": degrees, "%": 100, "rad/s": degrees, "kN": 1e-3, "xyz": 1}
    for unit, factor in factors.items():
        assert of_unit(unit).factor == pytest.approx(factor, rel=1e-15)


def test_curves_have_a_tenth_of_what_numbers_tell_or_a_millionth_of_what_is_shown_and_axes_twice_what_is_told() -> None:
    """Expected: by hand; units of one quantity agree up to a factor of two."""
    for unit, largest, least, span in (
        ("mm", 0.0, 1e-4, 2e-3), ("mm", 99.9, 1e-4, 2e-3), ("mm", -100.1, 1.001e-4, 2e-3), ("deg", 2e-5, 1e-5, 2e-4),
        ("none of these", 5.0, 5e-6, 5e-6), ("none of these", 0.0, 1e-7, 2e-6), ("N/s", 2.0, 1e-2, 0.2),
    ):  # fmt: skip
        assert (least_span(unit, largest), least_span(unit, largest, is_axis=True)) == pytest.approx((least, span))
    degrees = 180 / math.pi
    for same in ({"m": 1, "mm": 1e3}, {"rad": 1, "mrad": 1e3, "deg": degrees}, {"rad/s": 1, "deg/s": degrees}):
        sizes = [LEAST_SPANS[unit] / factor for unit, factor in same.items()]
        assert max(sizes) < 2 * min(sizes)


@pytest.mark.parametrize(
    ("machine", "error"),
    [
        (NANO, "nm"),
        (NANO.with_parameters({"leg_length_min": None, "leg_length_max": None}), "nm"),
        (HEAVY, "mm"),
        *((gs.load_preset(name), "mm") for name in ("liu2000", "desktop_hexapod")),
    ],
)
def test_fineness_follows_the_stroke_of_the_legs(machine: gs.Platform, error: str) -> None:
    """Expected: finer below a stroke of 1 cm, a hundredth of a leg if none is stated; an error of 200 nm as it is."""
    record = waving_record(machine, rows=20, size=0.0)
    wanted = record["position"] + [2e-7, 0, 0]
    shown = changed(record, reference__position=wanted, error__position=[2e-7, 0, 0]).report()
    assert shown.number("tracking.position.norm_peak").text == {"nm": "200 nm", "mm": "< 0.001 mm"}[error]


def test_a_run_of_a_nano_hexapod_tells_nanometres(tmp_path: Path) -> None:
    """Expected: norms of the record's columns; in verdict, tables, charts and the record's own lines."""
    record = gs.run(nano_experiment(tmp_path))
    found = gs.tune(tmp_path / "sine.toml", ["loop.delay=0..2"], "tracking.position.norm_peak", generations=1)
    assert found.report(charts=False).verdict.numbers[0].text == f"{1e9 * found.seen.value:.4g} nm"
    peak = 1e9 * np.linalg.norm(record["error.position"], axis=1).max()
    turned = 1e6 * np.linalg.norm(record["error.orientation"], axis=1).max()
    assert 1 < peak < 1000
    report: Any = record.report()
    assert report.number("tracking.position.norm_peak").text == report.verdict.numbers[0].text == f"{peak:.4g} nm"
    assert "nm" in report.verdict.text
    tables = [part for part in report.parts() if type(part).__name__ == "Table"]
    cells = {row[0]: row[1:] for table in tables for row in map(table.texts, range(len(table.rows)))}
    assert cells["|position|"][1] == f"{peak:.4g} nm"
    assert float(cells["|orientation|"][1].removesuffix(" µrad")) == pytest.approx(turned, rel=1e-3)
    longest = [float(text.removesuffix(" mm")) for text in cells["longest"][:6]]
    assert longest == pytest.approx(1e3 * record["leg_length"].max(axis=0), abs=1e-4)
    (error,) = (chart for chart in report.charts if chart.title == "position error")
    assert error.y_title.endswith("[µm]")
    for name, factor, unit in (("position", 1e9, "nm"), ("orientation", 1e6, "µrad"), ("leg_length", 1e9, "nm")):
        (line,) = (each for each in repr(record).splitlines() if f"error of {name.replace('_', ' ')}" in each)
        assert line.endswith(f"{factor * np.abs(record[f'error.{name}']).max():.4g} {unit}")
    assert [part.decimals > 4 for part in report.parts() if type(part).__name__ == "Scene"] == [True]
