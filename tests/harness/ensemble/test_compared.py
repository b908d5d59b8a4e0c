"""All that is said of two compared ensembles, against NumPy and SciPy on the columns of both."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from scipy import stats
from typer.testing import Result

import gough_stewart as gs
from gough_stewart import Ensemble
from gough_stewart.harness.ensemble.compare import (
    compare,
    comparison_report,
    comparison_tables,
    known_numbers,
    names_of,
    run_compared,
)
from tests.harness.results.test_whole_run import tables_in
from tests.support.arrays import FloatArray
from tests.support.commands import invoke
from tests.support.coverage import ends_of_median
from tests.support.ensembles import INPUTS, ensemble_of
from tests.support.page_arrays import data_of, unpacked

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


def test_the_page_of_differences_has_each_members_difference(
    done: tuple[Result, Path], both: tuple[polars.DataFrame, polars.DataFrame]
) -> None:
    """Expected: B − A of the columns, member by member, where both completed; the median of them is in the verdict."""
    data = data_of((done[1] / "report.html").read_bytes())
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


def test_the_second_experiment_has_the_machines_and_the_seed_of_the_first(tmp_path: Path) -> None:
    """Expected: the seed of the first one's sensors; with an order of its own, the same drawn masses."""
    varied = {"members": 4, "worst": 1, "platform_mass": {"uniform": [1000, 3000]}}
    short = {"loop.duration": 0.02, "loop.sample_time": "2 ms"}
    first = gs.load_experiment("heave_step", {**short, "sensors.seed": 11, "ensemble": varied})
    second = gs.load_experiment("heave_step", {**short, "sensors.seed": 12, "controller.bandwidth": 4})
    found = run_compared((first, second), ("slow", "fast"), tmp_path, lambda _: None, workers=1)
    assert (found.a.metadata["seed"], found.b.metadata["seed"]) == (11, 11)
    assert found.a.values("platform_mass").tolist() == found.b.values("platform_mass").tolist()


def test_an_experiment_without_an_ensemble_cannot_be_compared(tmp_path: Path) -> None:
    """Expected: the message names what is missing; names of the same file in two folders are A and B."""
    one = gs.load_experiment("heave_step", {"loop.duration": 0.3})
    with pytest.raises(gs.GoughStewartError, match="ensemble: is missing"):
        run_compared((one, one), ("A", "B"), tmp_path, lambda _: None)
    assert names_of("x/a.toml", "y/a.toml") == ("A", "B")
    assert names_of("x/slow.toml", "fast") == ("slow", "fast")


def normal(n: int, seed: int = 2) -> FloatArray:
    return np.random.default_rng(seed).normal(size=(n, 4))


def with_columns(ensemble: Ensemble, **columns: Any) -> Ensemble:
    """The same with other columns; `__` in a name is a dot."""
    series = [polars.Series(name.replace("__", "."), values) for name, values in columns.items()]
    return Ensemble(ensemble.members.with_columns(series), ensemble.bands, ensemble.metadata)


def test_a_comparison_of_one_pair_has_a_difference_without_interval() -> None:
    """Expected: the difference of the one member that completed in both; of other numbers of members a refusal."""
    a = ensemble_of(normal(3), ["completed", "completed", "diverged"])
    b = ensemble_of(normal(3), ["diverged", "completed", "completed"])
    b = with_columns(b, force__peak=a.values("force.peak") - [1.0, 20.0, 300.0])
    found = compare(a, b, ("one", "two"))
    row = found.differences.filter(polars.col("metric") == "force.peak").row(0, named=True)
    assert (row["pairs"], row["mean"], row["median"], row["less_b"]) == (1, pytest.approx(-20), pytest.approx(-20), 1.0)
    assert row["mean_low"] is None
    assert row["mean_high"] is None
    gap = found.gaps
    assert gap.members["outcome"].to_list() == ["not in both", "completed", "not in both"]
    assert gap.members["ended"].to_list() == a.members["ended"].to_list()
    assert gap.varied == INPUTS
    assert gap.values("platform_mass").tolist() == a.values("platform_mass").tolist()
    assert gap.values("force.peak") == pytest.approx([-1, -20, -300])
    assert gap.title == "two − one"
    completed, mean, median = comparison_tables(found, a.usual_metrics)
    assert [row[1:] for row in completed.rows] == [(1, 1), (1, 0)]
    every = comparison_tables(found, found.a.metrics)[1]
    assert len(mean.rows) <= len(every.rows) == len(found.differences)
    (k,) = (k for k, row in enumerate(mean.rows) if row[0] == "peak force")
    assert mean.texts(k)[3:] == ("-20 N", "–", "–")
    assert (median.texts(k)[1], median.texts(k)[4]) == ("-20 N", "100")
    report = comparison_report(found)
    differences = report.number("difference.force.peak").members
    assert differences is not None
    np.testing.assert_allclose(differences, [np.nan, -20, np.nan])
    for path, each in (("force.peak", b), ("first.force.peak", a)):
        members = report.number(path).members
        assert members is not None
        assert members[1] == each.values("force.peak")[1]
    assert {each.path for each in report.numbers} <= {each.path for each in known_numbers()}
    renumbered = with_columns(b, member=[0, 1, 7])
    with pytest.raises(
        gs.GoughStewartError, match="3 and 3 members, 2 of them in both; expected the same members in both"
    ):
        compare(a, renumbered)
    # members are joined by their number, whatever the order of the rows
    turned = compare(a, Ensemble(b.members.reverse(), b.bands, b.metadata))
    assert turned.gaps.members.equals(found.gaps.members)
    never = ensemble_of(normal(3), ["diverged"] * 3)
    assert compare(never, b).differences.is_empty()


def test_inputs_that_are_no_numbers_are_the_same_in_both() -> None:
    """Expected: names of files that vary have no value as numbers, which is no difference."""
    a = with_columns(ensemble_of(normal(5)), varied__controller__file=["a", "b", "c", "d", "e"])
    assert (compare(a, a).differences["pairs"] == 5).all()


def test_only_the_same_members_are_compared() -> None:
    """Expected: a message that names what differs."""
    first = ensemble_of(normal(60))
    with pytest.raises(gs.GoughStewartError, match="60 and 59 members, 59 of them in both"):
        compare(first, ensemble_of(normal(60)[:59]))
    with pytest.raises(gs.GoughStewartError, match=r"platform_mass of member 0 is .* expected the same \[ensemble\]"):
        compare(first, ensemble_of(normal(60, seed=3)))
