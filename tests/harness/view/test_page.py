"""The page of runs: what it carries, before any browser has seen it."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars
import pytest

from gough_stewart import GoughStewartError, Platform, Record, metrics, view
from gough_stewart.harness.report.page import NEARNESS
from gough_stewart.harness.view import view as view_file
from gough_stewart.harness.view.view import MOST_RECORDS, names_of, view_page
from tests.support.arrays import FloatArray
from tests.support.colour_vision import BLIND, delta_e_76, delta_e_2000, lab, rgb_of
from tests.support.page_arrays import data_of, elements, unpacked
from tests.support.records import waving_record
from tests.support.uneven_records import OTHER, RUN


def scene_time(page: bytes, scene: int = 0) -> FloatArray:
    data = data_of(page)
    return unpacked(data["arrays"][data["scenes"][scene]["arrays"]["time"]])


@pytest.fixture(scope="module")
def record(platform: Platform) -> Record:
    return waving_record(platform, rows=4001)


@pytest.fixture(scope="module")
def page(record: Record) -> bytes:
    return view_page([record], ["waves"])


def test_the_page_is_one_element_tree_with_everything_inside(page: bytes) -> None:
    """Expected: no element that would load something, a policy that forbids it, tables with the metrics' numbers."""
    assert elements(page, "//script[@src] | //link[not(starts-with(@href, 'data:'))] | //img | //iframe") == []
    (policy,) = elements(page, "//meta[@http-equiv='Content-Security-Policy']/@content")
    assert policy.startswith("default-src 'none'")
    assert "http" not in policy
    titles = [each.text_content() for each in elements(page, "//caption")]
    assert {"Tracking error", "Legs", "Limits", "Run", "Platform: motion_base", "Versions"} <= set(titles)
    assert elements(page, "//h1/text()") == ["six sines"]


def test_tables_carry_the_metrics(record: Record, page: bytes) -> None:
    (row,) = elements(page, "//caption[text()='Legs']/../tbody/tr[starts-with(th, 'peak force')]")
    shown = [float(cell.text.removesuffix(" N")) for cell in row.xpath("td")[:6]]
    assert shown == pytest.approx(metrics(record)["force"]["peak"], rel=1e-3)


def test_the_same_record_gives_the_same_bytes(record: Record, page: bytes) -> None:
    assert view_page([record], ["waves"]) == page


@pytest.mark.parametrize("records", [1, pytest.param(6, marks=pytest.mark.evidence)])
def test_ten_seconds_at_a_kilohertz_make_at_most_six_megabytes(platform: Platform, records: int) -> None:
    """Expected: the bound that was set, for all signals of one run; six runs have more curves, and the same frames."""
    long = waving_record(platform, rows=10_001)
    page = view_page([long] * records, [f"run {k}" for k in range(records)])
    assert len(page) <= (6e6 if records == 1 else 15e6)


def test_text_of_the_user_stays_text(platform: Platform) -> None:
    """Expected: markup in a title, name or cause is shown, not obeyed."""
    bad = "</script><script>alert(1)</script><b>%{x}"
    ended = {"status": "diverged", "time": 0.1, "cause": bad}
    named = replace(platform, name=bad)
    record = waving_record(named, rows=5, title=bad, outcome=ended, experiment={"description": bad})
    for page in (view_page([record], [bad]), view_page([record, record], [bad, "b"])):
        assert elements(page, "//script[contains(., 'alert(1)') and not(@type)] | //b[.='%{x}']") == []
        assert bad in elements(page, "//h1")[0].text_content()
        assert bad in elements(page, "//section")[0].text_content()
    assert data_of(page)["scenes"][0]["name"] == bad


def test_a_page_starts_with_verdict_numbers_and_picture(record: Record, page: bytes) -> None:
    """Expected: before any table or chart; the number of the peak error is that of the metrics."""
    (first,) = elements(page, "//main/section[1]")
    assert first.get("class") == "first"
    parts = first.xpath(".//p[starts-with(@class, 'verdict')] | .//dl | .//*[@id='view']")
    order = [each.get("id") or each.get("class") for each in parts]
    assert order == [order[0], "numbers", "view"]
    assert order[0].startswith("verdict ")
    assert first.xpath(".//table") == []
    (peak,) = (each for each in first.xpath(".//dl/div") if "position error" in each.text_content())
    expected = 1e3 * metrics(record)["tracking"]["position"]["norm_peak"]
    assert float(peak.xpath("dd/b/text()")[0]) == pytest.approx(expected, rel=1e-3)


