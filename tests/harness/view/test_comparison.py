"""The page of several runs: which is best, metrics side by side, what differs between their files, and by how much."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.page_arrays import charts_of, data_of, elements, rows_below, verdict_of, words_of
from tests.support.records import changed, oscillating, plain, says_it_oscillates, stepping, waving_record
from tests.support.reports import page_of_records
from tests.support.uneven_records import record_of

BASE = gs.load_preset("motion_base")
PEAK = "position error, peak"


def side_by_side(page: bytes) -> dict[str, tuple[str, ...]]:
    return rows_below(page, "Metrics side by side")


def test_the_verdict_names_the_run_that_follows_best() -> None:
    """Expected: of peaks found from the columns, the smallest first and the largest last, in mm, rounded up."""
    records = [waving_record(BASE, size=size) for size in (0.03, 0.02, 0.04)]
    page = page_of_records(records, ["a", "b", "c"])
    peaks = [1e3 * np.linalg.norm(each["error.position"], axis=1).max() for each in records]
    numbers = elements(page, "//dl[@class='numbers']/div")
    assert [words_of(each.find("dt")) for each in numbers] == [f"{PEAK}: {name}" for name in "abc"]
    assert [float(words_of(each.find("dd/b"))) for each in numbers] == pytest.approx(peaks, rel=1e-3)
    first, _, last = verdict_of(page)[1].partition("; ")
    for text, name, peak in ((first, "b follows best, within", peaks[1]), (last, "c within", peaks[2])):
        assert text.startswith(name)
        assert peak <= float(text.split()[-2]) <= 1.1 * peak
    later = gs.Record(records[1].table, {**records[1].metadata, "duration": 7.0})
    assert "none is best" in verdict_of(page_of_records([records[0], later], ["a", "b"]))[1]


def test_a_step_is_judged_by_what_is_left_before_the_time_that_it_takes() -> None:
    """Expected: exponentials; one that stays 0.5 mm away is within 2 % of 50 mm earlier, and yet not the best."""
    records = [stepping(BASE, tau, 0.05, off) for tau, off in ((0.05, 5e-4), (0.1, 0.0))]
    settled = [gs.metrics(record)["step_response"][0]["settling_time"] for record in records]
    assert settled == pytest.approx([0.05 * np.log(0.99 / 0.01), 0.1 * np.log(50)], abs=2e-3)
    left = 50 * np.exp(-(0.901 - 0.1) / 0.1)
    text = verdict_of(page := page_of_records(records, ["fast", "slow"]))[1]
    told = [words_of(each) for each in elements(page, "//dl[@class='numbers']/div/dt")]
    kinds = ("position error, at the end", "z: rise time", "z: settling time")
    assert told == [f"{kind}: {name}" for kind in kinds for name in ("fast", "slow")]
    assert text.startswith("slow follows best, within ")
    assert left <= float(text.split()[4]) <= 1.1 * left
    assert "after settling; fast within 0.51 mm; z: " in text
    rises = re.search(r"; z: rise time (\S+) s \(fast\) and (\S+) s \(slow\)$", text)
    assert rises is not None
    assert [*map(float, rises.groups())] == pytest.approx([0.05 * np.log(9), 0.1 * np.log(9)], rel=0.05)


@pytest.mark.parametrize(
    "other",
    [
        {"duration": 7.0},
        {"experiment": {"reference": {"kind": "sine"}}},
        {"outcome": {"status": "diverged", "time": 0.5, "cause": None}},
    ],
)
def test_nothing_is_best_where_runs_had_different_tasks_or_did_not_complete(other: dict[str, Any]) -> None:
    page = page_of_records([waving_record(BASE, size=0.04), waving_record(BASE, size=0.02, **other)], ["a", "b"])
    assert not any("★" in text for row in side_by_side(page).values() for text in row)
    assert "best" not in verdict_of(page)[1].replace("none is best", "")


def test_nothing_is_best_where_a_loop_oscillates_and_its_outcome_says_so() -> None:
    """Expected: an error of leg 5 made of 40 Hz and 3 mm, in words; the other run completed and is named as such."""
    sound = waving_record(BASE, size=0.0)
    page = page_of_records([sound, oscillating(sound)], ["still", "shaking"])
    rows = side_by_side(page)
    assert rows["outcome"][0] == "completed at 0.5 s"
    assert says_it_oscillates(rows["outcome"][1])
    assert not any("★" in text for row in rows.values() for text in row)
    (note,) = elements(page, "//p[@class='note warning']")
    said = words_of(note).removeprefix("!")
    assert said.startswith("shaking: ")
    assert says_it_oscillates(said.removeprefix("shaking: "))
    assert verdict_of(page)[0] == "marginal"


def test_runs_side_by_side_have_every_metric_and_its_best() -> None:
    """Expected: three runs with the numbers of their metrics in words and units; the best marked of those that rank."""
    records = [record_of(0.03), record_of(0.02), record_of(0.025)]
    found = [gs.metrics(each) for each in records]
    rows = side_by_side(page_of_records(records, ["a", "b", "c"]))
    assert rows.pop("") == ("a", "b", "c")
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
        numbers = [float(text.removeprefix("★ ")) for text in texts]
        assert numbers == pytest.approx([factor * value for value in values], rel=1e-3), name
        assert [text.startswith("★") for text in texts] == [k == top for k in range(3)], name
    assert list(rows)[:7] == ["outcome", *list(words)[:6]]


def test_values_that_read_alike_are_equally_good() -> None:
    """Expected: of errors of 1, 2 and 1.00001 mm the first and the last are best; rounding alone marks nobody."""
    still = waving_record(BASE, rows=20, size=0.0)
    off = [changed(still, error__position=[size, 0, 0]) for size in (1e-3, 2e-3, 1.00001e-3)]
    for records, marks in ((off, [True, False, True]), (off[::2], [False, False])):
        rows = side_by_side(page_of_records(records, [f"run {k}" for k in range(len(records))]))
        assert [text.startswith("★") for text in rows["position error, RMS [mm]"]] == marks


def test_charts_have_the_limits_and_faults_that_all_runs_share() -> None:
    """Expected: the ends of the stroke and one fault; not two limits of forces; every third of 2,501 rows."""
    faults = [{"at": 7.4, "cut": [2]}, {"at": 7.45, "cut": [3]}]
    runs = [record_of(rows=2501, force_limit=110.0 + n, experiment={"fault": faults[:n]}) for n in (2, 1)]
    data = data_of(page := page_of_records(runs, ["a", "b"]))
    marks = {title: [mark["value"] for mark in chart["marks"]] for title, chart in charts_of(page).items()}
    assert (marks["actuator force"], marks["length of legs"]) == ([7.4], [2.3, 3.85, 7.4])
    assert [data["arrays"][scene["arrays"]["time"]]["n"] for scene in data["scenes"]] == [835, 835]


def test_what_differs_between_the_files_comes_first() -> None:
    """Expected: the keys with other values, of tables, lists and machines; nothing that all have."""
    heavy = replace(BASE, platform_mass=1300.0)
    files = [
        {"controller": {"bandwidth": 2.0, "type": "pd"}, "disturbance": [{"at": 0.1}, {"at": 0.2}]},
        {"controller": {"bandwidth": 4.0, "type": "pd"}, "disturbance": [{"at": 0.1}, {"at": 0.3}]},
        {"controller": {"bandwidth": 4.0, "type": "pd", "damping": 0.7}, "disturbance": [{"at": 0.1}, {"at": 0.2}]},
    ]
    records = [waving_record(BASE, rows=9, experiment=file) for file in files]
    records[2] = gs.Record(records[2].table, {**records[2].metadata, "platform": plain(heavy)})
    assert rows_below(page_of_records(records, ["a", "b", "c"]), "What differs between the runs") == {
        "setting": ("a", "b", "c"),
        "controller.bandwidth": ("2 Hz", "4 Hz", "4 Hz"),
        "disturbance[2].at": ("0.2 s", "0.3 s", "0.2 s"),
        "controller.damping": ("–", "–", "0.7"),
        "machine.platform_mass": (f"{BASE.platform_mass:.6g} kg", f"{BASE.platform_mass:.6g} kg", "1300 kg"),
    }


def test_what_differs_between_the_files_is_said_first() -> None:
    """Expected: by hand, in the order of the files; no names; long values and more than four keys are counted only."""
    keys = {"title": "t{}", "a": "{}", "b": "b{}", "c": 60 * "{}", "d": "d{}", "e": "e{}", "f": "f{}"}
    records = []
    for k in (1, 2):
        own = {key: text.format(*[k] * 60) for key, text in keys.items()}
        records.append(waving_record(BASE, rows=9, experiment={**own, "same": 5}))
    (lead,) = elements(page_of_records(records, ["one", "two"]), "//p[@class='lead']")
    assert lead.text_content() == "They differ in a (1, 2), b (b1, b2), c, d (d1, d2) and 2 more"
    assert elements(page_of_records([records[0]] * 2, ["one", "two"]), "//p[@class='lead']") == []


def test_charts_show_the_runs_over_each_other_and_each_minus_the_first() -> None:
    """Expected: six sines that differ by a sine, by other clocks; a row's line is off by (2π f h)²/8 at most."""
    records = [waving_record(BASE, rows=501, size=0.04), waving_record(BASE, rows=251, size=0.03, step=1.7e-3)]
    page = page_of_records(records, ["long", "short"])
    charts = charts_of(page)
    actual = [each for each in charts["position from home"]["series"] if each["role"] == "actual"]
    assert [(each["run"], each["component"]) for each in actual] == [(run, axis) for run in (0, 1) for axis in "xyz"]
    assert actual[5]["x"] == pytest.approx(records[1]["time"], abs=1e-12)
    change = charts["position from home, difference"]["series"]
    assert {(each["run"], each["role"]) for each in change} == {(1, "error")}
    (z,) = (each for each in change if each["component"] == "z")
    assert z["x"][-1] == pytest.approx(250 * 1.7e-3)
    amplitude = BASE.characteristic_length * (0.03 - 0.04)
    bound = 0.07 * BASE.characteristic_length * (2 * np.pi * 1.7e-3) ** 2 / 8 + 1e-7
    assert z["values"] == pytest.approx(amplitude * np.sin(2 * np.pi * z["x"]), abs=bound)
    assert np.ptp(z["values"]) > 100 * bound
    assert [scene["run"] for scene in data_of(page)["scenes"]] == [0, 1]


