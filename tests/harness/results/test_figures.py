"""Pictures of runs: files of the right kind, the same twice, and no record that breaks them."""

from io import BytesIO
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import polars
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from gough_stewart.harness.output.display_resolution import decimated
from gough_stewart.harness.results.figures import _told_apart, _view, run_figures
from gough_stewart.harness.results.record import Record, columns
from tests.support.svg_figures import panels_of

VARIABLES = {"position": 3, "orientation": 3, "leg_length": 6}
NAMES = ("pose", "errors", "forces", "legs")


def record_of(n: int = 60, last: float | None = None, *, closed: bool = True, **metadata: Any) -> Record:
    """Noise in all columns that figures look at; `last` in the last row of all of them."""
    rng = np.random.default_rng(0)
    sizes = {**VARIABLES, "actuator_force": 6}
    if closed:
        sizes |= {f"{prefix}.{name}": size for prefix in ("reference", "error") for name, size in VARIABLES.items()}
    table: dict[str, Any] = {"time": 1e-3 * np.arange(n)}
    for name, size in sizes.items():
        values = rng.normal(size=(n, size))
        if last is not None:
            values[-1] = last
        table |= dict(zip(columns(name, size), values.T.copy(), strict=True))
    if closed:
        for name in ("force_limited", "rate_limited", "stroke_exceeded"):
            table |= dict(zip(columns(f"flag.{name}", 6), rng.random((6, n)) > 0.8, strict=True))
    outcome = {"status": "completed", "time": 1e-3 * (n - 1), "cause": None}
    platform = {"leg_length_min": -1.0, "leg_length_max": None}
    known = {"title": "a run", "platform": platform, "outcome": outcome, "force_limit": 1.0}
    return Record(polars.DataFrame(table), {**known, **metadata})


def texts(record: Record) -> dict[str, str]:
    """The SVGs, whose comments hold every text."""
    return {name: file.decode() for name, file in run_figures(record).items() if name.endswith("svg")}


@pytest.fixture(scope="module")
def files() -> dict[str, bytes]:
    """Of ten seconds of noise, the worst that a picture can be of."""
    return run_figures(record_of(10_001))


def test_files_are_png_and_small_svg(files: dict[str, bytes]) -> None:
    assert sorted(files) == sorted(f"{name}.{kind}" for name in NAMES for kind in ("png", "svg"))
    for name, file in files.items():
        if name.endswith("png"):
            assert file.startswith(b"\x89PNG\r\n\x1a\n")
        else:
            assert ET.fromstring(file).tag.endswith("svg")
            assert len(file) < 300_000


def test_same_record_gives_the_same_bytes(files: dict[str, bytes]) -> None:
    assert run_figures(record_of(10_001)) == files


def test_open_loop_run_has_no_errors_and_no_reference() -> None:
    found = texts(record_of(closed=False))
    assert sorted(found) == ["forces.svg", "legs.svg", "pose.svg"]
    assert all("reference" not in text for text in found.values())


@pytest.mark.parametrize("lacks", ["error.position", "error.orientation", "error.leg_length"])
def test_errors_are_drawn_of_both_parts_of_the_pose_or_not_at_all(lacks: str) -> None:
    """Expected: no figure without one of them; only those of the pose without errors of the legs."""
    record = record_of()
    found = texts(Record(record.table.drop(record.columns_of(lacks)), record.metadata))
    assert ("errors.svg" in found) == (lacks == "error.leg_length")
    assert "leg length [mm]" not in found.get("errors.svg", "")


@pytest.mark.parametrize(("n", "last"), [(1, np.nan), (2, -1.7e308)])
def test_short_records_and_what_a_diverged_run_ends_with_are_drawn(n: int, last: float | None) -> None:
    assert run_figures(record_of(n, last=last))


def test_constant_tiny_and_huge_values_are_drawn() -> None:
    record = record_of(force_limit=None, platform={})
    scales = [0.0, 1e-300, 1e-12, 1e12, 1e90, 1e305]
    odd = [
        polars.col(name) * scales[k % 6]
        for k, name in enumerate(record.table.columns)
        if name != "time" and not name.startswith("flag")
    ]
    assert run_figures(Record(record.table.with_columns(odd), record.metadata))


@pytest.fixture(scope="module")
def ended_early() -> dict[str, str]:
    """Of a run that diverged, far from all limits."""
    outcome = {"status": "diverged", "time": 0.0123, "cause": "leg 3 costs $5 & more_\n" + 40 * "long "}
    far = {"leg_length_min": 50.0, "leg_length_max": 60.0}
    return texts(record_of(outcome=outcome, force_limit=1000.0, platform=far))


def test_title_says_how_a_run_ended(files: dict[str, bytes], ended_early: dict[str, str]) -> None:
    for text in ended_early.values():
        assert "diverged at 0.0123 s: leg 3 costs $5 &amp; more_" in text
    assert all(b"at 10 s" not in file for file in files.values())


def test_limits_are_drawn_where_they_are_near(files: dict[str, bytes]) -> None:
    assert b"limit \xc2\xb1" not in files["forces.svg"]
    assert b"stroke limit" in files["legs.svg"]


