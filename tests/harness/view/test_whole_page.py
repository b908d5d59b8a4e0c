"""Everything that a page of runs is made of, recomputed from the columns of uneven records at uneven settings."""

import json
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import lxml.html
import numpy as np
import polars
import pytest
from scipy.spatial.transform import Rotation

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.output.colours import COLOURS
from gough_stewart.harness.output.tables import Named, Sheet
from gough_stewart.harness.results.metrics import metrics
from gough_stewart.harness.results.record import Record, plain
from gough_stewart.harness.results.scene import frame_rows, leg_parts, nearness_to_limits
from gough_stewart.harness.results.signals import SHOWN
from gough_stewart.harness.view import file as view_file
from gough_stewart.harness.view.comparison import comparison_table
from gough_stewart.harness.view.file import view
from gough_stewart.harness.view.page import names_of, view_page
from gough_stewart.harness.view.scene import packed_scene
from gough_stewart.harness.view.tables import limits_sheet, parameters_sheet, run_sheet, versions_sheet
from gough_stewart.model.errors import OutputError
from gough_stewart.model.kinematics import joint_angles
from gough_stewart.model.vectors import FloatArray
from tests.support.uneven_records import BELIEVED, MACHINE, OTHER, ROWS, RUN, numbers, record_of


def rows_of(sheet: Sheet) -> list[tuple[str, ...]]:
    return [tuple(f"{c.what} [{c.unit}]" if isinstance(c, Named) else c for c in row) for row in sheet.rows]


def test_the_scene_has_the_bodies_and_every_frame() -> None:
    """Expected: joints of the machine, poses as position and quaternion by SciPy, values of the rows that are kept.

    Flags hold from a frame to the next if any row between has one, of any leg.
    """
    scene = packed_scene(RUN, MACHINE, "a name", frames=40)
    rows = [*range(0, ROWS, 8), 300]
    assert frame_rows(ROWS, 40).tolist() == rows
    assert (scene["name"], scene["rows"]) == ("a name", ROWS)
    assert scene["base"] == MACHINE.base_points.tolist()
    assert scene["platform"] == MACHINE.platform_points.tolist()
    assert numbers(scene["time"]) == pytest.approx(RUN["time"][rows], rel=1e-15)
    for key, position, orientation in (
        ("pose", RUN["position"], RUN["orientation"]),
        ("reference", RUN["reference.position"], RUN["reference.orientation"]),
    ):
        poses = numbers(scene[key], 7)
        assert poses[:, :3] == pytest.approx(position[rows])
        wanted = Rotation.from_euler("xyz", orientation[rows].copy())
        assert np.abs((Rotation.from_quat(poses[:, 3:]).inv() * wanted).magnitude()).max() < 1e-12
    home = np.array(scene["home"])
    assert home[:3] == pytest.approx(MACHINE.home_position)
    turned = Rotation.from_euler("xyz", MACHINE.home_orientation.copy())
    assert (Rotation.from_quat(home[3:]).inv() * turned).magnitude() < 1e-12
    for key, name, width in (
        ("orientation", "orientation", 3),
        ("length", "leg_length", 6),
        ("force", "actuator_force", 6),
        ("external_force", "external_force", 3),
    ):
        assert numbers(scene[key], width) == pytest.approx(RUN[name][rows], rel=1e-15)
    assert scene["flags"].keys() == {"force_limited", "rate_limited", "stroke_exceeded"}
    for name, said in scene["flags"].items():
        up = np.asarray(RUN[f"flag.{name}"], dtype=bool)
        assert said == "".join(str(int(up[a:b].any())) for a, b in pairwise(rows))
    assert "1" in scene["flags"]["rate_limited"]
    assert "0" in scene["flags"]["rate_limited"]
    assert scene["nearness"]["of"] == ["stroke", "force", "velocity", "power", "joint angle"]
    worst = numbers(scene["nearness"]["values"], 6)
    assert worst == pytest.approx(np.max([each[rows] for each in _nearness_parts(rows)], axis=0), rel=1e-12)
    assert (scene["lower"], scene["upper"]) == leg_parts(RUN["leg_length"], MACHINE)
    bare = Record(
        RUN.table.select(c for c in RUN.table.columns if not c.startswith(("reference", "flag"))).with_columns(
            **{f"external_force[{k}]": np.zeros(ROWS) for k in (1, 2, 3)}
        ),
        {**RUN.metadata, "force_limit": None},
    )
    limitless = replace(
        MACHINE, leg_length_min=None, leg_velocity_max=None, actuator_power_max=None, joint_angle_max=None
    )
    empty = packed_scene(bare, limitless, "b")
    assert [empty[key] for key in ("reference", "external_force", "nearness", "flags")] == [None, None, None, {}]


