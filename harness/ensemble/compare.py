"""Compare two ensembles of the same members: differences and their confidence."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars
from numpy.typing import NDArray
from scipy.special import stdtrit

from gough_stewart.harness.ensemble.charts import ensemble_charts
from gough_stewart.harness.ensemble.ensemble import ensemble
from gough_stewart.harness.ensemble.ensemble_report import Ensemble, ensemble_numbers
from gough_stewart.harness.ensemble.sensitivity import sensitivity_of
from gough_stewart.harness.errors import ExperimentError, RecordError
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.report.chart import Chart
from gough_stewart.harness.report.document import Cell, Column, Number, Report, Section, Table, Value, Verdict
from gough_stewart.harness.report.quantities import SHARE, fine, percent, sentence
from gough_stewart.harness.report.quantities import counted as count
from gough_stewart.harness.report.requirements import quantile_interval
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.harness.table_file import write_to
from gough_stewart.harness.view.view import differ_in, differing
from gough_stewart.model.process.files import write_files

CONFIDENCE = 0.95
DIFFERENCES = "differences.parquet"


@dataclass(frozen=True, eq=False)
class Comparison:
    """B − A of every metric, member by member.

    `gaps` is an ensemble whose metrics are the differences of each member. `differences` has a row for each metric that
    members have in both: `metric`, `pairs`, `mean_a`, `mean_b`, the `mean` of the differences with `mean_low` and
    `mean_high` (Student's t), their `median` with `median_low` and `median_high` (between order statistics; None if
    there are too few), and `less_b`, the share of members in which B has the smaller value. Each confidence interval is
    95 % by itself.
    """

    a: Ensemble
    b: Ensemble
    names: tuple[str, str]
    gaps: Ensemble
    differences: polars.DataFrame


def run_compared(
    experiments: tuple[Experiment, Experiment],
    names: tuple[str, str],
    folder: Path,
    say: Callable[[str], None],
    **options: Any,
) -> Comparison:
    """Run both over the first one's `[ensemble]` with the same seed; write both and their differences.

    Each has a folder with its name; `options` are those of `ensemble`. `ExperimentError` if the first has no
    `[ensemble]`, `RecordError` if members differ nevertheless, for example if factors apply to different platforms.
    """
    first, second = experiments
    choice = first.ensemble
    if choice is None:
        raise ExperimentError(first.where, "ensemble", "is missing; add it to declare what varies in both experiments")
    seed = first.sensors.seed if choice.seed is None else choice.seed
    options = {**options, "seed": seed if options.get("seed") is None else options["seed"]}
    ensembles = []
    for name, experiment in zip(names, (first, second.model_copy(update={"ensemble": choice})), strict=True):
        say(name)
        ensembles.append(ensemble(experiment, out=folder / name, **options))
    a, b = ensembles
    for key in [key for key in a.varied if key in b.varied]:
        x, y = a.values(key), b.values(key)
        differ = ~((x == y) | (np.isnan(x) & np.isnan(y)))
        if differ.any():
            k = int(differ.argmax())
            raise RecordError(
                f"{key} of member {a.members['member'][k]} is {x[k]:.6g} in one and {y[k]:.6g} in the other; "
                "expected the same [ensemble] in both, with the same seed"
            )

    # differences, member by member, and their statistics
    in_both = a.is_complete & b.is_complete
    metrics = [metric for metric in a.metrics if metric in b.metrics]
    gaps = a.members.select("member", "ended", polars.col(r"^varied\..*$")).with_columns(
        polars.Series("outcome", np.where(in_both, "completed", "not in both")),
        polars.lit(None, polars.String).alias("cause"),
        *(polars.Series(metric, b.values(metric) - a.values(metric), nan_to_null=True) for metric in metrics),
    )
    rows = [{"metric": metric, **_difference(a, b, metric, in_both)} for metric in metrics]
    differences = polars.DataFrame([row for row in rows if row["pairs"]], infer_schema_length=None)
    write_files(folder, {DIFFERENCES: lambda path: write_to(path, differences.write_parquet)})
    of_gaps = Ensemble(gaps, a.bands.clear(), {**a.metadata, "title": f"{names[1]} − {names[0]}"})
    return Comparison(a, b, names, of_gaps, differences)


def _difference(a: Ensemble, b: Ensemble, name: str, both: NDArray[np.bool_]) -> dict[str, float | int | None]:
    """The differences of members that completed in both (N,).

    The mean is the ratio of the sums of n independent blocks, D of differences and m of members, with the variance
    n/(n − 1) Σ (D − m mean)²/(Σ m)²: Cochran, Sampling Techniques (1977), section 6.3. Blocks of one member give s²/n.
    """
    x, y = a.values(name), b.values(name)
    has_both = both & np.isfinite(x) & np.isfinite(y)
    x, y = x[has_both], y[has_both]
    gap, pairs = y - x, len(x)
    if not pairs:
        return {"pairs": 0}
    mean, half = float(gap.mean()), math.nan
    blocks = np.flatnonzero(has_both) // a.block
    n = len(set(blocks.tolist()))
    if n > 1:
        residuals = np.bincount(blocks, gap - mean)
        error = math.sqrt(n / (n - 1) * float(residuals @ residuals)) / pairs
        half = float(stdtrit(n - 1, (1 + CONFIDENCE) / 2)) * error
    low, high = quantile_interval(gap, 0.5, CONFIDENCE, a.independent(has_both))
    return {
        "pairs": pairs,
        "mean_a": float(x.mean()),
        "mean_b": float(y.mean()),
        "mean": mean,
        "mean_low": None if n == 1 else mean - half,
        "mean_high": None if n == 1 else mean + half,
        "median": float(np.median(gap)),
        "median_low": low,
        "median_high": high,
        "less_b": float((gap < 0).mean()),
    }


def _tables(result: Comparison, names: Sequence[str]) -> list[Table]:
    """Numbers of completed members, then the differences of these metrics with their confidence."""
    a, b = result.a.is_complete, result.b.is_complete
    counts = [[int(np.count_nonzero(in_a & in_b)) for in_b in (b, ~b)] for in_a in (a, ~a)]
    ended = Table(
        f"{count(result.a.members.height, 'member')}{_named(*result.names)}",
        (Column(""), Column("completed in B"), Column("not")),
        (("completed in A", *counts[0]), ("not", *counts[1])),
    )
    differences = {row["metric"]: row for row in result.differences.iter_rows(named=True)}
    low, high = Column("from", None, "lower end, 95 % confidence"), Column("to", None, "upper end, 95 % confidence")
    gap, share = Column("B − A"), Column("less in B", SHARE, "share of the members in which B has the smaller value")
    heads: dict[str, tuple[Column, ...]] = {
        "mean": (Column("A"), Column("B"), gap, low, high),
        "median": (gap, low, high, share),
    }
    tables = [ended]
    for kind, columns in heads.items():
        rows: list[tuple[Cell, ...]] = []
        for row in (differences[name] for name in names if name in differences):
            metric = metric_of(row["metric"])
            keys = (*(("mean_a", "mean_b") if kind == "mean" else ()), kind, f"{kind}_low", f"{kind}_high")
            cells = [Value(row[key], replace(metric.quantity, digits=3)) for key in keys]
            rows.append((metric.text, *cells, *(() if kind == "mean" else (row["less_b"],))))
        title = f"B − A, {kind} difference, of the {counts[0][0]:,} that completed in both; 95 % confidence"
        tables.append(Table(title, (Column(""), *columns), tuple(rows)))
    return tables


def _named(first: str, second: str) -> str:
    """What A and B are, if they have names of their own."""
    return "" if (first, second) == ("A", "B") else f"; A is {first}, B is {second}"


def comparison_report(result: Comparison, *, charts: bool = True) -> Report:
    """How the second experiment differs from the first, member by member, in one metric and then in all."""
    (first, second), gaps, by = result.names, result.gaps, result.a.worst_by
    sections = [Section("Differences", tuple(_tables(result, result.a.usual_metrics)))]
    named, members = f"{second} − {first}", count(result.a.members.height, "member")
    settings = differing({"experiment": run.metadata.get("experiment")} for run in (result.a, result.b))
    if charts:
        for section in ensemble_charts(gaps, by, sensitivity_of(gaps, by)):
            parts = (replace(p, title=f"{p.title}: {named}") for p in section.parts if isinstance(p, Chart))
            sections.append(Section(section.title, tuple(parts)))
        all_metrics = _tables(result, result.a.metrics)[1:]
        sections.append(Section("All metrics", tuple(all_metrics), detail=True))
    ensembles = {"": result.b, "first.": result.a, "difference.": gaps}
    report = Report(
        f"{result.a.title}: {named}",
        _verdict(result, by),
        tuple(sections),
        study="ensemble --compare",
        settings=settings,
        runs=result.names,
        lead=". ".join(filter(None, (f"The same {members} in both{_named(first, second)}", differ_in(settings)))),
        numbers=tuple(
            replace(number, path=f"{prefix}{number.path}")
            for prefix, members_of in ensembles.items()
            for number in ensemble_numbers(members_of)
        ),
    )
    return fine(report, result.a.fineness)


def _verdict(result: Comparison, by: str) -> Verdict:
    (first, second), metric = result.names, metric_of(by)
    row = next((row for row in result.differences.iter_rows(named=True) if row["metric"] == by), None)
    if row is None:
        return Verdict(f"No member has a {metric.text} in both {first} and {second}", "marginal")
    signed = replace(fine(metric.quantity, result.a.fineness), digits=3)
    ends = signed.range_text(row["median_low"], row["median_high"])
    side = "less" if row["median"] < 0 else "more"
    gap = f"{metric.text}: {signed.text(abs(row['median']))} {side} in {second} than in {first}"
    sure = f"median of the differences of {row['pairs']:,} members; 95 % confidence: {ends}"
    numbers = (
        Number("", f"{metric.text}, mean of {first}", row["mean_a"], metric.quantity),
        Number("", f"{metric.text}, mean of {second}", row["mean_b"], metric.quantity),
        Number(
            "", f"median of {second} − {first}", row["median"], metric.quantity, row["median_low"], row["median_high"]
        ),
    )
    text = sentence([f"{gap} ({sure})", f"less in {second} for {percent(row['less_b'])} of the members"])
    return Verdict(text, "told", numbers)