def test_limits_are_told_where_they_are_far(ended_early: dict[str, str]) -> None:
    assert "limit ±1000 N" in ended_early["forces.svg"]
    assert "stroke 50 to 60 m" in ended_early["legs.svg"]


@pytest.mark.parametrize(
    ("bounds", "least", "low", "high"),
    [
        ((), 0.01, 1.0, 1.1),
        ((0.81,), 0.01, 0.81, 1.1),
        ((0.79,), 0.01, 1.0, 1.1),
        ((1.29,), 0.01, 1.0, 1.29),
        ((1.31,), 0.01, 1.0, 1.1),
        ((0.79, 1.29), 0.01, 1.0, 1.29),
        ((0.81, 1.29), 0.01, 0.81, 1.29),
        ((1.05,), 0.01, 1.0, 1.1),
        ((), 0.4, 0.85, 1.25),
        ((0.06, 2.04), 0.4, 0.06, 2.04),
    ],
)
def test_an_axis_fits_values_and_limits_within_two_spans_of_them(
    bounds: tuple[float, ...], least: float, low: float, high: float
) -> None:
    """Expected: by hand, with 6 % of room, or more at the top; values that are not finite do not count."""
    values = np.array([[1.0, np.nan], [1.1, np.inf]])
    room = 0.06 * (high - low)
    view = _view(values, least, bounds)
    assert view == pytest.approx((low - room, high + room))
    assert _view(values, least, bounds, top=0.16) == pytest.approx((low - room, high + 0.16 * (high - low)))
    for share, holds in ((0.99, True), (1.01, False)):
        assert view.holds(low - share * room) == view.holds(high + share * room) == holds
    assert view.holds(view.low)
    assert view.holds(view.high)


def test_an_axis_that_hardly_moves_looks_like_it() -> None:
    """Expected: panels at least a fiftieth as high as the highest of their kind, around their own values."""
    record = record_of(closed=False)
    moves = {"position[1]": 0.3 + 1e-4 * np.sin(np.arange(60)), "position[2]": np.linspace(-0.5, 0.5, 60)}
    table = record.table.with_columns(*(polars.Series(name, values) for name, values in moves.items()))
    drawn = run_figures(Record(table.with_columns(polars.lit(2.0).alias("position[3]")), record.metadata))["pose.svg"]
    panels = {panel.title: panel.y_view for panel in panels_of(drawn, (0.0, 0.059))[0]}
    assert panels["y [m]"] == pytest.approx((-0.56, 0.56), abs=2e-3)
    least = 1.12 / 50
    for title, middle in (("x [m]", 0.3), ("z [m]", 2.0)):
        assert panels[title] == pytest.approx((middle - 0.56 * least, middle + 0.56 * least), abs=2e-4)


@given(st.integers(1, 3000), st.integers(0, 900), st.integers(0, 2**31))
def test_decimation_keeps_ends_and_extremes_and_order(n: int, points: int, seed: int) -> None:
    """Expected: the definition, by brute force."""
    rng = np.random.default_rng(seed)
    time, values = 0.1 * np.arange(n, dtype=np.float64), rng.normal(size=n)
    values[rng.random(n) < 0.05] = np.nan
    t, v = decimated(time, values, points)
    assert len(t) == len(v) <= max(points, 4)
    assert (t[0], t[-1]) == (time[0], time[-1])
    assert np.all(np.diff(t) > 0)
    assert np.array_equal(v, values[np.searchsorted(time, t)], equal_nan=True)
    if np.isfinite(values).any():
        assert (np.nanmin(v), np.nanmax(v)) == (np.nanmin(values), np.nanmax(values))


def test_few_points_stay_as_they_are() -> None:
    time, values = np.arange(5.0), np.arange(5.0) ** 2
    t, v = decimated(time, values, 5)
    assert np.array_equal(t, time)
    assert np.array_equal(v, values)


def test_gap_of_a_whole_bucket_stays_a_gap() -> None:
    values = np.ones(1000)
    values[400:600] = np.nan
    assert np.isnan(decimated(np.arange(1000.0), values, 100)[1]).any()


@pytest.mark.parametrize(("apart", "lines"), [(0.0, 1), (1e-5, 6)])
def test_legs_share_a_line_of_errors_only_where_they_coincide_all_along(apart: float, lines: int) -> None:
    """Expected: errors alike to rounding make one line; errors 10 µm apart in half of the rows make six."""
    columns = np.sin(np.arange(60))[:, None] * np.ones(6) + 1e-12 * np.arange(6)
    columns[30:] += apart * np.arange(6)
    assert len(_told_apart(1e3 * columns, 1e-3, tuple(f"leg {k}" for k in range(1, 7)))) == lines


def test_the_legend_of_coinciding_legs_is_within_the_picture() -> None:
    """Expected: a white edge of 5 pixels, which no text crosses."""
    record = record_of()
    first = polars.col("error.leg_length[1]")
    alike = record.table.with_columns(**{f"error.leg_length[{k}]": first for k in range(2, 7)})
    picture = run_figures(Record(alike, record.metadata))["errors.png"]
    pixels = np.asarray(Image.open(BytesIO(picture)).convert("L"))
    assert pixels[:, -5:].min() == 255