def _nearness_parts(rows: list[int]) -> list[FloatArray]:
    """By their definitions; power counts the velocity at both ends of a row, here of the rows that are kept."""
    length, force, velocity = RUN["leg_length"], RUN["actuator_force"], np.abs(RUN["leg_velocity"])
    later = velocity.copy()
    for k, row in enumerate(rows):
        later[row] = np.maximum(velocity[row], velocity[rows[min(k + 1, len(rows) - 1)]])
    pose = (RUN["position"], RUN["orientation"], MACHINE.home_position, MACHINE.home_orientation)
    return [
        np.abs(length - (2.3 + 3.85) / 2) / ((3.85 - 2.3) / 2),
        np.abs(force) / 110.0,
        velocity / 0.6,
        np.abs(force) * later / 45.0,
        np.maximum(*joint_angles(MACHINE, *pose)) / 0.7,
    ]


def test_limits_count_for_themselves() -> None:
    """Expected: a stroke needs both ends, a force the limit of the loop; each limit is there if it is stated alone."""
    none = replace(
        MACHINE,
        leg_length_min=None,
        leg_length_max=None,
        leg_velocity_max=None,
        actuator_power_max=None,
        joint_angle_max=None,
    )
    without = Record(RUN.table, {**RUN.metadata, "force_limit": None})
    for name, value, key in (
        ("leg_velocity_max", 0.6, ["velocity"]),
        ("actuator_power_max", 45.0, ["power"]),
        ("joint_angle_max", 0.7, ["joint angle"]),
        ("leg_length_min", 2.3, []),
        ("leg_length_max", 3.85, []),
    ):
        assert list(nearness_to_limits(without, replace(none, **{name: value}))) == key  # type: ignore[arg-type]
    assert list(nearness_to_limits(RUN, none)) == ["force"]


@pytest.mark.parametrize(("low", "high"), [(2.9, 3.0), (1.5, 2.9), (2.0, 3.9)])
def test_legs_are_drawn_for_the_lengths_allowed_as_well(low: float, high: float) -> None:
    """Expected: of lengths from 2.4 m to 3.5 m and limits 2.3 m and 3.85 m: the widest of both; by hand.

    The longest is spanned with 6 % of overlap, each part is at most 97 % of the shortest.
    """
    lower, upper = leg_parts(np.array([[low, high]]), MACHINE)
    shortest, longest = min(low, 2.3), max(high, 3.85)
    assert lower == pytest.approx(min(0.97 * shortest, 0.53 * longest))
    assert upper == pytest.approx(min(0.97 * shortest, 1.06 * longest - lower))


def test_the_table_of_a_run() -> None:
    """Expected: by hand, what was set, six digits, empty settings left out, every part of lists and tables."""
    sheet = run_sheet(RUN, BELIEVED)
    assert (sheet.title, sheet.heads) == ("Run", ("", ""))
    assert rows_of(sheet) == [
        ("outcome", "completed at 0.3 s"),
        ("plant", "fmu3"),
        ("platform", "uneven"),
        ("rows", "301"),
        ("duration [s]", "0.3"),
        ("sample time [s]", "0.002"),
        ("plant step [s]", "0.001"),
        ("force limit [N]", "110"),
        ("reference", "type sine, frequency 2.12346, position_amplitude 0.01, 0, 0.03"),
        ("controller", "type pd, gains 1, 2.5; 3, 4"),
        ("loop", "duration 0.3"),
        ("sensors", "noise leg_length 5e-06"),
        ("disturbance", "at 0.02, force 1, 2, 3"),
        ("disturbance", "at 0.04"),
    ]
    bare = Record(RUN.table, {"outcome": {**RUN.metadata["outcome"], "cause": "a cause"}, "platform": plain(BELIEVED)})
    assert rows_of(run_sheet(bare, BELIEVED)) == [
        ("outcome", "completed at 0.3 s: a cause"),
        ("plant", "–"),
        ("platform", "uneven"),
        ("rows", "301"),
    ]
    every = ("reference", "controller", "loop", "sensors", "actuators", "limits", "start", "change", "disturbance")
    full = Record(RUN.table, {**RUN.metadata, "experiment": {name: {"k": n} for n, name in enumerate(reversed(every))}})
    assert rows_of(run_sheet(full, BELIEVED))[8:] == [(name, f"k {8 - n}") for n, name in enumerate(every)]


