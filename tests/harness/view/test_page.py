"""The page of runs: what it carries, before any browser has seen it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gough_stewart import GoughStewartError, Platform, Record, metrics, view
from tests.harness.view.colour_vision import BLIND, delta_e_76, lab, rgb_of
from tests.support.arrays import FloatArray
from tests.support.page_arrays import charts_of, data_of, elements, rows_below, unpacked, words_of
from tests.support.records import waving_record
from tests.support.reports import page_of_records
from tests.support.uneven_records import OTHER, RUN


def scene_time(page: bytes) -> FloatArray:
    data = data_of(page)
    return unpacked(data["arrays"][data["scenes"][0]["arrays"]["time"]])


@pytest.fixture(scope="module")
def record(platform: Platform) -> Record:
    return waving_record(platform, rows=4001)


@pytest.fixture(scope="module")
def page(record: Record) -> bytes:
    return page_of_records([record], ["waves"])


def test_a_page_starts_with_verdict_numbers_and_picture_then_tables(record: Record, page: bytes) -> None:
    """Expected: before any table or chart; the numbers are those of the metrics."""
    (first,) = elements(page, "//main/section[1]")
    assert first.get("class") == "first"
    parts = first.xpath(".//p[starts-with(@class, 'verdict')] | .//dl | .//*[@id='view']")
    assert [each.get("id") or each.get("class").split()[0] for each in parts] == ["verdict", "numbers", "view"]
    assert first.xpath(".//table[@class != 'now']") == []
    measured: Any = metrics(record)
    (peak,) = (each for each in first.xpath(".//dl/div") if "position error" in each.text_content())
    expected = 1e3 * measured["tracking"]["position"]["norm_peak"]
    assert float(words_of(peak.find("dd/b"))) == pytest.approx(expected, rel=1e-3)
    titles = {each.text_content() for each in elements(page, "//caption")}
    assert {"Tracking error", "Legs", "Limits", "Run", "Platform: motion_base", "Versions"} <= titles
    forces = next(row for name, row in rows_below(page, "Legs").items() if name.startswith("peak force"))
    shown = [float(text.removesuffix(" N")) for text in forces[:6]]
    assert shown == pytest.approx(measured["force"]["peak"], rel=1e-3)
    assert elements(page, "//h1/text()") == ["six sines"]
    assert page_of_records([record], ["waves"]) == page


@pytest.mark.parametrize("records", [1, pytest.param(6, marks=pytest.mark.evidence)])
def test_ten_seconds_at_a_kilohertz_make_at_most_six_megabytes(platform: Platform, records: int) -> None:
    """Expected: the bound that was set, for all signals of one run; six runs have more curves, and the same frames."""
    long = waving_record(platform, rows=10_001)
    page = page_of_records([long] * records, [f"run {k}" for k in range(records)])
    assert len(page) <= (6e6 if records == 1 else 15e6)


def test_every_row_of_every_signal_is_on_the_page(record: Record, page: bytes) -> None:
    """Expected: the columns of the record in the unit of display, to a millionth of their range or the resolution."""
    charts = charts_of(page)
    for title, name, factor, resolution in (
        ("position error", "error.position", 1e3, 1e-3), ("actuator force", "actuator_force", 1.0, 1e-3),
    ):  # fmt: skip
        chart = charts[title]
        curves = [each for each in chart["series"] if each["role"] != "reference"]
        assert len(curves) == record[name].shape[1]
        for curve, column in zip(curves, record[name].T, strict=True):
            assert curve["x"] == pytest.approx(record["time"], abs=1e-12)
            allowed = max(np.ptp(factor * column) / 2**20, resolution)
            assert chart["y"]["factor"] * curve["values"] == pytest.approx(factor * column, abs=allowed)
    assert {"mm", "N"} <= {chart["y"]["unit"] for chart in charts.values()}
    assert all(f"[{chart['y']['unit']}]" in chart["y"]["title"] for chart in charts.values() if chart["y"]["unit"])
    assert {chart["x"]["title"] for chart in charts.values()} == {"time [s]"}
    assert 1 <= 10 ** data_of(page)["clock"]["digits"] * record["time"][1] / 2 < 10  # half a step is told


@pytest.mark.parametrize(
    ("name", "value"),
    [("position[3]", np.nan), *((name, -1.5e9) for name in ("orientation[2]", "leg_length[6]", "actuator_force[5]"))],
)
def test_rows_beyond_what_can_be_drawn_are_left_out(name: str, value: float) -> None:
    """Expected: rows up to the first of NaN or a value of 1e9 in any column that is drawn, of either sign."""
    values = RUN[name].copy()
    values[123:] = value
    page = page_of_records([Record(RUN.table.with_columns(**{name: values}), RUN.metadata)], ["x"])
    assert scene_time(page) == pytest.approx(RUN["time"][:123], abs=1e-12)
    values[:] = 1e9
    with pytest.raises(GoughStewartError, match="x: no row with finite values; there is nothing to show"):
        page_of_records([Record(RUN.table.with_columns(**{name: values}), RUN.metadata)], ["x"])


@pytest.mark.parametrize("rows", [1, 2])
def test_very_short_records_have_a_page(platform: Platform, rows: int) -> None:
    assert len(scene_time(page_of_records([waving_record(platform, rows=rows)], ["short"]))) == rows


def test_records_that_cannot_be_shown_are_refused(record: Record) -> None:
    for number in (0, 7):
        with pytest.raises(GoughStewartError, match=f"{number} records; expected 1 to 6"):
            page_of_records([record] * number, ["x"] * number)
    for changes, said in (
        ({"platform": None}, "waves: the metadata have no platform"),
        ({"platform": {"wheels": 4}}, "waves: the metadata have no platform"),
        ({"outcome": None}, "waves: the metadata have no outcome"),
    ):
        metadata = {name: value for name, value in {**record.metadata, **changes}.items() if value is not None}
        with pytest.raises(GoughStewartError, match=said):
            page_of_records([Record(record.table, metadata)], ["waves"])
    with pytest.raises(GoughStewartError, match="1 names for 2 records; expected one per record"):
        page_of_records([RUN, OTHER], ["x"])


@pytest.mark.parametrize("blind", BLIND)
def test_red_green_blind_readers_tell_the_middle_from_the_limit(blind: str, page: bytes) -> None:
    """Expected: ΔE ≥ 40 of CIE76, simulated as by Machado et al. (2009); beyond the limit, too."""
    colours = data_of(page)["nearness"]
    (_, middle), *_, (_, limit) = colours["stops"]
    seen_middle, seen_limit, beyond = (lab(rgb_of(each), BLIND[blind]) for each in (middle, limit, colours["beyond"]))
    assert delta_e_76(seen_middle, seen_limit) >= 40
    assert min(delta_e_76(beyond, seen_middle), delta_e_76(beyond, seen_limit)) >= 40


def test_a_page_is_written_where_it_was_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: names given, of folders, or titles, numbered where they are equal; steps are told; shown if asked."""
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    steps: list[str] = []
    out = tmp_path / "new" / "a.htm"
    assert view(RUN, out, progress=steps.append) == out
    assert (out.is_file(), opened, steps) == (True, [], ["reading", "writing the page"])
    folder = tmp_path / "of a run"
    folder.mkdir()
    RUN.write_parquet(folder / "record.parquet")
    (folder / "metadata.json").write_bytes(RUN.to_metadata())
    untitled = Record(RUN.table, {key: value for key, value in RUN.metadata.items() if key != "title"})
    for records, names in (
        ([RUN, OTHER, RUN], ["uneven run (1)", "other", "uneven run (3)"]),
        ([folder, RUN], ["of a run", "uneven run"]),
        (str(folder / "record.parquet"), ["of a run"]),
        ([folder, folder / "record.parquet"], [str(folder), str(folder / "record.parquet")]),
        (untitled, ["record"]),
    ):
        page = view(records, tmp_path / "b.html", show=True).read_bytes()  # type: ignore[arg-type]
        assert [scene["name"] for scene in data_of(page)["scenes"]] == names
    assert opened == 5 * [(tmp_path / "b.html").as_uri()]
