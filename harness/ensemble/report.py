"""What an ensemble found, as a report: how many machines do it and how well, what fails, what makes them differ."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars

from gough_stewart.harness.ensemble import data
from gough_stewart.harness.ensemble.charts import ensemble_charts
from gough_stewart.harness.ensemble.data import (
    EnsembleData,
    are_counted,
    counted,
    failures,
    finite,
    integration_warning,
    judgement_warning,
    kinds_of_oscillation,
    left_out,
    metric_name,
    numbers,
    oscillation_warning,
    quantity_of_input,
    usual_metrics,
    works,
)
from gough_stewart.harness.ensemble.sensitivity import Sensitivity, sensitivity_if_known
from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.polars_paths import read_parquet
from gough_stewart.harness.report.document import Note, Number, Report, Section, Status, Verdict, settings_of
from gough_stewart.harness.report.page import to_html
from gough_stewart.harness.report.proportions import METHOD, quantile_interval, share_interval
from gough_stewart.harness.report.quantities import SHARE, TIME, Quantity, fine
from gough_stewart.harness.report.table import Cell, Column, Table, Value
from gough_stewart.harness.report.terminal import text_of
from gough_stewart.harness.report.words import about, at_least, at_most, listed, percent, sentence
from gough_stewart.harness.report.words import counted as count
from gough_stewart.harness.results.bands import LEVELS
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.harness.results.run_charts import faults_of
from gough_stewart.model.vectors import FloatArray

# The share of the machines about which the verdict speaks.
SHARE_TOLD = 0.95
# The metric of the verdict, which also ranks the worst members: the first of these that exists. The error of a
# reference that jumps is the jump itself at first, so that what is left of it counts.
_PEAK, _FINAL = "tracking.position.norm_peak", "tracking.position.norm_final"
_OTHERWISE = "force.peak"
_MOST_CAUSES = 8
_DRAWN = {
    "random": "drawn at random",
    "sobol": "of a Sobol sequence",
    "latin_hypercube": "of a Latin hypercube",
    "saltelli": "of Saltelli's design",
}
# What confidence intervals are of, in designs whose members are not independent.
_EVENLY = "cover the ranges more evenly, so they are as a rule too wide"
_PAIRS = "of a metric that depends on the product of two of many inputs they may be too narrow: try sampling = 'random'"
_CONFIDENCE = {
    "sobol": f"as if members were drawn independently; the members of a Sobol sequence {_EVENLY}. But {_PAIRS}.",
    "latin_hypercube": f"as if members were drawn independently; the members of a Latin hypercube {_EVENLY}.",
    "saltelli": "of {points} points, not of {members} members: the {block} members of a point of Saltelli's design "
    f"share their numbers. The points, of a Sobol sequence, {_EVENLY}. But {_PAIRS}.",
}
_MOST_INPUTS = 8
# Inputs that matter alike, by name.
_MOST_NAMED = 3
# Inputs that a table of members has as columns.
_MOST_COLUMNS = 5
_THREE, _FOUR = Quantity("", "", digits=3), replace(SHARE, digits=4)


@dataclass(frozen=True, eq=False, repr=False)
class Ensemble(EnsembleData):
    """An ensemble that has run; displays the quantiles of its metrics, and its failures."""

    def report(self, *, charts: bool = True, worst: Sequence[int] | Mapping[int, str] = ()) -> Report:
        """How many machines complete their runs and how well, what fails, and what makes them differ.

        Parameters
        ----------
        charts
            Also bands over time, histograms and dependence.
        worst
            Members to list, or a mapping with the address of each one's page, "" for none.

        Returns
        -------
        Report
            Verdict, all metrics as numbers with a value for each member, tables, and with `charts` bands and
            distributions.
        """
        by = worst_by(self)
        return ensemble_report(self, by, sensitivity_if_known(self, by), worst, charts=charts)

    def __repr__(self) -> str:
        """Title and report as in the terminal."""
        return "\n".join([f"Ensemble: {self.title}", text_of(self.report(charts=False))])

    def _repr_html_(self) -> str:
        """The report, for a notebook."""
        return to_html(self.report(charts=False))


def read_ensemble(folder: Path | str) -> Ensemble:
    """An ensemble from its folder.

    Returns
    -------
    Ensemble
        Members, bands and metadata, with the samples of its members if it kept any.

    Raises
    ------
    RecordError
        The folder has no ensemble.
    """
    folder = Path(folder)
    try:
        metadata: dict[str, Any] = json.loads((folder / data.METADATA).read_bytes())
        return Ensemble(
            read_parquet(folder / data.MEMBERS),
            read_parquet(folder / data.BANDS),
            metadata,
            # results of older versions have none
            read_parquet(folder / data.SAMPLES) if (folder / data.SAMPLES).is_file() else None,
        )
    except (OSError, ValueError, polars.exceptions.PolarsError) as error:
        raise RecordError(f"{folder} has no ensemble: {error}") from error


def worst_by(ensemble: EnsembleData) -> str:
    """The metric that ranks the worst members: the experiment's, or that of tracking."""
    experiment = ensemble.metadata.get("experiment") or {}
    by = (experiment.get("ensemble") or {}).get("worst_by")
    if by is not None:
        return metric_name(ensemble.members, by)
    first = [_FINAL] if (experiment.get("reference") or {}).get("type") == "step" else []
    return next(name for name in (*first, _PEAK, _OTHERWISE, *ensemble.metrics) if name in ensemble.metrics)


