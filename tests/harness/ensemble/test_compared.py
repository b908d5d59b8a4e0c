"""Two compared ensembles of the same machines: files and report against NumPy and SciPy on the tables of both."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from scipy import stats

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.commands import Result, invoke
from tests.support.reports import parts_in, report_in, rows_in, units_in

TOML = """
title = "BANDWIDTH Hz"
platform.preset = "motion_base"
reference = { type = "point_to_point", duration = 0.1, position_change = [0.004, -0.003, 0.011], at = 0.02 }
controller = { type = "pd", bandwidth = BANDWIDTH, feedforward = "gravity" }
loop = { duration = 0.16, sample_time = 0.004, plant_step = 0.002, delay = 1 }
limits.position_error = 0.0135
"""
VARIED = """
[ensemble]
members = 12
worst = 2
worst_by = "force.peak"
platform_mass = { uniform = [900, 2600] }
reference.position_change = { factor = { uniform = [0.6, 1.3] } }
leg_viscous_friction = { normal = [300, 50] }
"""
FORCE = "force.peak"


def compared(folder: Path, varied: str, *options: str, fast: str = "") -> tuple[Result, Path]:
    """A slow controller and a fast one, by the command."""
    (folder / "slow.toml").write_text(TOML.replace("BANDWIDTH", "1.5") + varied)
    (folder / "fast.toml").write_text(TOML.replace("BANDWIDTH", "5") + fast)
    files = [str(folder / f"{name}.toml") for name in ("slow", "fast")]
    out = folder / "out"
    return invoke("ensemble", files[0], "--compare", files[1], "--workers", "1", "--out", str(out), *options), out


class Both:
    """What a comparison wrote."""

    def __init__(self, out: Path, names: tuple[str, str] = ("slow", "fast")) -> None:
        self.members = tuple(gs.read_ensemble(out / name).members for name in names)
        self.is_complete = tuple((table["outcome"] == "completed").to_numpy() for table in self.members)
        rows = polars.read_parquet(out / "differences.parquet").iter_rows(named=True)
        self.differences: dict[str, dict[str, Any]] = {row["metric"]: row for row in rows}
        self.report = report_in(out)

    def values(self, name: str) -> tuple[FloatArray, FloatArray]:
        """A metric of each member, NaN where there is none."""
        a, b = (table[name].cast(polars.Float64).fill_null(np.nan).to_numpy() for table in self.members)
        return a, b

    def pairs(self, name: str) -> tuple[FloatArray, FloatArray, Any]:
        """Values of those that completed in both and have the metric in both, and their numbers."""
        a, b = self.values(name)
        rows = self.is_complete[0] & self.is_complete[1] & np.isfinite(a) & np.isfinite(b)
        return a[rows], b[rows], np.flatnonzero(rows)


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Both:
    seed = "controller.feedforward = { choice = ['gravity', 'computed_torque'] }\nseed = 2\n"
    required = (f"difference.{FORCE} > -1000 kN", f"first.{FORCE} < 1 N", f"{FORCE} < 1000 kN")
    options = (word for each in required for word in ("--require", each))
    done, out = compared(tmp_path_factory.mktemp("compared"), VARIED + seed, "--report", *options)
    assert done.exit_code == 3, done.output
    assert f"missed: {required[1]}\n" in done.stderr
    files = {"differences.parquet", "report.json", "report.html"}
    assert {path.name for path in out.iterdir()} == {"slow", "fast"} | files
    return Both(out)


def test_members_are_counted_by_where_they_completed(both: Both) -> None:
    """Expected: counts of the two tables, A in rows and B in columns; what varies is the same, names too."""
    a, b = both.is_complete
    counts = [[int((x & y).sum()) for y in (b, ~b)] for x in (a, ~a)]
    assert counts[0][0] > 3
    assert sum(map(sum, counts)) - counts[0][0] > 0
    table, *_ = parts_in(both.report, "table")
    assert table["title"] == "12 members; A is slow, B is fast"
    assert [column["name"] for column in table["columns"]] == ["", "completed in B", "not"]
    assert list(rows_in(table).values()) == counts
    assert both.report["lead"].startswith("The same 12 members in both; A is slow, B is fast")
    for name in (name for name in both.members[0].columns if name.startswith("varied.")):
        assert both.members[0][name].equals(both.members[1][name])


def test_every_difference_is_scipys(both: Both) -> None:
    """Expected: Student's interval of paired differences of every metric; medians by NumPy, with SciPy's intervals."""
    common = {name for name in both.members[0].columns if "." in name and not name.startswith(("varied.", "oscill"))}
    assert set(both.differences) == {name for name in common if len(both.pairs(name)[0])}
    for name, row in both.differences.items():
        a, b, _ = both.pairs(name)
        gap = b - a
        assert row["pairs"] == len(gap)
        means = (row["mean_a"], row["mean_b"], row["mean"])
        assert means == pytest.approx((a.mean(), b.mean(), gap.mean()), rel=1e-9, abs=1e-12)
        if len(gap) > 1 and np.ptp(gap) > 0:
            interval = stats.t.interval(0.95, len(gap) - 1, gap.mean(), stats.sem(gap))
            assert (row["mean_low"], row["mean_high"]) == pytest.approx(interval, rel=1e-9, abs=1e-12)
        assert row["median"] == pytest.approx(np.median(gap), rel=1e-12, abs=1e-15)
        assert row["less_b"] == pytest.approx((gap < 0).mean())
        exact: Any = stats.quantile_test(gap, q=0.0, p=0.5).confidence_interval(0.95)
        ends = [np.nan if row[key] is None else row[key] for key in ("median_low", "median_high")]
        assert ends == pytest.approx([float(exact.low), float(exact.high)], rel=1e-9, abs=1e-15, nan_ok=True)


def test_the_report_has_the_differences_of_the_file_and_of_each_member(both: Both) -> None:
    """Expected: the file's numbers in tables, in units of the metric; B − A member by member where both completed."""
    _, mean, median, *_ = parts_in(both.report, "table")
    keys = {"mean": ["mean_a", "mean_b", "mean", "mean_low", "mean_high"],
            "median": ["median", "median_low", "median_high", "less_b"]}  # fmt: skip
    assert [column["name"] for column in mean["columns"]] == ["", "A", "B", "B − A", "from", "to"]
    assert [column["name"] for column in median["columns"]] == ["", "B − A", "from", "to", "less in B"]
    for table, kind in ((mean, "mean"), (median, "median")):
        assert table["title"].startswith(f"B − A, {kind} difference, of the {both.differences[FORCE]['pairs']} that")
        for words, metric, unit in (
            ("position error, peak", "tracking.position.norm_peak", "mm"),
            ("orientation error, RMS", "tracking.orientation.norm_rms", "deg"),
            ("peak force", FORCE, "N"),
        ):
            assert rows_in(table)[words] == [both.differences[metric][key] for key in keys[kind]]
            assert units_in(both.report, table)[words] == unit
    a, b = both.values(FORCE)
    gap = np.where(both.is_complete[0] & both.is_complete[1], b - a, np.nan)
    numbers = {number["path"]: number for number in both.report["numbers"]}
    assert [np.nan if x is None else x for x in numbers[f"difference.{FORCE}"]["members"]] == pytest.approx(
        gap, nan_ok=True
    )
    for path, values, complete in ((f"first.{FORCE}", a, both.is_complete[0]), (FORCE, b, both.is_complete[1])):
        members = [np.nan if x is None else x for x in numbers[path]["members"]]
        assert members == pytest.approx(np.where(complete, values, np.nan), nan_ok=True)
    charts = [chart for chart in parts_in(both.report, "chart") if chart["kind"] == "points"]
    assert charts[0]["title"].endswith(": fast − slow")
    drawn = [np.nan if x is None else x for x in charts[0]["series"][0]["values"]]
    assert drawn == pytest.approx(gap, nan_ok=True)
    middle = np.nanmedian(gap)
    said = re.search(
        r"peak force: (\S+) N (less|more) in fast than in slow", both.report["verdict"]["text"], re.IGNORECASE
    )
    assert said is not None
    assert float(said[1]) == pytest.approx(abs(middle), rel=6e-3)
    assert said[2] == ("less" if middle < 0 else "more")
    # who did not complete in both has no difference
    holding = [int(np.isfinite(gap).sum()), 0, int(both.is_complete[1].sum())]
    notes = [each["note"] for each in both.report["requirements"]]
    assert [note.partition(" ")[0] for note in notes] == [str(number) for number in holding]