def test_the_table_of_limits_and_flags() -> None:
    """Expected: the largest share by leg in percent, and the time of the row at which each leg first had a flag."""
    sheet = limits_sheet(RUN, MACHINE)
    assert sheet is not None
    assert (sheet.title, sheet.heads) == ("Limits and flags", ("", *"123456"))
    parts = dict(
        zip(("stroke", "force", "velocity", "power", "joint angle"), _nearness_parts(list(range(ROWS))), strict=True)
    )
    time, expected = RUN["time"], []

    def firsts(name: str, up: Any) -> tuple[str, ...]:
        rows = [next((k for k in range(ROWS) if up[k, leg]), None) for leg in range(6)]
        return (name, *("never" if k is None else f"{time[k]:.6g}" for k in rows))

    for name, values in parts.items():
        shares = tuple(f"{100 * values[:, leg].max():.4g}" for leg in range(6))
        expected.append((f"{name}, most of its limit [%]", *shares))
        if name in ("velocity", "power"):
            expected.append(firsts(f"{name}, first beyond its limit at [s]", values > 1))
    for name in ("force limited", "rate limited", "stroke exceeded"):
        up = np.asarray(RUN[f"flag.{name.replace(' ', '_')}"], dtype=bool)
        expected.append(firsts(f"{name}, first at [s]", up))
    assert rows_of(sheet) == expected
    assert {cell == "never" for row in expected for cell in row[1:]} == {True, False}
    assert sum("first beyond" in row[0] and any(c != "never" for c in row[1:]) for row in expected) == 2


def test_the_tables_of_parameters_and_versions() -> None:
    """Expected: every parameter that is stated, in the order of the platform, and the belief only where it differs."""
    sheet = parameters_sheet(MACHINE, BELIEVED)
    assert (sheet.title, sheet.heads) == ("Platform: machine", ("", "machine", "believed"))
    rows = {row[0]: row[1:] for row in rows_of(sheet)}
    stated = [name for name, value in MACHINE.as_dict().items() if value is not None and name != "name"]
    assert [name.partition(" [")[0] for name in rows] == stated
    assert rows["platform_mass [kg]"] == ("13", "11.5")
    assert rows["leg_length_max [m]"] == ("3.85", "3.9")
    assert rows["leg_acceleration_max [m/s2]"] == ("2.5", "–")
    assert rows["gravity [m/s2]"] == ("0.9, -1.3, -9.4", "")
    assert rows["source"] == ("made up for tests", "")
    assert rows["base_points [m]"][0].split("; ")[3] == "1.98, -0.49, -0.08"
    assert rows["leg_viscous_friction_factor [1]"] == ("0.7, 1.4, 0.9, 1.6, 0.5, 1.1", "")
    assert [row[0] for row in rows.items() if row[1][1]] == [
        "platform_mass [kg]",
        "leg_length_max [m]",
        "leg_acceleration_max [m/s2]",
    ]
    same = parameters_sheet(BELIEVED, BELIEVED)
    assert (same.title, same.heads) == ("Platform: uneven", ("", ""))
    assert {len(row) for row in same.rows} == {2}
    versions = versions_sheet(RUN)
    assert (versions.title, versions.heads, rows_of(versions)) == (
        "Versions",
        ("", ""),
        [("python", "3.x"), ("numpy", "2.y")],
    )


def elements(page: bytes, path: str) -> list[Any]:
    found: Any = lxml.html.fromstring(page.decode()).xpath(path)
    return list(found)


def test_the_texts_of_a_page_of_one_run() -> None:
    """Expected: title, description, platform and plant; how many rows and points are shown; all tables in order."""
    page = view_page([RUN], ["folder"], [_more()])
    assert elements(page, "//title/text()") == elements(page, "//h1/text()") == ["uneven run"]
    text = " ".join(elements(page, "//header")[0].text_content().split())
    assert "six <sines> — platform uneven, plant fmu3" in text
    footer = " ".join(elements(page, "//footer")[0].text_content().split())
    assert "The animation shows 301 of 301 rows, interpolated linearly" in footer
    assert "smallest and the largest value in each of 400 intervals of time" in footer
    captions = elements(page, "//caption/text()")
    assert captions == ["More", "Tracking error", "Legs", "Limits and flags", "Run", "Platform: machine", "Versions"]
    assert elements(page, "//h2/text()") == ["Curves", "Results", "Metrics"]
    assert [e.get("aria-label") for e in elements(page, "//div[@role='group' and .//caption]")] == captions
    described = Record(RUN.table, {**RUN.metadata, "experiment": {}, "plant": None})
    text = " ".join(elements(view_page([described], ["x"]), "//header")[0].text_content().split())
    assert "made up for tests — platform uneven" in text
    assert "plant" not in text
    unknown = {key: value for key, value in RUN.metadata.items() if key != "experiment"}
    text = " ".join(elements(view_page([Record(RUN.table, unknown)], ["x"]), "//header")[0].text_content().split())
    assert "made up for tests — platform uneven, plant fmu3" in text


