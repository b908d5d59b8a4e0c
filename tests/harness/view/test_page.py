"""The page of a record: what it carries, before any browser has seen it."""

import base64
import json
import re
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import lxml.html
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.output.three import three
from gough_stewart.harness.results.metrics import metrics
from gough_stewart.harness.results.record import Record
from gough_stewart.harness.results.scene import FRAMES, frame_rows, leg_parts, nearness_to_limits
from gough_stewart.harness.view.page import MOST_RECORDS, names_of, view_page
from gough_stewart.harness.view.scene import NEARNESS, packed_scene
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.rotations import matrix_from_orientation, matrix_from_quaternion
from gough_stewart.model.vectors import FloatArray
from tests.support.colour_vision import BLIND, delta_e_76, delta_e_2000, lab, rgb_of
from tests.support.records import oscillating, says_it_oscillates, waving_record


def numbers(packed: dict[str, str], width: int | None = None) -> FloatArray:
    """Numbers (n,), or (n, width)."""
    values = np.frombuffer(base64.b64decode(packed["bdata"]), dtype=f"<{packed['dtype']}")
    return values if width is None else values.reshape(-1, width)


def elements(page: bytes, path: str) -> list[Any]:
    """What an XPath expression finds on the page."""
    found: Any = lxml.html.fromstring(page.decode()).xpath(path)
    return list(found)


def data_of(page: bytes) -> dict[str, Any]:
    """What the page's scripts are given."""
    (element,) = elements(page, "//script[@id='data']")
    found: dict[str, Any] = json.loads(element.text)
    return found


@pytest.fixture(scope="module")
def record(platform: Platform) -> Record:
    return waving_record(platform, rows=4001)


@pytest.fixture(scope="module")
def page(record: Record) -> bytes:
    return view_page([record], ["waves"])


@given(st.integers(1, 30_000), st.integers(1, 3000))
def test_frames_are_evenly_spaced_rows_with_first_and_last(rows: int, frames: int) -> None:
    kept = frame_rows(rows, frames)
    assert kept[0] == 0
    assert kept[-1] == rows - 1
    steps = np.diff(kept)
    assert len(set(steps[:-1])) <= 1
    assert len(kept) <= max(frames, 2)
    if rows <= frames:
        assert len(kept) == rows


def test_frames_hold_the_bits_of_their_rows(record: Record, platform: Platform) -> None:
    scene = packed_scene(record, platform, "waves", frames=101)
    rows = frame_rows(record.table.height, 101)
    assert np.array_equal(numbers(scene["time"]), record["time"][rows])
    assert np.array_equal(numbers(scene["pose"], 7)[:, :3], record["position"][rows])
    assert np.array_equal(numbers(scene["length"], 6), record["leg_length"][rows])
    assert np.array_equal(numbers(scene["force"], 6), record["actuator_force"][rows])
    assert np.array_equal(numbers(scene["reference"], 7)[:, :3], record["reference.position"][rows])


def test_quaternions_turn_as_the_orientation_does(record: Record, platform: Platform) -> None:
    """Expected: R = Rz Ry Rx of the record's own orientation; the quaternion comes from SciPy, its matrix from here."""
    scene = packed_scene(record, platform, "waves", frames=101)
    orientation = numbers(scene["orientation"], 3)
    turned = matrix_from_quaternion(numbers(scene["pose"], 7)[:, 3:])
    assert np.abs(turned - matrix_from_orientation(orientation)).max() < 1e-14


def test_a_flag_between_two_frames_is_not_lost(record: Record, platform: Platform) -> None:
    """Expected: nine rows in frames 0, 4, 8; a flag of row 3 holds until row 4, so in the first interval only."""
    few = record.table.head(9).with_columns(**{f"flag.force_limited[{leg}]": np.zeros(9, bool) for leg in range(1, 7)})
    for row, said in ((0, "10"), (3, "10"), (4, "01"), (7, "01"), (8, "00")):
        flag = np.arange(9) == row
        one = Record(few.with_columns(**{"flag.force_limited[2]": flag}), record.metadata)
        assert packed_scene(one, platform, "waves", frames=3)["flags"]["force_limited"] == said


@given(st.floats(0.05, 5), st.floats(1.0, 1.85), st.floats(0.0, 1.0))
def test_the_parts_of_a_leg_overlap_and_stay_within_it(shortest: float, ratio: float, share: float) -> None:
    """Expected at every length L between the extremes: lower + upper > L, and both shorter than L."""
    platform = replace(load_preset("liu2000"), leg_length_min=None, leg_length_max=None)
    longest = shortest * ratio
    lower, upper = leg_parts(np.array([[shortest, longest]]), platform)
    length = shortest + share * (longest - shortest)
    assert lower + upper > length
    assert max(lower, upper) < length