def test_differences_in_blocks_are_as_sure_as_their_points(tmp_path: Path) -> None:
    """Expected: of a Saltelli design, a ratio of sums over points, summed term by term; (Σ m)²/Σ m² points are worth.

    n/(n − 1) Σ (D − m mean)²/(Σ m)² is its variance, with D the sum of differences of a point with m members in both.
    """
    done, out = compared(tmp_path, VARIED + 'sampling = "saltelli"\nseed = 4\n', "--members", "60", "--seed", "5")
    assert done.exit_code == 0, done.output
    both = Both(out)
    assert [gs.read_ensemble(out / name).metadata["seed"] for name in ("slow", "fast")] == [5, 5]
    a, b, rows = both.pairs(FORCE)
    gap, row = b - a, both.differences[FORCE]
    points = {k: gap[rows // 5 == k] for k in sorted({*(rows // 5).tolist()})}
    sizes = np.array([len(some) for some in points.values()])
    n = len(points)
    assert row["pairs"] == len(gap)
    assert n > 8
    assert len(set(sizes.tolist())) > 1
    variance = n / (n - 1) * sum((some.sum() - len(some) * gap.mean()) ** 2 for some in points.values())
    half = stats.t.ppf(0.975, n - 1) * np.sqrt(variance) / sizes.sum()
    assert [row["mean_low"], row["mean_high"]] == pytest.approx([gap.mean() - half, gap.mean() + half], rel=1e-9)
    # k members count as so many points below the median, in the binomial distribution between whole numbers
    worth, ordered = sizes.sum() ** 2 / (sizes**2).sum(), np.sort(gap)
    one = worth / len(gap)
    below = one * np.arange(len(gap))
    low = ordered[stats.beta.cdf(0.5, worth - below, below + 1) <= 0.025][-1]
    high = ordered[np.count_nonzero(stats.beta.cdf(0.5, below + one, worth - below - one + 1) > 0.025)]
    assert (row["median_low"], row["median_high"]) == (low, high)


def test_one_pair_has_no_interval_and_machines_and_seed_are_those_of_the_first(tmp_path: Path) -> None:
    """Expected: the seed of the first one's sensors; files of one name are A and B."""
    files = []
    for name, bandwidth, seed, members in (("x", "1.5", 11, 1), ("y", "5", 12, 9)):
        (tmp_path / name).mkdir()
        files.append(str(tmp_path / name / "mine.toml"))
        text = TOML.replace("BANDWIDTH", bandwidth) + f"[sensors]\nseed = {seed}\n" + VARIED
        Path(files[-1]).write_text(text.replace("members = 12", f"members = {members}").replace("0.0135", "0.5"))
    out = tmp_path / "out"
    done = invoke("ensemble", files[0], "--compare", files[1], "--workers", "1", "--out", str(out))
    assert done.exit_code == 0, done.output
    both = Both(out, ("A", "B"))
    assert [gs.read_ensemble(out / name).metadata["seed"] for name in ("A", "B")] == [11, 11]
    (a,), (b,) = both.values(FORCE)
    row = both.differences[FORCE]
    assert (row["pairs"], row["mean"], row["median"]) == (1, pytest.approx(b - a), pytest.approx(b - a))
    assert (row["mean_low"], row["mean_high"], row["median_low"], row["median_high"]) == (None,) * 4
    table, *_ = parts_in(both.report, "table")
    assert table["title"] == "1 member"
    assert re.search(r"more in B than in A|less in B than in A", both.report["verdict"]["text"])


@pytest.mark.parametrize(
    ("varied", "fast", "message"),
    [
        ("", "", "ensemble: is missing; add it to declare what varies in both experiments"),
        ("[ensemble]\nmembers = 2\nplatform_mass = { uniform = '50 kg' }\n",
         "[plant]\nparameters = { platform_mass = 1400 }\n",
         r"platform_mass of member 0 is \S+ in one and \S+ in the other; expected the same \[ensemble\]"),
    ],
)  # fmt: skip
def test_only_the_same_members_are_compared(varied: str, fast: str, message: str, tmp_path: Path) -> None:
    done, _ = compared(tmp_path, varied, fast=fast)
    assert done.exit_code in (1, 2)
    assert re.search(message, " ".join(done.stderr.split())), done.stderr


def test_where_nobody_completes_in_both_nothing_is_said_of_them(tmp_path: Path) -> None:
    """Expected: no row, no number, and a verdict that says so; all of the slow one leave the motion."""
    done, out = compared(tmp_path, VARIED, "--members", "3", "--set", "limits.position_error=1e-6")
    assert done.exit_code == 3
    assert "none of 3 members completed its run" in done.stderr
    assert polars.read_parquet(out / "differences.parquet").is_empty()
    assert report_in(out)["verdict"]["text"] == "No member has a peak force in both slow and fast"