def ensemble_report(
    ensemble: EnsembleData,
    by: str,
    known: Sensitivity | None = None,
    worst: Sequence[int] | Mapping[int, str] = (),
    *,
    charts: bool = True,
) -> Report:
    """The report of an ensemble.

    Parameters
    ----------
    by
        The metric of the verdict, which also comes first in charts.
    known
        What makes that metric vary.
    worst
        Members to list; of a mapping with the address of each one's own page, "" for none.
    charts
        Also bands over time, histograms and dependence.
    """
    members = ensemble.members
    tables: list[Table] = [quantile_table(members, usual_metrics(members))]
    if failures(members):
        tables.append(failure_table(members, pages=worst if isinstance(worst, Mapping) else None))
    if known is not None:
        tables.append(sensitivity_table(known))
    if worst:
        inputs = ensemble.varied if known is None else [known.inputs[k] for k in known.order]
        numeric = [name for name in inputs if name in ensemble.varied]
        pages = worst if isinstance(worst, Mapping) else {}
        tables.append(worst_table(ensemble, list(worst), by, pages, numeric))
    sections = [Section("Members", tuple(tables))]
    if charts:
        sections += ensemble_charts(ensemble, by, known)
        all_metrics = [name for name in ensemble.metrics if len(counted(members, name))]
        sections.append(Section("All metrics", (quantile_table(members, all_metrics),), detail=True))
    seed = f", seed {ensemble.metadata['seed']}" if "seed" in ensemble.metadata else ""
    return fine(
        Report(
            ensemble.title,
            ensemble_verdict(ensemble, by, known),
            tuple(sections),
            study="ensemble",
            lead=f"{count(members.height, 'member')} {_DRAWN[ensemble.metadata.get('sampling', 'random')]}{seed}",
            numbers=ensemble_numbers(ensemble),
            settings=settings_of(ensemble.metadata.get("settings") or {}),
            notes=_notes(ensemble),
        ),
        fineness_in(ensemble),
    )


def fineness_in(ensemble: EnsembleData) -> float:
    """How finely numbers of its machines are told; those of an older version have none."""
    return float(ensemble.metadata.get("fineness", 1.0))


