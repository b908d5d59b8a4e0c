"""Numbers and words as they are shown: units, digits by the machine's size, the glossary, and what was set."""

import html
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.report.chart import Chart, Series, time_axis
from gough_stewart.harness.report.document import Report, Section, Setting, Verdict, settings_of
from gough_stewart.harness.report.figures import figures
from gough_stewart.harness.report.page import page_of
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
    factor_to,
    fine,
    fineness_of,
    least_span,
    of_unit,
)
from gough_stewart.harness.report.terminal import text_of
from gough_stewart.harness.report.words import GLOSSARY, explained, with_terms
from tests.support.nano import HEAVY, NANO, nano_experiment

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
]


@pytest.mark.parametrize(("quantity", "stored", "usual", "small"), TEXTS)
def test_numbers_have_units_and_digits_of_their_own_size(
    quantity: Quantity, stored: float, usual: str, small: str
) -> None:
    """Expected: by hand; nothing changes from a stroke of 1 cm on."""
    assert (quantity.text(stored), fine(quantity, 1.0).text(stored)) == (usual, usual)
    assert fine(quantity, 1e-4).text(stored) == small
    assert quantity.text(None) == "–"


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
    for unit, factor in {"mm": 1e3, "deg": degrees, "°": degrees, "%": 100, "rad/s": 1, "kN": 1e-3, "xyz": 1}.items():
        assert factor_to(unit) == pytest.approx(factor, rel=1e-15)


def test_axes_show_a_tenth_of_what_numbers_tell_or_a_millionth_of_what_is_shown() -> None:
    """Expected: by hand; units of one quantity agree up to a factor of two."""
    for unit, largest, least in (
        ("mm", 0.0, 1e-4), ("mm", 99.9, 1e-4), ("mm", -100.1, 1.001e-4), ("deg", 2e-5, 1e-5),
        ("none of these", 5.0, 5e-6), ("none of these", 0.0, 1e-7), ("N/s", 2.0, 1e-2),
    ):  # fmt: skip
        assert least_span(unit, largest) == pytest.approx(least)
    for same in (("m", "mm"), ("rad", "mrad", "deg"), ("m/s", "mm/s"), ("rad/s", "deg/s")):
        sizes = [LEAST_SPANS[unit] / factor_to(unit) for unit in same]
        assert max(sizes) < 2 * min(sizes)


def test_fineness_follows_the_stroke_of_the_legs() -> None:
    """Expected: the stroke in metres below 1 cm, a hundredth of a leg if none is stated; of large machines always 1."""
    assert fineness_of(NANO) == pytest.approx(1e-4)
    assert fineness_of(NANO.with_parameters({"leg_length_max": None})) == pytest.approx(0.01 * 0.08)
    for large in (HEAVY, *map(gs.load_preset, ("liu2000", "motion_base", "desktop_hexapod"))):
        assert fineness_of(large) == 1


def test_a_run_of_a_nano_hexapod_tells_nanometres(tmp_path: Path) -> None:
    """Expected: norms of the record's columns; in verdict, tables, charts and the record's own lines."""
    record = gs.run(nano_experiment(tmp_path))
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
    (line,) = (line for line in repr(record).splitlines() if "peak error of position" in line)
    assert line.endswith(f"{1e9 * np.abs(record['error.position']).max():.4g} nm")


def test_words_are_in_order() -> None:
    """As readers of the documentation look them up."""
    assert list(GLOSSARY) == sorted(GLOSSARY, key=str.casefold)


def test_the_first_of_each_word_is_marked_and_the_text_stays() -> None:
    """Expected: whole words only, in singular or plural, longer terms first; markup of a user stays text.

    Commands in backticks are code, without marks, and keep their hyphens.
    """
    text = "The phase margins <b>and the phase margin</b> of feedforwarding a Reference & home"
    found = with_terms(text)
    assert html.unescape(re.sub(r"</?span[^>]*>", "", found)) == text
    assert re.findall(r'tabindex="0" data-means="[^"]+">([^<]+)<', found) == ["phase margins", "Reference", "home"]
    assert html.escape(GLOSSARY["phase margin"]) in found
    assert with_terms("nothing of the kind") == "nothing of the kind"
    assert with_terms("by `run a<b -1 --plant fmu3` -1") == "by <code>run a&lt;b -1 --plant fmu3</code> −1"
    assert explained("rise", 'a "time"') == '<span class="term" tabindex="0" data-means="a &#34;time&#34;">rise</span>'


@pytest.mark.parametrize("study", ["margins", "check", "ensemble"])
def test_every_study_names_what_was_set_and_what_the_file_has(study: str) -> None:
    """Expected: the shipped file has 2 Hz and one sample; a key set to what the file has is not told."""
    given: dict[str, Any] = {"controller.bandwidth": "3.5 Hz", "loop.delay": 2, "loop.duration": 0.05}
    if study == "ensemble":
        found = gs.ensemble("heave_tolerances", {**given, "ensemble.worst": 0}, members=3, workers=1)
    else:
        found = getattr(gs, study)("heave_step", {**given, "loop.sample_time": "1 ms"})
    settings = {each.key: (each.values, each.default) for each in found.report(charts=False).settings}
    assert settings["controller.bandwidth"] == (("3.5 Hz",), "2 Hz")
    assert settings["loop.delay"] == (("2",), "1")
    assert "loop.sample_time" not in settings


def test_settings_stand_beside_the_title_in_every_renderer() -> None:
    chart = Chart("x", time_axis(np.arange(3.0)), (Series("x", LENGTH, np.arange(3.0)),))
    changed = settings_of(
        {"loop.delay": {"value": 2, "file": 1}, "sensors.noise": {"value": {"a": 0.25}, "file": None}}
    )
    report = Report("heave", Verdict("v", "told"), (Section("s", (chart,)),), settings=changed)
    assert text_of(report).splitlines()[1:3] == ["heave", "set: loop.delay = 2 (file: 1), sensors.noise = a 0.25"]
    assert '<p class="lead">set: loop.delay = 2 (file: 1), sensors.noise = a 0.25</p>' in page_of(report).decode()
    assert b"heave (loop.delay = 2, sensors.noise = a 0.25)" in figures(report, ("svg",))["x.svg"]
    several = Report("heave", report.verdict, settings=(Setting("loop.delay", ("2", "3")),), runs=("a", "b"))
    assert several.changed == ""
    assert "What differs between the runs" in page_of(several).decode()
