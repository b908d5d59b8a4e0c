"""What is told of a small machine: digits by its stroke, units by the numbers' own size."""

from pathlib import Path

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.report.quantities import (
    ANGLE,
    ENERGY,
    FORCE,
    LENGTH,
    POSITION,
    POWER,
    TIME,
    Quantity,
    fine,
    fineness_of,
)
from gough_stewart.harness.report.table import Table
from tests.support.nano import HEAVY, NANO, nano_experiment


@pytest.mark.parametrize(
    ("quantity", "stored", "usual", "small"),
    [
        (LENGTH, 12.34e-9, "< 0.001 mm", "12.34 nm"),
        (LENGTH, -5.099e-6, "-0.005099 mm", "-5.099 µm"),
        (LENGTH, 4e-11, "< 0.001 mm", "< 0.1 nm"),
        (LENGTH, 0.0, "0 mm", "0 µm"),
        (POSITION, 0.0800047, "0.080005 m", "80.0047 mm"),
        (POSITION, 1.5e-6, "1.5e-06 m", "1.5 µm"),
        (ANGLE, 2.5e-7, "< 0.0001 deg", "0.25 µrad"),
        (POWER, 2.17e-4, "< 0.001 W", "217 µW"),
        (ENERGY, 2.1e-5, "< 0.001 J", "21 µJ"),
        (FORCE, 5e-4, "< 0.001 N", "0.0005 N"),
        (TIME, 1e-10, "< 1e-09 s", "< 1e-09 s"),
    ],
)
def test_numbers_of_a_small_machine_have_their_own_size(
    quantity: Quantity, stored: float, usual: str, small: str
) -> None:
    """Expected: by hand, for a stroke of 100 µm, of which a millionth is told; nothing changes from 1 cm on."""
    assert quantity.text(stored) == usual
    assert fine(quantity, 1.0).text(stored) == usual
    assert fine(quantity, 1e-4).text(stored) == small


def test_fineness_follows_the_stroke_of_the_legs() -> None:
    """Expected: the stroke in metres below 1 cm, a hundredth of a leg if none is stated; of large machines always 1."""
    assert fineness_of(NANO) == pytest.approx(1e-4)
    assert fineness_of(NANO.with_parameters({"leg_length_max": None})) == pytest.approx(0.01 * 0.08)
    for large in (HEAVY, *map(gs.load_preset, ("liu2000", "motion_base", "desktop_hexapod"))):
        assert fineness_of(large) == 1


def test_a_run_of_a_nano_hexapod_tells_nanometres(tmp_path: Path) -> None:
    """Expected: norms of the record's columns; in terminal, tables, charts, page and the record's own lines."""
    record = gs.run(nano_experiment(tmp_path))
    peak = 1e9 * np.linalg.norm(record["error.position"], axis=1).max()
    turned = 1e6 * np.linalg.norm(record["error.orientation"], axis=1).max()
    assert 1 < peak < 1000
    report = record.report()
    assert report.number("tracking.position.norm_peak").text == f"{peak:.4g} nm"
    assert f"{report.verdict.numbers[0].text}" == f"{peak:.4g} nm"
    assert "nm" in report.verdict.text
    cells = {
        row[0]: row[1:]
        for part in report.parts()
        if isinstance(part, Table)
        for row in map(part.texts, range(len(part.rows)))
    }
    assert cells["|position|"][1] == f"{peak:.4g} nm"
    assert float(cells["|orientation|"][1].removesuffix(" µrad")) == pytest.approx(turned, rel=1e-3)
    longest = 1e3 * record["leg_length"].max(axis=0)
    assert [float(text.removesuffix(" mm")) for text in cells["longest"][:6]] == pytest.approx(longest, abs=1e-4)
    (error,) = (chart for chart in report.charts if chart.title == "position error")
    assert error.y_title.endswith("[µm]")
    (line,) = (line for line in repr(record).splitlines() if "peak error of position" in line)
    assert line.endswith(f"{1e9 * np.abs(record['error.position']).max():.4g} nm")