@pytest.mark.parametrize("later", [0.0, 0.06, 5.0])
def test_a_difference_is_of_the_times_that_both_records_span(later: float) -> None:
    """Expected: of lines 2t + 3 and 5 - t, -3t + 2 at the times of both; none without a common span."""
    first, other = (waving_record(BASE, rows=rows, size=0.0, step=step) for rows, step in ((12, 0.01), (30, 0.007)))
    one, two = first["time"], other["time"] + later
    lines = [1e-3 * np.outer(line, np.ones(3)) for line in (2 * one + 3, 5 - two)]
    first = changed(first, error__position=lines[0], actuator_force=np.outer(one, np.ones(6)))
    other = changed(other, error__position=lines[1], actuator_force=np.outer(two, np.ones(6)))
    sums = np.cumsum(np.full(12, 0.01)) - 0.01
    records = [first, *(gs.Record(r.table.with_columns(time=t), r.metadata) for r, t in ((other, two), (first, sums)))]
    charts = charts_of(page_of_records(records, ["a", "b", "c"]))
    error, force = (charts[f"{name}, difference"]["series"] for name in ("position error", "actuator force"))
    common = np.union1d(one, two)
    common = common[(common >= two[0]) & (common <= one[-1] + 1e-9)]
    assert {each["run"] for each in error} == ({2} if later == 5.0 else {1, 2})
    for each in (*error, *force):
        assert each["x"] == pytest.approx(common if each["run"] == 1 else one, abs=1e-9)
        if each["run"] == 2:
            assert not each["values"].any()
    for each in (each for each in error if each["run"] == 1):
        assert each["values"] == pytest.approx(1e-3 * (2 - 3 * common), abs=1e-8)
    held = [max(t for t in clock if t <= now + 1e-12) for clock in (one, two) for now in common]
    for each in (each for each in force if each["run"] == 1):
        assert each["values"] == pytest.approx(np.subtract(held[len(common) :], held[: len(common)]), abs=1e-5)
