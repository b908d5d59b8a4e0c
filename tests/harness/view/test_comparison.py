"""Metrics of several runs side by side."""

from typing import Any

import lxml.html
import numpy as np
import pytest

from gough_stewart.harness.output.colours import COLOURS
from gough_stewart.harness.output.tables import quantity_text
from gough_stewart.harness.results.metrics import metrics
from gough_stewart.harness.results.record import Record
from gough_stewart.harness.view.comparison import best, comparison_table
from gough_stewart.harness.view.tables import limits_sheet
from gough_stewart.model.platform_toml import load_preset
from tests.support.records import oscillating, says_it_oscillates, waving_record


def rows_of(records: list[Record]) -> tuple[list[str], dict[str, list[str]]]:
    names = [f"run <{k}>" for k in range(len(records))]
    table: Any = lxml.html.fromstring(comparison_table(records, [metrics(each) for each in records], names))
    heads = [head.text_content() for head in table.xpath("thead//th")]
    swatches = table.xpath("thead//*[@class='swatch']/@style")
    assert swatches == [f"background:{colour}" for colour in COLOURS[: len(records)]]
    rows = {
        row.xpath("th")[0].text_content(): [c.text_content() for c in row.xpath("td")]
        for row in table.xpath("tbody/tr")
    }
    return heads, rows


def test_each_run_has_a_column_and_the_best_values_are_marked() -> None:
    """Expected: peak errors as norms of the records' columns; the smaller one marked, the largest stroke margin too."""
    base = load_preset("motion_base")
    records = [waving_record(base, size=size) for size in (0.04, 0.02)]
    heads, rows = rows_of(records)
    assert heads == ["run <0>", "run <1>"]
    peaks = [1e3 * np.linalg.norm(each["error.position"], axis=1).max() for each in records]
    shown = rows["position error, peak mm"]
    assert [float(text.removeprefix("★ ")) for text in shown] == pytest.approx(peaks, rel=1e-3)
    assert [text.startswith("★") for text in shown] == [False, True]
    assert [text.startswith("★") for text in rows["stroke margin mm"]] == [False, True]
    assert not any("★" in text for text in (*rows["peak force N"], *rows["outcome"], *rows["work, net J"]))


@pytest.mark.parametrize(
    "other",
    [
        {"duration": 7.0},
        {"experiment": {"reference": {"kind": "sine"}}},
        {"outcome": {"status": "diverged", "time": 0.5, "cause": None}},
    ],
)
def test_nothing_is_best_where_runs_had_different_tasks_or_did_not_complete(other: dict[str, Any]) -> None:
    base = load_preset("motion_base")
    _, rows = rows_of([waving_record(base, size=0.04), waving_record(base, size=0.02, **other)])
    assert not any("★" in text for row in rows.values() for text in row)


def test_nothing_is_best_where_a_loop_oscillates_and_its_outcome_says_so() -> None:
    """Expected: an error of leg 5 made of 40 Hz and 3 mm, in words; the other run completed and is named as such."""
    base = load_preset("motion_base")
    sound = waving_record(base, size=0.0)
    heads, rows = rows_of([sound, oscillating(sound)])
    assert heads == ["run <0>", "run <1>"]
    outcomes = rows["outcome"]
    assert outcomes[0] == "completed at 0.5 s"
    assert says_it_oscillates(outcomes[1])
    assert not any("★" in text for row in rows.values() for text in row)


def test_values_that_read_alike_are_equally_good() -> None:
    """Expected: rounding marks nobody; two of three share the mark; None is left out; of net work nothing is best."""
    assert best("tracking.position.norm_rms", [1.00001, 1.00002]) == set()
    assert best("tracking.position.norm_rms", [2.0, 1.00001, 1.00002]) == {1, 2}
    assert best("tracking.position.norm_rms", [1e-9, 3e-8]) == set()
    assert best("stroke.margin", [3.0, None, -5.0]) == {0}
    assert best("step_response.z.final_error", [-3.0, 2.0]) == {1}
    assert best("energy.net_total", [1.0, 2.0]) == set()


def test_what_is_less_than_the_least_of_its_unit_is_shown_as_less() -> None:
    """Expected: of 1.9e-11 mm that it is below 0.001 mm; all else as it is; so also shares of limits."""
    assert quantity_text(-1.9e-11, "mm") == "< 0.001"
    assert [quantity_text(value, "mm") for value in (0.0, 0.001, -0.5, None)] == ["0", "0.001", "-0.5", "–"]
    assert quantity_text(1e-9, "") == "1e-09"
    base = load_preset("motion_base")
    still = waving_record(base, rows=5, size=0.0)
    record = Record(
        still.table.with_columns(**{f"leg_velocity[{k}]": np.full(5, 1e-9) for k in range(1, 7)}), still.metadata
    )
    sheet = limits_sheet(record, base)
    assert sheet is not None
    shown = {getattr(row[0], "what", row[0]): row[1:] for row in sheet.rows}
    assert shown["velocity, most of its limit"] == ("< 0.001",) * 6