def test_every_row_of_every_signal_is_on_the_page(record: Record, page: bytes) -> None:
    """Expected: the columns of the record in the unit of display, to a millionth of their range or the resolution."""
    data = data_of(page)
    charts = {chart["title"]: chart for chart in data["charts"]}
    for title, name, factor, resolution in (
        ("position error", "error.position", 1e3, 1e-3), ("actuator force", "actuator_force", 1.0, 1e-3),
    ):  # fmt: skip
        chart = charts[title]
        time = unpacked(data["arrays"][chart["x"]["values"]])
        assert time == pytest.approx(record["time"], abs=1e-12)
        found = [unpacked(data["arrays"][each["values"]]) for each in chart["series"] if each["role"] != "reference"]
        wanted = record[name].T
        assert len(found) == len(wanted)
        for curve, column in zip(found, wanted, strict=True):
            allowed = max(np.ptp(factor * column) / 2**20, resolution)
            assert chart["y"]["factor"] * curve == pytest.approx(factor * column, abs=allowed)
    assert {"mm", "N"} <= {chart["y"]["unit"] for chart in data["charts"]}
    assert all(f"[{chart['y']['unit']}]" in chart["y"]["title"] for chart in data["charts"] if chart["y"]["unit"])
    assert {chart["x"]["title"] for chart in data["charts"]} == {"time [s]"}


@pytest.mark.parametrize(
    ("name", "value"),
    [("position[3]", np.nan), *((name, -1.5e9) for name in ("orientation[2]", "leg_length[6]", "actuator_force[5]"))],
)
def test_rows_beyond_what_can_be_drawn_are_left_out(name: str, value: float) -> None:
    """Expected: rows up to the first of NaN or a value of 1e9 in any column that is drawn, of either sign."""
    values = RUN[name].copy()
    values[123:] = value
    page = view_page([Record(RUN.table.with_columns(**{name: values}), RUN.metadata)], ["x"])
    assert scene_time(page) == pytest.approx(RUN["time"][:123], abs=1e-12)
    values[:] = 1e9
    with pytest.raises(GoughStewartError, match="x: no row with finite values; there is nothing to show"):
        view_page([Record(RUN.table.with_columns(**{name: values}), RUN.metadata)], ["x"])


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_very_short_records_have_a_page(platform: Platform, rows: int) -> None:
    assert len(scene_time(view_page([waving_record(platform, rows=rows)], ["short"]))) == rows


@pytest.mark.parametrize("number", [0, MOST_RECORDS + 1])
def test_too_many_records_or_none_are_refused(record: Record, number: int) -> None:
    with pytest.raises(GoughStewartError, match=f"{number} records; expected 1 to {MOST_RECORDS}"):
        view_page([record] * number, ["x"] * number)


def test_a_record_without_a_platform_or_an_outcome_is_refused(record: Record) -> None:
    for name in ("platform", "outcome"):
        without = {key: value for key, value in record.metadata.items() if key != name}
        with pytest.raises(GoughStewartError, match=f"waves: the metadata have no {name}"):
            view_page([Record(record.table, without)], ["waves"])
    with pytest.raises(GoughStewartError, match="the metadata have no platform"):
        view_page([Record(record.table, {**record.metadata, "platform": {"wheels": 4}})], ["waves"])


@pytest.mark.parametrize("blind", BLIND)
def test_red_green_blind_readers_tell_the_middle_from_the_limit(blind: str) -> None:
    """Expected: ΔE ≥ 40 by either formula, simulated as by Machado et al. (2009); beyond the limit so by CIE76."""
    (_, middle), *_, (_, limit) = NEARNESS["stops"]
    seen_middle, seen_limit, beyond = (lab(rgb_of(each), BLIND[blind]) for each in (middle, limit, NEARNESS["beyond"]))
    assert delta_e_76(seen_middle, seen_limit) >= 40
    assert delta_e_2000(seen_middle, seen_limit) >= 40
    assert min(delta_e_76(beyond, seen_middle), delta_e_76(beyond, seen_limit)) >= 40


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
    with pytest.raises(GoughStewartError, match="1 names for 2 records; expected one per record"):
        view([RUN, OTHER], out, names=["x"])
    for wrong in ("page", "page.pdf", "html"):
        with pytest.raises(GoughStewartError, match=f"{wrong}: expected the name of a page, such as {wrong}.html"):
            view(RUN, wrong)
    assert names_of([folder, folder / "record.parquet"]) == [str(folder), str(folder / "record.parquet")]
    assert isinstance(polars.read_parquet(folder / "record.parquet"), polars.DataFrame)
