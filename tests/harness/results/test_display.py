"""Results that show themselves: a few lines in a terminal, tables and a picture in a notebook."""

import base64
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars
import pytest
from lxml import html

import gough_stewart as gs
from gough_stewart.harness.paper.reproduce import Reproduction
from gough_stewart.harness.report.figures import figures
from gough_stewart.harness.report.terminal import tables_text
from gough_stewart.harness.results.record import Record
from gough_stewart.harness.results.tables import metrics_tables
from tests.support.records import oscillating, says_it_oscillates, waving_record

BAD = '<script>alert(1)</script> & "so on"'


@pytest.fixture(scope="module")
def record() -> Record:
    """Six sines, 0.1 s of them, with the last row gone wild."""
    return waving_record(gs.load_preset("desktop_hexapod"), rows=101, title="six sines", plant="fmu2")


def test_a_record_says_what_it_is_in_a_few_lines(record: Record) -> None:
    """Expected: title, platform, plant, outcome, size, times, and the peaks of the errors, in mm and degrees."""
    lines = dict(re.split(r"\s{2,}", line.strip()) for line in repr(record).splitlines()[1:])
    assert repr(record).splitlines()[0] == "Record: six sines"
    assert lines["platform"] == "desktop_hexapod"
    assert lines["plant"] == "fmu2"
    assert lines["outcome"] == "completed at 0.1 s"
    assert lines["table"] == f"101 rows, {len(record.table.columns)} columns"
    assert lines["time"] == "0 to 0.1 s"
    for name, head in (
        ("position", "position"),
        ("orientation", "orientation"),
        ("leg_length", "leg length"),
    ):
        peak = max(abs(value) for k in range(1, 4) for value in record.table[f"error.{name}[{k}]"].to_list())
        if name == "leg_length":
            peak = max(abs(value) for k in range(1, 7) for value in record.table[f"error.{name}[{k}]"].to_list())
        factor = 180 / np.pi if name == "orientation" else 1000
        value, unit = lines[f"peak error of {head}"].split()
        assert float(value) == pytest.approx(factor * peak, rel=1e-3)
        assert unit == ("deg" if name == "orientation" else "mm")
    assert str(record) == repr(record)


def test_a_record_shows_itself_in_a_notebook(record: Record) -> None:
    """Expected: tables whose cells are those of the lines and of the metrics, and a PNG of the pose."""
    page = html.fragment_fromstring(record._repr_html_())
    captions = [each.text_content() for each in page.iter("caption")]
    assert captions == ["Record: six sines", "Tracking error", "Legs"]
    (image,) = page.iter("img")
    assert base64.b64decode(str(image.get("src")).partition("base64,")[2]).startswith(b"\x89PNG")
    assert "completed at 0.1 s" in page.text_content()


def test_what_users_write_is_text_in_a_notebook() -> None:
    """Expected: no element but those of tables and the picture, and the text as it was."""
    named = gs.Platform(**{**gs.load_preset("desktop_hexapod").as_dict(), "name": BAD, "source": BAD})
    ended = {"status": "stopped", "time": 0.1, "cause": BAD}
    odd = waving_record(named, rows=20, title=BAD, plant=BAD, outcome=ended)
    for text in (odd._repr_html_(), named._repr_html_()):
        page = html.fragment_fromstring(text, create_parent="div")
        allowed = {"div", "table", "caption", "thead", "tbody", "tr", "th", "td", "span", "img"}
        assert {str(each.tag) for each in page.iter()} <= allowed
        assert BAD in page.text_content()


@pytest.mark.parametrize("rows", [0, 1, 3])
def test_a_record_without_numbers_still_shows_itself(record: Record, rows: int) -> None:
    """Expected: lines and a table without what is not there; nothing is drawn where nothing is measured."""
    bare = Record(polars.DataFrame({"time": np.arange(float(rows)), "x": np.full(rows, np.nan)}), {})
    assert repr(bare).splitlines()[:2] == ["Record: untitled", f"  table  {rows} rows, 2 columns"] or rows == 0
    assert "<img" not in bare._repr_html_()
    lost = Record(record.table.with_columns(polars.lit(np.nan).alias("error.position[2]")).head(rows), record.metadata)
    assert "nan" not in repr(lost)
    assert lost._repr_html_().startswith("<div>")