def test_nearness_is_one_at_each_limit(platform: Platform) -> None:
    """Expected: 0 in the middle of the stroke, 1 at both ends; |F|/limit; the joint angles' own ratio at home is 0."""
    low, high = platform.leg_length_min, platform.leg_length_max
    assert low is not None
    assert high is not None
    home = waving_record(platform, rows=3, size=0.0)
    table = home.table
    for row, length in enumerate((low, (low + high) / 2, high)):
        for leg in range(1, 7):
            values = table[f"leg_length[{leg}]"].to_numpy().copy()
            values[row] = length
            table = table.with_columns(**{f"leg_length[{leg}]": values})
    near = nearness_to_limits(Record(table, home.metadata), platform)
    assert near["stroke"][:, 0] == pytest.approx([1, 0, 1])
    assert np.array_equal(near["force"], np.abs(home["actuator_force"]) / 100)
    assert np.abs(near["joint angle"]).max() < 1e-7
    velocity, force = np.abs(home["leg_velocity"]), np.abs(home["actuator_force"])
    assert near["velocity"] == pytest.approx(velocity / 0.8)
    assert near["power"][-1] == pytest.approx(force[-1] * velocity[-1] / 12000)
    assert nearness_to_limits(Record(table, {}), load_preset("liu2000")) == {}


def test_the_page_is_one_element_tree_with_everything_inside(page: bytes) -> None:
    """Expected: no element that would load something, a policy that forbids it, tables with the metrics' numbers."""
    assert elements(page, "//script[@src] | //link[not(starts-with(@href, 'data:'))] | //img | //iframe") == []
    (policy,) = elements(page, "//meta[@http-equiv='Content-Security-Policy']/@content")
    assert policy.startswith("default-src 'none'")
    assert "http" not in policy
    titles = elements(page, "//caption/text()")
    assert {"Tracking error", "Legs", "Limits and flags", "Run", "Platform: motion_base", "Versions"} <= set(titles)
    assert elements(page, "//h1/text()") == ["six sines"]


def test_tables_carry_the_metrics(record: Record, page: bytes) -> None:
    (row,) = elements(page, "//caption[text()='Legs']/../tbody/tr[starts-with(th, 'peak force')]")
    shown = [float(cell.text) for cell in row.xpath("td")[:6]]
    assert shown == pytest.approx(metrics(record)["force"]["peak"], rel=1e-3)


def test_the_same_record_gives_the_same_bytes(record: Record, page: bytes) -> None:
    assert view_page([record], ["waves"]) == page


def test_frames_are_thinned_and_the_page_says_so(page: bytes) -> None:
    assert len(numbers(data_of(page)["scenes"][0]["time"])) == FRAMES
    assert b"2001 of 4001 rows" in page


@pytest.mark.parametrize("records", [1, 6])
def test_ten_seconds_at_a_kilohertz_make_at_most_eight_megabytes(platform: Platform, records: int) -> None:
    """Expected: the bound that was set; several records share the frames and points of one."""
    long = waving_record(platform, rows=10_001)
    page = view_page([long] * records, [f"run {k}" for k in range(records)])
    assert len(page) <= 8e6


def test_the_licences_of_the_libraries_go_along(page: bytes) -> None:
    """Expected: the holders of the copyrights of three.js and plotly.js, and the MIT licence."""
    text = page.decode()
    for holder in ("2010-2022 Three.js Authors", "Permission is hereby granted", "Plotly, Inc."):
        assert holder in text