def ensemble_verdict(ensemble: EnsembleData, by: str, known: Sensitivity | None = None) -> Verdict:
    """How many machines complete their runs, how well most of them do, and what makes them differ."""
    members, n = ensemble.members, ensemble.members.height
    sound = int(np.count_nonzero(works(members)))
    low, high = share_interval(sound / ensemble.block, n / ensemble.block)
    grows = bool(kinds_of_oscillation(members)[data.GROWING])
    how = "complete their runs without a growing loop" if grows else "complete their runs"
    # digits so that neither end is rounded to what it is not
    first, last = (percent(end, 3) for end in (low or 0.0, 1.0 if high is None else high))
    interval = f"95 % confidence: {first.removesuffix(' %')} to {last}"
    parts: list[str | None] = [
        *map(str, faults_of(ensemble.metadata)),
        f"{sound:,} of {count(n, 'machine')} {how} ({interval})",
    ]
    method = METHOD.format("members" if ensemble.block == 1 else "points of the design")
    carried = [Number("", "machines that complete", sound / n, _FOUR, low, high, explanation=method)]
    values = counted(members, by)
    if len(values) > 1:
        metric = metric_of(by)
        is_lower = metric.better == "larger"
        level = 1 - SHARE_TOLD if is_lower else SHARE_TOLD
        value = float(np.quantile(values, level))
        ends = quantile_interval(values, level, independent=ensemble.independent(are_counted(members, by)))
        told = f"{percent(SHARE_TOLD)} of them"
        quantity = fine(metric.quantity, fineness_in(ensemble))
        if is_lower:
            words = f"have a {metric.text} of at least {at_least(quantity, value)}"
        elif by == _PEAK:
            words = f"stay within {at_most(quantity, value)} of their reference"
        elif by == _FINAL:
            words = f"end within {at_most(quantity, value)} of their reference"
        else:
            words = f"have a {metric.text} of at most {at_most(quantity, value)}"
        parts.append(f"{told} {words} ({_quantile_interval(quantity, *ends)})")
        name = f"{metric.text}, {percent(level)} of members below"
        method = "interval of the quantile between order statistics, 95 % confidence"
        carried.append(Number("", name, value, metric.quantity, *ends, explanation=method))
    if known is not None and known.order and known.explains:
        parts.append(_cause(known))
    outside = list(ensemble.metadata.get("outside", ()))
    status: Status = "bad" if not sound else "good" if sound == n and not outside else "marginal"
    return Verdict(sentence([*outside[:1], *parts]), status, tuple(carried))


def _quantile_interval(quantity: Quantity, low: float | None, high: float | None) -> str:
    """How sure a quantile is, with 95 % confidence."""
    if low is None or high is None:
        side = f"at least {at_least(quantity, low)}" if low is not None else ""
        side = f"at most {at_most(quantity, high)}" if high is not None else side
        return f"{side}; too few members for more".removeprefix("; ")
    first, last = at_least(quantity, low), at_most(quantity, high)
    # one unit for both, unless a small machine's differ
    return f"{first.removesuffix(f' {last.split()[-1]}') if quantity.unit else first} to {last}"


def _cause(known: Sensitivity) -> str | None:
    """The input with the largest effect, or those that may have it, as far as they have one beyond doubt."""
    effect = known.main if known.total is None else known.total
    half = known.main_confidence if known.total_confidence is None else known.total_confidence
    first = known.order[0]
    sure = [k for k in (first, *known.alike) if known.size[k] > half[k]]
    if first not in sure or (known.alike and len(sure) == 1):
        return None
    names = [known.inputs[k] for k in sure[:_MOST_NAMED]]
    if len(sure) == 1:
        return f"{names[0]} matters most"
    unnamed = [count(len(sure) - _MOST_NAMED, "other")] if len(sure) > _MOST_NAMED else []
    told = [f"{effect[k]:.2f} [{effect[k] - half[k]:.2f}, {effect[k] + half[k]:.2f}]" for k in sure[:_MOST_NAMED]]
    return f"{listed([*names, *unnamed])} matter alike ({listed(told)})"