def test_a_page_of_a_record_has_only_what_the_record_has(record: Record) -> None:
    """Expected: lines of what is known alone; metrics and a picture only with everything that they need."""
    known = record.metadata
    for key, head in (("platform", "platform"), ("plant", "plant"), ("outcome", "outcome"), ("title", None)):
        rest = Record(record.table, {name: value for name, value in known.items() if name != key})
        lines = repr(rest).splitlines()
        assert lines[0] == ("Record: untitled" if key == "title" else "Record: six sines")
        heads = [re.split(r"\s{2,}", line.strip())[0] for line in lines[1:]]
        expected = ["platform", "plant", "outcome", "table", "time"]
        assert heads[: len(expected) - (head is not None)] == [each for each in expected if each != head]
        assert ("<img" in rest._repr_html_()) == (key not in ("platform", "outcome"))
    assert "plant" not in repr(Record(record.table, {**known, "plant": None})).replace("platform", "")
    untitled = Record(record.table, {name: value for name, value in known.items() if name != "title"})
    assert 'alt="pose over time: untitled"' in untitled._repr_html_()
    assert 'alt="pose over time: six sines"' in record._repr_html_()
    for name in ("position", "orientation", "leg_length", "leg_velocity", "actuator_force"):
        rest = Record(record.table.drop(record.columns_of(name)), known)
        page = html.fragment_fromstring(rest._repr_html_())
        assert [each.text_content() for each in page.iter("caption")] == ["Record: six sines"]
        assert not list(page.iter("img"))


def test_metrics_print_as_the_command_does(record: Record) -> None:
    """Expected: the command's tables, 100 columns wide; and a dict for everything else."""
    found = gs.metrics(record)
    assert tables_text(metrics_tables(found)) == str(found)
    assert json.loads(json.dumps(found)) == dict(found)
    assert repr(found) == repr(dict(found))
    assert html.fragment_fromstring(found._repr_html_(), create_parent="div").findall(".//table")


def test_margins_print_the_worst_of_the_legs() -> None:
    """Expected: the legs' own numbers, of which the smallest room counts; and all of it in a notebook."""
    found = gs.margins("heave_step", {"reference.position": [0.3, 0.1, 2.1], "actuators.lag": 0.002})
    text = repr(found)
    assert text.startswith(f"Margins: {found.title}\n")
    assert f"disk margin {found.disk.alpha:.3g} at {found.disk.frequency:.3g} Hz" in text
    ups, downs = sorted(leg.gain_up for leg in found.legs), sorted(leg.gain_down for leg in found.legs)
    phases = sorted(np.degrees(leg.phase) for leg in found.legs)
    assert ups[0] < 0.98 * ups[-1]
    assert f"gain × {downs[-1]:.3g} to {ups[0]:.3g}, phase {phases[0]:.3g}°" in text
    page = html.fragment_fromstring(found._repr_html_(), create_parent="div")
    assert len(list(page.iter("table"))) == 4
    assert BAD not in replace(found, title=BAD)._repr_html_()


def test_a_reproduction_is_one_line_and_saves_its_files(tmp_path: Path) -> None:
    made = Reproduction({"agreement": [{"holds": True}, {"holds": False}]}, {"a.csv": b"1", "b.png": b"2"})
    assert repr(made) == "<Reproduction: 1 of 2 comparisons within their bounds; files a.csv, b.png>"
    assert [path.read_bytes() for path in made.save(tmp_path / "new")] == [b"1", b"2"]
    assert not made.agrees


def test_a_loop_that_oscillates_shows_it_everywhere() -> None:
    """Expected: leg 5, 40 Hz and 3 mm, as the record was made, in the lines, the tables and above the figures."""
    record = oscillating(waving_record(gs.load_preset("motion_base"), size=0.0))
    (line,) = (line for line in repr(record).splitlines() if line.split()[0] == "outcome")
    assert says_it_oscillates(line.removeprefix("  outcome").strip())
    before_tables = str(gs.metrics(record)).partition("Tracking error")[0]
    assert says_it_oscillates(" ".join(before_tables.split()))
    words = r"Leg 5 oscillates by 3\.\d mm at (39\.\d|40) Hz"
    assert re.match(words, record.report().verdict.text)
    drawing = figures(record.report(), ("svg",), "pose")["pose.svg"].decode()
    # a comment for each line of the title
    assert re.search(words, " ".join(re.findall(r"<!-- (.*?) -->", drawing, re.DOTALL)))
