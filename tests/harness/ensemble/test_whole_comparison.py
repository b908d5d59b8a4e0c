"""All that is said of two compared ensembles and of what matters in them, against NumPy and SciPy on their columns."""

import re
from pathlib import Path
from typing import Any

import lxml.html
import numpy as np
import polars
import pytest
from scipy import stats
from typer.testing import Result

import gough_stewart as gs
from gough_stewart.model.vectors import FloatArray
from tests.harness.results.test_whole_run import tables_in
from tests.support.commands import invoke
from tests.support.coverage import ends_of_median
from tests.support.page_arrays import data_of as data_of_page
from tests.support.page_arrays import unpacked

TOML = """
title = "BANDWIDTH Hz"
[platform]
preset = "motion_base"
[reference]
type = "point_to_point"
duration = 0.1
position_change = [0.004, -0.003, 0.011]
at = 0.02
[controller]
type = "pd"
bandwidth = BANDWIDTH
feedforward = "gravity"
[loop]
duration = 0.16
sample_time = 0.004
plant_step = 0.002
delay = 1
[limits]
position_error = 0.0135
"""
VARIED = """
[ensemble]
members = 12
seed = 2
worst = 2
worst_by = "force.peak"
platform_mass = { uniform = [900, 2600] }
reference.position_change = { factor = { uniform = [0.6, 1.3] } }
leg_viscous_friction = { normal = [300, 50] }
"""
FORCE = "force.peak"


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    """A slow controller and a fast one, by the command."""
    folder = tmp_path_factory.mktemp("compared")
    (folder / "slow.toml").write_text(TOML.replace("BANDWIDTH", "1.5") + VARIED)
    (folder / "fast.toml").write_text(TOML.replace("BANDWIDTH", "5"))
    files = [str(folder / f"{name}.toml") for name in ("slow", "fast")]
    return invoke(
        "ensemble", files[0], "--compare", files[1], "--workers", "1", "--report", "--out", str(folder / "out")
    ), (folder / "out")


@pytest.fixture(scope="module")
def both(done: tuple[Result, Path]) -> tuple[polars.DataFrame, polars.DataFrame]:
    """The members of A and of B."""
    assert done[0].exit_code == 0, done[0].output
    slow, fast = (gs.read_ensemble(done[1] / name).members for name in ("slow", "fast"))
    return slow, fast


def gaps_of(both: tuple[polars.DataFrame, polars.DataFrame], name: str) -> tuple[FloatArray, FloatArray]:
    """The values of members that completed in both and have the metric in both."""
    completed = np.logical_and(*((each["outcome"] == "completed").to_numpy() for each in both))
    a, b = (each[name].cast(polars.Float64).fill_null(np.nan).to_numpy()[completed] for each in both)
    known = np.isfinite(a) & np.isfinite(b)
    return a[known], b[known]


def test_members_are_counted_by_where_they_completed(
    done: tuple[Result, Path], both: tuple[polars.DataFrame, polars.DataFrame]
) -> None:
    """Expected: counts of the two tables, A in rows and B in columns."""
    a, b = ((each["outcome"] == "completed").to_numpy() for each in both)
    counts = [int((a & b).sum()), int((a & ~b).sum()), int((~a & b).sum()), int((~a & ~b).sum())]
    assert counts[0] > 3
    assert sum(counts[1:]) > 0
    table = tables_in(done[0].stdout)["12 members; A is slow, B is fast"]
    assert table[""] == ["completed in B", "not"]
    assert [int(cell) for cell in [*table["completed in A"], *table["not"]]] == counts


def test_every_difference_is_scipys(done: tuple[Result, Path], both: tuple[polars.DataFrame, polars.DataFrame]) -> None:
    """Expected: Student's interval of paired differences of every metric; medians by NumPy, with SciPy's intervals."""
    table = polars.read_parquet(done[1] / "differences.parquet")
    common = {name for name in both[0].columns if "." in name and not name.startswith(("varied.", "oscillation"))}
    assert set(table["metric"]) == {name for name in common if len(gaps_of(both, name)[0])}
    for row in table.iter_rows(named=True):
        a, b = gaps_of(both, row["metric"])
        gap = b - a
        assert row["pairs"] == len(gap)
        means = (row["mean_a"], row["mean_b"], row["mean"])
        assert means == pytest.approx((a.mean(), b.mean(), gap.mean()), rel=1e-9, abs=1e-12)
        if len(gap) > 1 and np.ptp(gap) > 0:
            interval = stats.t.interval(0.95, len(gap) - 1, gap.mean(), stats.sem(gap))
            assert (row["mean_low"], row["mean_high"]) == pytest.approx(interval, rel=1e-9, abs=1e-12)
        assert row["median"] == pytest.approx(np.median(gap), rel=1e-12, abs=1e-15)
        assert row["less_b"] == pytest.approx((gap < 0).mean())
        ends = [np.nan if row[name] is None else row[name] for name in ("median_low", "median_high")]
        assert ends == pytest.approx(ends_of_median(gap), rel=1e-9, abs=1e-15, nan_ok=True)