def ensemble_numbers(ensemble: EnsembleData) -> tuple[Number, ...]:
    """All metrics with a value for each member, NaN of those that did not complete; 95 % stay below the value.

    Of a metric that is better if larger, 95 % stay above.
    """
    completed = (ensemble.members[data.OUTCOME] == "completed").to_numpy()
    told = []
    for name in ensemble.metrics:
        values = ensemble.values(name)
        of_members = values if name.startswith(data.MARGINS) else np.where(completed, values, np.nan)
        told.append(number_of_members(name, of_members, ensemble.block))
    return tuple(told)


def number_of_members(name: str, members: FloatArray, block: int = 1) -> Number:
    """A metric with its value for each member (N,), and the value that 95 % of those with one do not exceed."""
    metric, defined = metric_of(name), finite(members)
    level = 1 - SHARE_TOLD if metric.better == "larger" else SHARE_TOLD
    value = float(np.quantile(defined, level)) if len(defined) else None
    return Number(
        name,
        metric.text,
        value,
        metric.quantity,
        explanation=metric.sentence,
        members=members,
        small_is_worse=metric.better == "larger",
        block=block,
    )


def quantile_table(members: polars.DataFrame, names: Sequence[str]) -> Table:
    """A row for each metric: its quantiles, and of how many members they are."""
    rows: list[tuple[Cell, ...]] = []
    remarks = []
    for name in names:
        values, metric = counted(members, name), metric_of(name)
        quantity = replace(metric.quantity, digits=3)
        marks = np.quantile(values, LEVELS).tolist() if len(values) else [None] * len(LEVELS)
        rows.append((metric.text, *(Value(mark, quantity) for mark in marks), len(values)))
        remarks += _undefined(members, name, len(values))
    without = left_out(members)
    remarks += [f"Quantiles are without the {count(without, 'member')} not completed."] if without else []
    columns = (
        Column(""),
        *(Column(f"{100 * level:g} %", None, f"{100 * level:g} % of the members stay below") for level in LEVELS),
        Column("members", None, "how many members have this number"),
    )
    counts = members[data.OUTCOME].value_counts().sort(data.OUTCOME).iter_rows()
    ended = ", ".join(f"{number} {outcome}" for outcome, number in counts)
    motions = [f"{len(which)} {kind}" for kind, which in kinds_of_oscillation(members).items() if which]
    ended += f" ({' and '.join(motions)} by themselves)" if motions else ""
    title = f"{count(members.height, 'member')}: {ended}"
    return Table(title, columns, tuple(rows), note=" ".join(remarks))


def _undefined(members: polars.DataFrame, name: str, defined: int) -> list[str]:
    """Of a time of a step response that some lack: after how long they had not reached it."""
    part, _, time = name.rpartition(".")
    words = {"settling_time": "settled to 2 %", "rise_time": "risen to 90 %"}
    total = members.height - left_out(members)
    if time not in words or defined == total or f"{part}.at" not in members.columns:
        return []
    at, duration = (counted(members, path) for path in (f"{part}.at", data.ENDED))
    waited = ""
    if len(at) and len(duration):
        waited = f" {about(TIME, float(duration.max() - at.min()))} after its step, when the run ended"
    axis = part.rpartition(".")[2]
    return [
        f"In {total - defined:,} of {count(total, 'member')} {axis} had not {words[time]}{waited}: "
        "they have no such time, and the quantiles are of the faster ones."
    ]


def failure_table(members: polars.DataFrame, most: int = _MOST_CAUSES, pages: Mapping[int, str] | None = None) -> Table:
    """Members that did not complete, by cause; the first of each stands for it, with its page if there is one."""
    causes, pages = failures(members), pages or {}
    columns = (Column(data.MEMBER), Column("outcome"), Column("cause"), Column("members with it"))
    rows = tuple((cause.members[0], cause.outcome, cause.cause, len(cause.members)) for cause in causes)
    links = tuple(pages.get(cause.members[0], "") for cause in causes)
    note = "The first member of each cause. `gough-stewart run EXPERIMENT --member N --open` shows member N as a run."
    shown = links if any(links) else ()
    return Table("Not completed", columns, rows, sortable=True, first_shown=most, note=note, links=shown)