def _more() -> Sheet:
    sheet = Sheet("More", ("", "a"))
    sheet.add("b", "c")
    return sheet


def test_the_texts_of_a_page_of_several_runs() -> None:
    """Expected: names, boxes in order, how the second ended, and of each its own tables; frames are shared."""
    ended = {"status": "diverged", "time": 7.6, "cause": "far <away>"}
    second = Record(OTHER.table, {**OTHER.metadata, "outcome": ended})
    page = view_page([RUN, second, record_of(0.025)], ["one <1>", "two", "three"])
    assert elements(page, "//h1/text()") == ["one <1> · two · three"]
    heads = elements(page, "//label[@class='record']")
    assert [head.text_content().strip() for head in heads] == [
        "one <1>", "two diverged at 7.6 s: far <away>", "three"
    ]  # fmt: skip
    assert [head.xpath("input/@data-record")[0] for head in heads] == ["0", "1", "2"]
    assert [head.xpath("span/@style")[0] for head in heads] == [f"background:{c}" for c in COLOURS[:3]]
    text = " ".join(elements(page, "//header")[0].text_content().split())
    assert "several runs overlaid" in text
    footer = " ".join(elements(page, "//footer")[0].text_content().split())
    assert "301 of 301 rows, 211 of 211 rows, 301 of 301 rows" in footer
    assert "each of 133 intervals" in footer
    summaries = [" ".join(s.text_content().split()) for s in elements(page, "//details/summary")]
    assert summaries[:3] == [f"{name}: all metrics, run, parameters, versions" for name in ("one <1>", "two", "three")]
    errors = elements(
        page, "//details//caption[text()='Tracking error']/../tbody/tr[starts-with(th, '|position|')]/td[2]/text()"
    )
    peaks = [metrics(each)["tracking"]["position"]["norm_peak"] for each in (RUN, second, record_of(0.025))]
    assert [float(text) for text in errors] == pytest.approx([1e3 * peak for peak in peaks], rel=1e-3)
    data = json.loads(elements(page, "//script[@id='data']")[0].text)
    assert data["colours"] == list(COLOURS)
    assert [share for share, _ in data["nearness"]["stops"]] == [0.0, 0.5, 0.8, 1.0]
    assert [scene["name"] for scene in data["scenes"]] == ["one <1>", "two", "three"]
    assert data["chart"]["shown"] == list(SHOWN)
    outcomes = elements(page, "//caption[text()='Run']/../tbody/tr[th='outcome']/td/text()")
    assert outcomes == ["completed at 0.3 s", "diverged at 7.6 s: far <away>", "completed at 0.3 s"]