def test_the_printed_differences_are_those_of_the_file(done: tuple[Result, Path]) -> None:
    """Expected: the file's numbers in the table's units."""
    rows = {row["metric"]: row for row in polars.read_parquet(done[1] / "differences.parquet").iter_rows(named=True)}
    tables = tables_in(done[0].stdout)
    pairs = max(row["pairs"] for row in rows.values())
    mean, median = (
        tables[f"B − A, {kind} difference, of the {pairs} that completed in both; 95 % confidence"]
        for kind in ("mean", "median")
    )
    assert mean[""] == ["A", "B", "B − A", "from", "to"]
    assert median[""] == ["B − A", "from", "to", "less in B [%]"]
    for words, metric, factor in (
        ("position error, peak mm", "tracking.position.norm_peak", 1e3),
        ("orientation error, RMS deg", "tracking.orientation.norm_rms", 180 / np.pi),
        ("peak force N", FORCE, 1.0),
        ("work, absolute J", "energy.absolute_total", 1.0),
    ):
        row = rows[metric]
        of_mean = ("mean_a", "mean_b", "mean", "mean_low", "mean_high")
        assert [float(cell) for cell in mean[words]] == [pytest.approx(factor * row[key], rel=6e-3) for key in of_mean]
        *cells, share = median[words]
        assert float(share) == pytest.approx(100 * row["less_b"], rel=6e-4)
        of_median = ("median", "median_low", "median_high")
        assert [float(cell) for cell in cells] == [pytest.approx(factor * row[key], rel=6e-3) for key in of_median]


def data_of(page: Path) -> dict[str, Any]:
    """What the script of a page reads."""
    return data_of_page(page.read_bytes())


def test_the_page_of_differences_has_each_members_difference(
    done: tuple[Result, Path], both: tuple[polars.DataFrame, polars.DataFrame]
) -> None:
    """Expected: B − A of the columns, member by member, where both completed; the median of them is in the verdict."""
    data = data_of(done[1] / "report.html")
    gap = (both[1][FORCE] - both[0][FORCE]).to_numpy()
    sound = [a == b == "completed" for a, b in zip(both[0]["outcome"], both[1]["outcome"], strict=True)]
    points = [chart for chart in data["charts"] if chart["kind"] == "points"]
    (series,) = points[0]["series"]
    values = unpacked(data["arrays"][series["values"]])
    np.testing.assert_allclose(values, np.where(sound, gap, np.nan), rtol=1e-5, atol=1e-3)
    text = (done[1] / "report.html").read_text()
    assert "fast − slow" in text
    verdict = re.findall(r'<p class="verdict told">.*?</p>', text)[0]
    assert f"{np.median(gap[sound]):.0f} N".replace("-", "−") in verdict


@pytest.mark.parametrize("name", ["slow", "fast"])
def test_what_matters_is_the_regression_of_the_columns(name: str, done: tuple[Result, Path]) -> None:
    """Expected: β of NumPy's least squares on columns of mean 0 and deviation 1 of the members that completed."""
    members = gs.read_ensemble(done[1] / name).members
    some = members.filter(polars.col("outcome") == "completed")
    inputs = [column.removeprefix("varied.") for column in members.columns if column.startswith("varied.")]
    X = np.stack([some[f"varied.{each}"].to_numpy() for each in inputs], axis=1)
    y = some[FORCE].to_numpy()
    z, w = (X - X.mean(axis=0)) / X.std(axis=0), (y - y.mean()) / y.std()
    beta = np.linalg.lstsq(z, w, rcond=None)[0]
    r2 = 1 - np.mean((w - z @ beta) ** 2)
    order = np.argsort(-np.abs(beta))
    data = data_of(done[1] / name / "report.html")
    found = next(chart for chart in data["charts"] if chart["kind"] == "bars")
    assert found["x"]["labels"] == [inputs[k] for k in order]
    (bars,) = found["series"]
    assert bars["name"] == "β"
    values, low, high = (unpacked(data["arrays"][bars[each]]) for each in ("values", "low", "high"))
    assert values == pytest.approx(beta[order], abs=1e-3)
    assert (low < values).all()
    assert (values < high).all()
    assert found["y"]["title"] == "standardised regression coefficient β"
    (remark,) = lxml.html.parse(done[1] / name / "report.html").xpath(
        "//figure[contains(@class, 'bars')]//p[@class='hint']"
    )
    assert f"R² = {r2:.2f}, of {some.height} members" in remark.text_content()
    left_out = members.height - some.height
    told = f"left out: {left_out} not completed or without a value"
    assert (told in remark.text_content()) == bool(left_out)