def sensitivity_table(known: Sensitivity, most: int = _MOST_INPUTS) -> Table:
    """The inputs with their effect on a metric, the most influential first."""
    beta = Column("β", replace(_THREE, digits=2), "standardised regression coefficient")
    half = Column("±", replace(_THREE, digits=2), "half of the 95 % confidence interval")
    columns: tuple[Column, ...] = (Column("input"), beta, half)
    if known.total is not None:
        alone = Column("alone", replace(_THREE, digits=2), "share of the variance, first order")
        total = Column("in total", replace(_THREE, digits=2), "share of the variance with all interactions")
        columns = (Column("input"), alone, half, total, replace(half, name="± "))
    rows: list[tuple[Cell, ...]] = []
    for k in known.order:
        cells = [float(known.main[k]), float(known.main_confidence[k])]
        if known.total is not None and known.total_confidence is not None:
            cells += [float(known.total[k]), float(known.total_confidence[k])]
        rows.append((known.inputs[k], *cells))
    title = f"What makes the {metric_of(known.metric).text} vary"
    return Table(title, columns, tuple(rows), first_shown=most, note=f"{known.remark[:1].upper()}{known.remark[1:]}.")


def worst_table(
    ensemble: EnsembleData,
    worst: Sequence[int],
    by: str,
    pages: Mapping[int, str] | None = None,
    inputs: Sequence[str] | None = None,
) -> Table:
    """These members with their outcome, the metric, and what was drawn for the first of the inputs."""
    metric, all_inputs = metric_of(by), ensemble.varied if inputs is None else inputs
    inputs = all_inputs[:_MOST_COLUMNS]
    columns = (
        Column("member"),
        Column("outcome"),
        Column(metric.text, metric.quantity),
        *(Column(name, quantity_of_input(name)) for name in inputs),
    )
    merit = ensemble.values(by)
    rows: list[tuple[Cell, ...]] = []
    row_of = {int(member): k for k, member in enumerate(ensemble.members[data.MEMBER].to_list())}
    drawn = [numbers(ensemble.members, f"{data.VARIED}{name}") for name in inputs]
    for member in worst:
        k = row_of[member]
        rows.append(
            (member, str(ensemble.members[data.OUTCOME][k]), float(merit[k]), *(float(column[k]) for column in drawn))
        )
    links = tuple((pages or {}).get(member, "") for member in worst)
    return Table(
        f"Worst members by {metric.text}",
        columns,
        tuple(rows),
        sortable=True,
        detail=True,
        links=links if pages else (),
        note=f"{len(all_inputs) - len(inputs)} more inputs are in `members.parquet`."
        if len(all_inputs) > len(inputs)
        else "",
    )


def _notes(ensemble: EnsembleData) -> tuple[Note, ...]:
    warnings = [f"{text}; of factors, write {{ factor = … }}" for text in ensemble.metadata.get("outside", ())]
    warnings += [oscillation_warning(ensemble.members), judgement_warning(ensemble.members)]
    if ensemble.metadata.get("substeps") is not None and "tolerance" in ensemble.metadata:
        warnings.append(integration_warning(ensemble.members, float(ensemble.metadata["tolerance"])))
    notes, n = [Note(text, "warning") for text in warnings if text], ensemble.members.height
    combinations = ensemble.metadata.get("combinations", 1)
    if n % combinations:
        remark = f"{count(n, 'member')} of grids with {combinations:,} combinations have the first ones more often"
        notes.append(Note(f"{remark}: choose a multiple for shares and quantiles of the whole grids", "warning"))
    text = _CONFIDENCE.get(ensemble.metadata.get("sampling", "random"), "")
    if text:
        text = text.format(points=f"{n // ensemble.block:,}", members=f"{n:,}", block=ensemble.block)
        notes.append(Note(f"Confidence intervals are {text}"))
    return tuple(notes)