def test_runs_side_by_side_have_every_metric_and_its_best() -> None:
    """Expected: three runs with the numbers of their metrics in words and units; the best marked of those that rank."""
    records = [record_of(0.03), record_of(0.02), record_of(0.025)]
    found = [metrics(each) for each in records]
    table: Any = lxml.html.fromstring(comparison_table(records, found, ["a", "b", "c"]))
    assert [cell.text_content() for cell in table.xpath("thead//th")] == ["a", "b", "c"]
    assert table.xpath("caption")[0].text_content() == "Runs side by side ★ best of the row"
    rows = {r.xpath("th")[0].text_content(): [c.text_content() for c in r.xpath("td")] for r in table.xpath("tbody/tr")}
    # by the words that are shown: path in the metrics, factor, and which run is best
    words = {
        "position error, RMS mm": (("tracking", "position", "norm_rms"), 1e3, 1),
        "position error, peak mm": (("tracking", "position", "norm_peak"), 1e3, 1),
        "orientation error, RMS deg": (("tracking", "orientation", "norm_rms"), 180 / np.pi, 1),
        "orientation error, peak deg": (("tracking", "orientation", "norm_peak"), 180 / np.pi, 1),
        "stroke margin mm": (("stroke", "margin"), 1e3, 1),
        "work, net J": (("energy", "net_total"), 1.0, None),
        "work, absolute J": (("energy", "absolute_total"), 1.0, 1),
    }  # fmt: skip
    for name, (path, factor, top) in words.items():
        values: list[Any] = list(found)
        for key in path:
            values = [value[key] for value in values]
        texts = rows[name]
        assert [float(text.removeprefix("★ ")) for text in texts] == pytest.approx(
            [factor * value for value in values], rel=1e-3
        ), name
        assert [text.startswith("★") for text in texts] == [k == top for k in range(3)], name
    assert list(rows)[:5] == ["outcome", *list(words)[:4]]
    order = [name.split(",")[0].split(" ")[0] for name in rows]
    starts = [
        order.index(word) for word in ("outcome", "position", "orientation", "leg", "peak", "work", "force", "stroke")
    ]
    assert starts == sorted(starts)
    assert not any(word in name for name in rows for word in (" at", "first exceeded"))
    step = {"axis": "z", "from": 1.0, "to": 1.05, "at": 7.4, "overshoot_percent": 12.5, "rise_time": 0.1}
    stepped = {**found[0], "step_response": [{**step, "settling_time": 0.3, "final_error": 1.5e-3}]}
    whole: Any = lxml.html.fromstring(comparison_table([records[0]], [stepped], ["a"]))
    cells = {r.xpath("th")[0].text_content(): r.xpath("td")[0].text_content() for r in whole.xpath("tbody/tr")}
    of_axes = [
        f"{what} error, {kind} {unit}"
        for what, unit in (("position", "mm"), ("orientation", "deg"))
        for kind in ("RMS", "peak")
    ]
    assert list(cells) == [
        "outcome", *of_axes, "leg error, RMS mm", "leg error, peak mm",
        "z: overshoot %", "z: rise time s", "z: settling time s", "z: final error mm",
        "peak force N", "RMS force N", "peak power W", "mean power W", "work, absolute J", "work, net J",
        "force limited %", "rate limited %", "stroke margin mm", "beyond stroke %",
        "leg velocity, of its limit %", "actuator force, of its limit %", "actuator power, of its limit %",
    ]  # fmt: skip
    assert [cells[f"z: {name}"] for name in ("overshoot %", "rise time s", "settling time s", "final error mm")] == [
        "12.5", "0.1", "0.3", "1.5",
    ]  # fmt: skip
    assert cells["rate limited %"] == f"{100 * found[0]['saturation']['rate_limited']['any']:.4g}"
    later = Record(records[1].table, {**records[1].metadata, "duration": 0.4})
    unlike = comparison_table([records[0], later], found[:2], ["a", "b"])
    assert "★" not in unlike


def test_a_page_is_written_where_it_was_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: names given, of folders, or titles, numbered where they are equal; steps are told; shown if asked."""
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    steps: list[str] = []
    made: list[list[str]] = []

    def page_of(_read: object, names: Sequence[str]) -> bytes:
        made.append(list(names))
        return b"page"

    monkeypatch.setattr(view_file, "view_page", page_of)
    out = tmp_path / "new" / "a.htm"
    assert view(RUN, out, progress=steps.append) == out
    assert (out.read_bytes(), opened, steps) == (b"page", [], ["reading", "writing the page"])
    view([RUN, OTHER, RUN], tmp_path / "b.html", show=True)
    assert opened == [(tmp_path / "b.html").as_uri()]
    view([RUN, OTHER], tmp_path / "b.html", names=["x", "y"])
    folder = tmp_path / "of a run"
    folder.mkdir()
    RUN.write_parquet(folder / "record.parquet")
    (folder / "metadata.json").write_bytes(RUN.to_metadata())
    view([folder, RUN], tmp_path / "b.html")
    view(str(folder / "record.parquet"), tmp_path / "b.html")
    assert made == [
        ["uneven run"],
        ["uneven run (1)", "other", "uneven run (3)"],
        ["x", "y"],
        ["of a run", "uneven run"],
        ["of a run"],
    ]
    untitled = Record(RUN.table, {key: value for key, value in RUN.metadata.items() if key != "title"})
    view(untitled, tmp_path / "b.html")
    assert made[-1] == ["record"]
    with pytest.raises(RecordError, match="1 names for 2 records; expected one per record"):
        view([RUN, OTHER], out, names=["x"])
    for wrong in ("page", "page.pdf", "html"):
        with pytest.raises(OutputError, match=f"{wrong}: expected the name of a page, such as {wrong}.html"):
            view(RUN, wrong)
    assert names_of([folder, folder / "record.parquet"]) == [str(folder), str(folder / "record.parquet")]
    assert isinstance(polars.read_parquet(folder / "record.parquet"), polars.DataFrame)
