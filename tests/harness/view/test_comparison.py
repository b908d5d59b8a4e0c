"""Several runs side by side: metrics, what differs between their files, and differences of their signals."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.report.quantities import ENERGY, LENGTH
from gough_stewart.harness.view.view import best, difference, differing_settings, side_by_side, view_report
from tests.support.records import oscillating, plain, says_it_oscillates, waving_record
from tests.support.uneven_records import record_of


def cells_of(table: Any) -> dict[str, tuple[str, ...]]:
    return {table.texts(k)[0]: table.texts(k)[1:] for k in range(len(table.rows))}


def rows_of(records: list[gs.Record]) -> dict[str, tuple[str, ...]]:
    return cells_of(side_by_side(records, [gs.metrics(record) for record in records], "abc"[: len(records)]))


def charts_of(report: Any, section: str) -> dict[str, Any]:
    (found,) = (each for each in report.sections if each.title == section)
    return {part.title: part for part in found.parts if type(part).__name__ == "Chart"}


def test_the_verdict_names_the_run_that_follows_best() -> None:
    """Expected: of peaks found from the columns, the smallest first and the largest last, in mm, rounded up."""
    base = gs.load_preset("motion_base")
    records = [waving_record(base, size=size) for size in (0.03, 0.02, 0.04)]
    report = view_report(records, ["a", "b", "c"])
    peaks = [np.linalg.norm(each["error.position"], axis=1).max() for each in records]
    assert [number.value for number in report.verdict.numbers] == pytest.approx(peaks)
    first, _, last = report.verdict.text.partition("; ")
    assert first.startswith("b follows best, within ")
    assert last.startswith("c within ")
    for text, peak in ((first, peaks[1]), (last, peaks[2])):
        shown = float(text.split()[-2])
        assert 1e3 * peak <= shown <= 1.1e3 * peak
    later = gs.Record(records[1].table, {**records[1].metadata, "duration": 7.0})
    assert "none is best" in view_report([records[0], later], ["a", "b"]).verdict.text


def test_steps_are_not_compared_by_the_size_of_the_step() -> None:
    """Expected: both peaks are the step of 50 mm; the faster loop is named, with rise times that differ two-fold."""
    overrides: list[dict[str, Any]] = [{"controller.bandwidth": hertz, "loop.duration": 1.0} for hertz in (2, 4)]
    records = [gs.run("heave_step", changed) for changed in overrides]
    text = view_report(records, ["slow", "fast"]).verdict.text
    assert text.startswith("fast ")
    assert "equally" not in text
    rises = [gs.metrics(record)["step_response"][0]["rise_time"] for record in records]
    assert rises[0] > 1.8 * rises[1]
    assert text.endswith(f"rise time {rises[0]:.4g} s (slow) and {rises[1]:.4g} s (fast)")


@pytest.mark.parametrize(
    "other",
    [
        {"duration": 7.0},
        {"experiment": {"reference": {"kind": "sine"}}},
        {"outcome": {"status": "diverged", "time": 0.5, "cause": None}},
    ],
)
def test_nothing_is_best_where_runs_had_different_tasks_or_did_not_complete(other: dict[str, Any]) -> None:
    base = gs.load_preset("motion_base")
    records = [waving_record(base, size=0.04), waving_record(base, size=0.02, **other)]
    rows = rows_of(records)
    assert not any("★" in text for row in rows.values() for text in row)
    assert "best" not in view_report(records, ["a", "b"]).verdict.text.replace("none is best", "")


def test_nothing_is_best_where_a_loop_oscillates_and_its_outcome_says_so() -> None:
    """Expected: an error of leg 5 made of 40 Hz and 3 mm, in words; the other run completed and is named as such."""
    base = gs.load_preset("motion_base")
    sound = waving_record(base, size=0.0)
    rows = rows_of([sound, oscillating(sound)])
    outcomes = rows["outcome"]
    assert outcomes[0] == "completed at 0.5 s"
    assert says_it_oscillates(outcomes[1])
    assert not any("★" in text for row in rows.values() for text in row)
    report = view_report([sound, oscillating(sound)], ["still", "shaking"])
    (note,) = report.notes
    assert note.kind == "warning"
    assert note.text.startswith("shaking: ")
    assert says_it_oscillates(note.text.removeprefix("shaking: "))
    assert report.verdict.status == "marginal"


def test_values_that_read_alike_are_equally_good() -> None:
    """Expected: rounding marks nobody; two of three share the mark; None is left out; of net work nothing is best."""
    assert best("tracking.position.norm_rms", [1.00001, 1.00002], LENGTH) == set()
    assert best("tracking.position.norm_rms", [2.0, 1.00001, 1.00002], LENGTH) == {1, 2}
    assert best("tracking.position.norm_rms", [1e-9, 3e-8], LENGTH) == set()
    assert best("tracking.position.norm_rms", [1e-9, 3e-8], LENGTH.fine(1e-4)) == {0}
    assert best("stroke.margin", [3.0, None, -5.0], LENGTH) == {0}
    assert best("step_response.z.final_error", [-3.0, 2.0], LENGTH) == {1}
    assert best("energy.net_total", [1.0, 2.0], ENERGY) == set()


def test_what_differs_between_the_files_comes_first() -> None:
    """Expected: the keys with other values, of tables, lists and machines; nothing that all have."""
    base = gs.load_preset("motion_base")
    heavy = replace(base, platform_mass=1300.0)
    files = [
        {"controller": {"bandwidth": 2.0, "type": "pd"}, "disturbance": [{"at": 0.1}, {"at": 0.2}]},
        {"controller": {"bandwidth": 4.0, "type": "pd"}, "disturbance": [{"at": 0.1}, {"at": 0.3}]},
        {"controller": {"bandwidth": 4.0, "type": "pd", "damping": 0.7}, "disturbance": [{"at": 0.1}, {"at": 0.2}]},
    ]
    records = [waving_record(base, rows=9, experiment=file) for file in files]
    records[2] = gs.Record(records[2].table, {**records[2].metadata, "platform": plain(heavy)})
    found = {each.key: each.values for each in differing_settings(records)}
    assert found == {
        "controller.bandwidth": ("2 Hz", "4 Hz", "4 Hz"),
        "disturbance[2].at": ("0.2 s", "0.3 s", "0.2 s"),
        "controller.damping": ("–", "–", "0.7"),
        "machine.platform_mass": (f"{base.platform_mass:.6g} kg", f"{base.platform_mass:.6g} kg", "1300 kg"),
    }
    assert view_report(records, ["a", "b", "c"]).settings == differing_settings(records)


def test_runs_side_by_side_have_every_metric_and_its_best() -> None:
    """Expected: three runs with the numbers of their metrics in words and units; the best marked of those that rank."""
    records = [record_of(0.03), record_of(0.02), record_of(0.025)]
    found = [gs.metrics(each) for each in records]
    table = side_by_side(records, found, ["a", "b", "c"])
    assert table.note == "★ is the best of its row."
    assert [column.name for column in table.columns] == ["", "a", "b", "c"]
    rows = cells_of(table)
    assert not any("★" in text for text in (*rows["peak force [N]"], *rows["outcome"]))
    # by the words that are shown: path in the metrics, factor, and which run is best
    words = {
        "position error, RMS [mm]": (("tracking", "position", "norm_rms"), 1e3, 1),
        "position error, peak [mm]": (("tracking", "position", "norm_peak"), 1e3, 1),
        "position error, at the end [mm]": (("tracking", "position", "norm_final"), 1e3, 1),
        "orientation error, RMS [deg]": (("tracking", "orientation", "norm_rms"), 180 / np.pi, 1),
        "orientation error, peak [deg]": (("tracking", "orientation", "norm_peak"), 180 / np.pi, 1),
        "orientation error, at the end [deg]": (("tracking", "orientation", "norm_final"), 180 / np.pi, 1),
        "stroke margin [mm]": (("stroke", "margin"), 1e3, 1),
        "work, net [J]": (("energy", "net_total"), 1.0, None),
        "work, absolute [J]": (("energy", "absolute_total"), 1.0, 1),
    }
    for name, (path, factor, top) in words.items():
        values: list[Any] = list(found)
        for key in path:
            values = [value[key] for value in values]
        texts = rows[name]
        assert [float(text.removeprefix("★ ")) for text in texts] == pytest.approx(
            [factor * value for value in values], rel=1e-3
        ), name
        assert [text.startswith("★") for text in texts] == [k == top for k in range(3)], name
    assert list(rows)[:7] == ["outcome", *list(words)[:6]]


def test_charts_show_the_runs_over_each_other_and_each_minus_the_first() -> None:
    """Expected: of two records with other clocks, six sines that differ by a sine; colours by run, names by component.

    A row's straight line is off by (2π f h)²/8 of the amplitude at most.
    """
    platform = gs.load_preset("motion_base")
    records = [waving_record(platform, rows=501, size=0.04), waving_record(platform, rows=251, size=0.03, step=1.7e-3)]
    report = view_report(records, ["long", "short"])
    position = charts_of(report, "Over time")["position from home"]
    actual = [each for each in position.series if each.role == "actual"]
    assert [(each.run, each.component) for each in actual] == [(run, axis) for run in (0, 1) for axis in "xyz"]
    assert np.array_equal(position.x_of(actual[5]), records[1]["time"])
    change = charts_of(report, "Differences from long")["position from home, difference"]
    assert {each.run for each in change.series} == {1}
    (z,) = (each for each in change.series if each.component == "z")
    time = change.x_of(z)
    assert time[-1] == pytest.approx(250 * 1.7e-3)
    amplitude = platform.characteristic_length * (0.03 - 0.04)
    bound = 0.07 * platform.characteristic_length * (2 * np.pi * 1.7e-3) ** 2 / 8
    assert z.values == pytest.approx(amplitude * np.sin(2 * np.pi * time), abs=bound)
    assert np.ptp(z.values) > 100 * bound
    assert not [each for each in change.series if each.role == "reference"]
    (first, second) = (part for part in report.parts() if type(part).__name__ == "Scene")
    assert (first.run, second.run) == (0, 1)  # type: ignore[union-attr]


def test_a_difference_is_of_the_times_that_both_records_span() -> None:
    """Expected: of two straight lines 3 + 2t and 1 − t the line −2 − 3t, at the times of both from 0.5 s to 1 s.

    A flag holds: it is up from 0.2 s to 0.4 s, the other never, and nothing is between 0 and 1. Tenths as multiples and
    as sums differ in the last bits, and are the same rows.
    """
    one, other = np.arange(0, 1.01, 0.25), np.arange(0.5, 2, 0.2)
    lines = (3 + 2 * one, 1 - other)
    time, values = difference((one, other), lines)
    assert time == pytest.approx([0.5, 0.7, 0.75, 0.9, 1.0])
    assert values == pytest.approx(-2 - 3 * time)
    assert len(difference((one, other + 5), lines)[0]) == 0
    flags = (np.array([0.0, 1.0, 0.0]), np.zeros(3))
    time, values = difference((np.array([0.0, 0.2, 0.4]), np.array([0.0, 0.3, 0.4])), flags, holds=True)
    assert dict(zip(time, values, strict=True)) == {0.0: 0.0, 0.2: -1.0, 0.3: -1.0, 0.4: 0.0}
    multiples, sums = np.linspace(0.0, 1.1, 12), np.cumsum(np.full(12, 0.1)) - 0.1
    assert not np.array_equal(multiples, sums)
    up = (np.arange(12.0) % 3 == 0).astype(float)
    time, values = difference((multiples, sums), (up, up), holds=True)
    assert time == pytest.approx(multiples)
    assert not values.any()
    assert difference((multiples, sums), (multiples, 3 * sums))[1] == pytest.approx(2 * multiples)


def test_what_differs_between_the_files_is_said_first() -> None:
    """Expected: by hand, in the order of the files; no names; long values and more than four keys are counted only."""
    keys = {"title": "t{}", "a": "{}", "b": "b{}", "c": 60 * "{}", "d": "d{}", "e": "e{}", "f": "f{}"}
    base = gs.load_preset("motion_base")
    records = []
    for k in (1, 2):
        record = waving_record(base)
        own = {key: text.format(*[k] * 60) for key, text in keys.items()}
        records.append(replace(record, metadata={**record.metadata, "experiment": {**own, "same": 5}}))
    assert view_report(records, ["one", "two"]).lead == "They differ in a (1, 2), b (b1, b2), c, d (d1, d2) and 2 more"
    assert view_report([records[0]] * 2, ["one", "two"]).lead == ""