def test_a_trimesh_that_has_three_js_elsewhere_is_refused_by_name(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Expected: the package, its version, and one that would do; also if the page in the archive has another script."""
    monkeypatch.setattr("gough_stewart.harness.output.three.place_of", lambda _package: tmp_path)
    (tmp_path / "resources/templates").mkdir(parents=True)
    for _ in range(2):
        with pytest.raises(GoughStewartError, match=rf"trimesh {version('trimesh')} has no three\.js.*5\.2\.0"):
            three.__wrapped__()
        with ZipFile(tmp_path / "resources/templates/viewer.zip", "w") as archive:
            archive.writestr("viewer.html.template", "<script>\nlet x = 0;\n</script>")


def test_text_of_the_user_stays_text(platform: Platform) -> None:
    """Expected: markup in a title, name or cause is shown, not obeyed."""
    bad = "</script><script>alert(1)</script><b>%{x}"
    ended = {"status": "diverged", "time": 0.1, "cause": bad}
    named = replace(platform, name=bad)
    record = waving_record(named, rows=5, title=bad, outcome=ended, experiment={"description": bad})
    for page in (view_page([record], [bad]), view_page([record, record], [bad, "b"])):
        assert elements(page, "//script[contains(., 'alert(1)') and not(@type)] | //b") == []
        assert bad in elements(page, "//h1/text()")[0]
        assert data_of(page)["scenes"][0]["name"] == bad


def test_rows_from_a_value_that_is_not_finite_on_are_left_out(record: Record) -> None:
    values = record["position[3]"].copy()
    values[1000:] = np.nan
    broken = Record(record.table.with_columns(**{"position[3]": values}), record.metadata)
    assert numbers(data_of(view_page([broken], ["x"]))["scenes"][0]["time"])[-1] == record["time"][999]


@pytest.mark.parametrize("records", [1, 2])
def test_a_loop_that_oscillates_is_not_just_completed(platform: Platform, records: int) -> None:
    """Expected: beside the title and in the table of the run, what the record was given: leg 5, 40 Hz, 3 mm."""
    record = oscillating(waving_record(platform, size=0.0))
    page = view_page([record] * records, [f"run {k}" for k in range(records)])
    ended = [each.text_content() for each in elements(page, "//header//*[@class='ended']")]
    assert [says_it_oscillates(text) for text in ended] == [True] * records
    of_runs = elements(page, "//caption[text()='Run']/../tbody/tr[th='outcome']/td/text()")
    assert of_runs == ended
    assert elements(view_page([waving_record(platform)], ["a"]), "//*[@class='ended']") == []


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_very_short_records_have_a_page(platform: Platform, rows: int) -> None:
    data = data_of(view_page([waving_record(platform, rows=rows)], ["short"]))
    assert len(numbers(data["scenes"][0]["time"])) == rows


@pytest.mark.parametrize("number", [0, MOST_RECORDS + 1])
def test_too_many_records_or_none_are_refused(record: Record, number: int) -> None:
    with pytest.raises(RecordError, match=f"{number} records; expected 1 to {MOST_RECORDS}"):
        view_page([record] * number, ["x"] * number)


def test_a_record_without_a_finite_row_or_a_platform_is_refused(record: Record) -> None:
    values = np.full(record.table.height, np.nan)
    nothing = Record(record.table.with_columns(**{"position[1]": values}), record.metadata)
    with pytest.raises(RecordError, match="waves: no row with finite values"):
        view_page([nothing], ["waves"])
    for name in ("platform", "outcome"):
        without = {key: value for key, value in record.metadata.items() if key != name}
        with pytest.raises(RecordError, match=f"waves: the metadata have no {name}"):
            view_page([Record(record.table, without)], ["waves"])
    with pytest.raises(RecordError, match="the metadata have no platform"):
        view_page([Record(record.table, {**record.metadata, "platform": {"wheels": 4}})], ["waves"])


def test_records_are_called_by_their_folders_if_those_differ(tmp_path: Any) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    one.mkdir()
    two.mkdir()
    assert names_of([one, two / "record.csv"]) == ["one", "two"]
    assert names_of([one, one / "record.csv"]) == [str(one), str(one / "record.csv")]


def test_the_head_tells_records_apart_by_colour(record: Record) -> None:
    """Expected: a box and a swatch for each, in the colours of the page's data, as curves and bodies are."""
    page = view_page([record, record], ["a", "b"])
    assert len(re.findall(rb'<input type="checkbox" data-record="\d"', page)) == 2
    swatches = elements(page, "//header//*[@class='swatch']/@style")
    assert swatches == [f"background:{colour}" for colour in data_of(page)["colours"][:2]]
    assert len(set(swatches)) == 2


def test_poses_are_drawn_from_home(record: Record, platform: Platform) -> None:
    """Expected: the position of home as it is, and a quaternion whose matrix is R = Rz Ry Rx of its orientation."""
    tilted = replace(platform, home_orientation=np.array([0.1, -0.2, 0.3]))
    home = np.array(packed_scene(record, tilted, "waves", frames=3)["home"])
    assert home[:3] == pytest.approx(platform.home_position)
    assert matrix_from_quaternion(home[3:]) == pytest.approx(matrix_from_orientation(tilted.home_orientation))


def test_the_distance_of_colours_is_that_of_its_publication() -> None:
    """Expected: pairs 1, 7, 16 and 25 of Sharma et al. (2005), table 1."""
    for one, other, distance in (
        ((50, 2.6772, -79.7751), (50, 0, -82.7485), 2.0425),
        ((50, 0, 0), (50, -1, 2), 2.3669),
        ((50, 2.5, 0), (50, 0, -2.5), 4.3065),
        ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
    ):
        assert delta_e_2000(np.array(one), np.array(other)) == pytest.approx(distance, abs=1e-4)


@pytest.mark.parametrize("blind", BLIND)
def test_red_green_blind_readers_tell_the_middle_from_the_limit(blind: str) -> None:
    """Expected: ΔE ≥ 40 by either formula, simulated as by Machado et al. (2009); beyond the limit so by CIE76."""
    (_, middle), *_, (_, limit) = NEARNESS["stops"]
    seen_middle, seen_limit, beyond = (lab(rgb_of(each), BLIND[blind]) for each in (middle, limit, NEARNESS["beyond"]))
    assert delta_e_76(seen_middle, seen_limit) >= 40
    assert delta_e_2000(seen_middle, seen_limit) >= 40
    assert min(delta_e_76(beyond, seen_middle), delta_e_76(beyond, seen_limit)) >= 40
