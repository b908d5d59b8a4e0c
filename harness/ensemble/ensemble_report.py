"""What an ensemble found, as a report: how many machines do it and how well, what fails, what makes them differ."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars

from gough_stewart.harness.ensemble.charts import ensemble_charts
from gough_stewart.harness.ensemble.member_table import (
    BANDS,
    FINAL,
    MEMBERS,
    METADATA,
    PEAK,
    SAMPLES,
    MemberTable,
    quantity_of_input,
)
from gough_stewart.harness.ensemble.sensitivity import Sensitivity, sensitivity_of
from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.report.document import (
    Cell,
    Column,
    Note,
    Number,
    Report,
    Section,
    Status,
    Table,
    Value,
    Verdict,
    settings_of,
)
from gough_stewart.harness.report.page import to_html
from gough_stewart.harness.report.quantities import (
    SHARE,
    TIME,
    Quantity,
    about,
    at_least,
    at_most,
    fine,
    listed,
    percent,
    sentence,
)
from gough_stewart.harness.report.quantities import counted as count
from gough_stewart.harness.report.requirements import METHOD, quantile_interval, share_interval
from gough_stewart.harness.report.terminal import text_of
from gough_stewart.harness.results.bands import LEVELS
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.harness.results.record_data import faults_of
from gough_stewart.harness.table_file import read_parquet
from gough_stewart.model.vectors import FloatArray

# The share of the machines about which the verdict speaks.
SHARE_TOLD = 0.95
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
# Causes and inputs that tables show at first, inputs that matter alike by name, inputs that are columns.
_MOST_CAUSES, _MOST_INPUTS, _MOST_NAMED, _MOST_COLUMNS = 8, 8, 3, 5
# A number in the text of a cause, which differs between members.
_NUMBER = re.compile(r"(?<![\w.])[-−+]?\d+(\.\d+)?([eE][-+]?\d+)?")
# So many times the tolerance is no matter of single steps.
_FAR_BEYOND = 10.0
_TWO, _FOUR = Quantity("", "", digits=2), replace(SHARE, digits=4)


@dataclass(frozen=True, eq=False, repr=False)
class Ensemble(MemberTable):
    """The results of an ensemble; its display shows quantiles of the metrics, and failures."""

    def report(  # noqa: PLR0915 - a section for each table, and the notes
        self, *, charts: bool = True, worst: Sequence[int] | Mapping[int, str] = ()
    ) -> Report:
        """Report on how many machines complete their runs and how well, what fails, and which inputs matter.

        Parameters
        ----------
        charts
            Also bands over time, histograms and dependence.
        worst
            Members to list, or a mapping from member to the address of its page ("" for none).

        Returns
        -------
        Report
            Verdict, all metrics as numbers with a value for each member, tables, and with `charts` bands and
            distributions.
        """
        by, metadata, pages = self.worst_by, self.metadata, worst if isinstance(worst, Mapping) else {}
        sensitivity = sensitivity_of(self, by)
        tables = [_quantile_table(self, self.usual_metrics)]

        # members that did not complete: causes that differ only in numbers count as one, which its first member tells
        failed = self.members.filter(polars.col("outcome") != "completed")
        failures: dict[tuple[str, str], list[tuple[int, str]]] = {}
        for member, outcome, cause in failed.select("member", "outcome", "cause").iter_rows():
            failures.setdefault((outcome, _NUMBER.sub("#", cause or "")), []).append((member, cause or ""))
        if failures:
            first_ones = [(alike[0][0], outcome, alike[0][1], len(alike)) for (outcome, _), alike in failures.items()]
            first_ones.sort(key=lambda row: -row[-1])
            links = tuple(pages.get(member, "") for member, *_ in first_ones)
            columns = tuple(map(Column, ("member", "outcome", "cause", "members with it")))
            note = "The first member of each cause. "
            note += "`gough-stewart run EXPERIMENT --member N --open` shows member N as a run."
            links = links if any(links) else ()
            tables.append(Table("Not completed", columns, tuple(first_ones), sortable=True, first_shown=_MOST_CAUSES,
                                note=note, links=links))  # fmt: skip

        # effects of the inputs on the metric, the most influential first
        if sensitivity is not None:
            half = Column("±", _TWO, "half of the 95 % confidence interval")
            columns = (Column("input"), Column("β", _TWO, "standardised regression coefficient"), half)
            if sensitivity.method == "sobol":
                alone = Column("alone", _TWO, "share of the variance, first order")
                total = Column("in total", _TWO, "share of the variance with all interactions")
                columns = (Column("input"), alone, half, total, replace(half, name="± "))
            rows: list[tuple[Cell, ...]] = [
                (sensitivity.inputs[k], *(float(values[k]) for effect in sensitivity.effects for values in effect))
                for k in sensitivity.order
            ]
            title, note = f"What makes the {metric_of(by).text} vary", f"{sentence([sensitivity.remark])}."
            tables.append(Table(title, columns, tuple(rows), first_shown=_MOST_INPUTS, note=note, beside=True))

        # the worst members with their outcome, the metric, and what was drawn for the first inputs
        if worst:
            metric, inputs = metric_of(by), self.varied
            if sensitivity is not None:
                inputs = tuple(sensitivity.inputs[k] for k in sensitivity.order)
            numeric = [name for name in inputs if name in self.varied]
            shown, more = numeric[:_MOST_COLUMNS], len(numeric[_MOST_COLUMNS:])
            drawn = (Column(name, quantity_of_input(name)) for name in shown)
            columns = (Column("member"), Column("outcome"), Column(metric.text, metric.quantity), *drawn)
            numbers = [self.values(by), *(self.numbers(f"varied.{name}") for name in shown)]
            row_of = {member: k for k, member in enumerate(self.members["member"].to_list())}
            rows = [
                (m, str(self.members["outcome"][row_of[m]]), *(float(values[row_of[m]]) for values in numbers))
                for m in worst
            ]
            note = f"{more} more inputs are in `members.parquet`." if more else ""
            links = tuple(pages.get(member, "") for member in worst) if pages else ()
            tables.append(Table(f"Worst members by {metric.text}", columns, tuple(rows), sortable=True, detail=True,
                                links=links, note=note))  # fmt: skip
        sections = [Section("Members", tuple(tables))]
        if charts:
            sections += ensemble_charts(self, by, sensitivity)
            all_metrics = [name for name in self.metrics if len(self.counted(name))]
            sections.append(Section("All metrics", (_quantile_table(self, all_metrics),), detail=True))

        # warnings, and what confidence intervals are of
        n = self.members.height
        warnings = [f"{text}; of factors, write {{ factor = … }}" for text in metadata.get("outside", ())]
        warnings.append(self.oscillation_warning)
        unjudged = self.members.filter((polars.col("outcome") == "completed") & polars.col("cause").is_not_null())
        if unjudged.height:
            first_unjudged = f"the first is member {unjudged['member'][0]}, {unjudged['cause'][0]}"
            warnings.append(f"{unjudged.height} of {n} members completed but could not be judged; {first_unjudged}")
        if metadata.get("substeps") is not None and "tolerance" in metadata:
            errors, tolerance = self.numbers("integration_error"), float(metadata["tolerance"])
            if beyond := int(np.count_nonzero(errors > _FAR_BEYOND * tolerance)):
                farthest = int(self.members["member"][int(np.nanargmax(errors))])
                warnings.append(
                    f"integration errors up to {np.nanmax(errors):.2g} in a plant step (member {farthest}), and more "
                    f"than {_FAR_BEYOND:g} times the tolerance of {tolerance:g} in {beyond} of {n} members; shorten "
                    "plant.fixed_step_size, or leave it out"
                )
        combinations = metadata.get("combinations", 1)
        if n % combinations:
            remark = f"{count(n, 'member')} of grids with {combinations:,} combinations have the first ones more often"
            warnings.append(f"{remark}: choose a multiple for shares and quantiles of the whole grids")
        notes = [Note(text, "warning") for text in warnings if text]
        if text := _CONFIDENCE.get(metadata.get("sampling", "random"), ""):
            text = text.format(points=f"{n // self.block:,}", members=f"{n:,}", block=self.block)
            notes.append(Note(f"Confidence intervals are {text}"))

        seed = f", seed {metadata['seed']}" if "seed" in metadata else ""
        report = Report(
            self.title,
            _verdict(self, by, sensitivity),
            tuple(sections),
            study="ensemble",
            lead=f"{count(n, 'member')} {_DRAWN[metadata.get('sampling', 'random')]}{seed}",
            numbers=ensemble_numbers(self),
            settings=settings_of(metadata.get("settings") or {}),
            notes=tuple(notes),
        )
        return fine(report, self.fineness)

    def __repr__(self) -> str:
        """Title and report as in the terminal."""
        return "\n".join([f"Ensemble: {self.title}", text_of(self.report(charts=False))])

    def _repr_html_(self) -> str:
        """The report, for a notebook."""
        return to_html(self.report(charts=False))


def read_ensemble(folder: Path | str) -> Ensemble:
    """An ensemble from its folder.

    Parameters
    ----------
    folder
        From `ensemble` with `out`, or the command with `--out`.

    Returns
    -------
    Ensemble
        Members, bands and metadata, with the samples of its members if it kept any.

    Raises
    ------
    RecordError
        The folder has no ensemble.

    See Also
    --------
    ensemble, Ensemble

    Examples
    --------
    >>> results = gs.ensemble("heave_tolerances", {"loop.duration": 0.1}, members=8, workers=1, out="results/eight")
    >>> gs.read_ensemble("results/eight").members.height
    8
    """
    folder = Path(folder)
    try:
        metadata: dict[str, Any] = json.loads((folder / METADATA).read_bytes())
        # results of older versions have no samples
        samples = read_parquet(folder / SAMPLES) if (folder / SAMPLES).is_file() else None
        return Ensemble(read_parquet(folder / MEMBERS), read_parquet(folder / BANDS), metadata, samples)
    except (OSError, ValueError, polars.exceptions.PolarsError) as error:
        raise RecordError(f"{folder} has no ensemble: {error}") from error


def _verdict(ensemble: MemberTable, by: str, sensitivity: Sensitivity | None) -> Verdict:
    """How many machines complete their runs, how well most of them do, and what makes them differ."""
    n, sound = ensemble.members.height, int(np.count_nonzero(ensemble.works))
    low, high = share_interval(sound / ensemble.block, n / ensemble.block)
    how = "complete their runs" + (" without a growing loop" if ensemble.oscillating["growing"] else "")
    # digits so that neither end is rounded to what it is not
    first, last = (percent(end, 3) for end in (low, high))
    interval = f"95 % confidence: {first.removesuffix(' %')} to {last}"
    parts = [
        *map(str, faults_of(ensemble.metadata)),
        f"{sound:,} of {count(n, 'machine')} {how} ({interval})",
    ]
    method = METHOD.format("members" if ensemble.block == 1 else "points of the design")
    carried = [Number("", "machines that complete", sound / n, _FOUR, low, high, explanation=method)]
    values, metric = ensemble.counted(by), metric_of(by)
    if len(values) > 1:
        is_lower = metric.better == "larger"
        level = 1 - SHARE_TOLD if is_lower else SHARE_TOLD
        value = float(np.quantile(values, level))
        ends = quantile_interval(values, level, independent=ensemble.independent(ensemble.are_counted(by)))
        quantity = fine(metric.quantity, ensemble.fineness)
        bound = at_least(quantity, value) if is_lower else at_most(quantity, value)
        words = f"have a {metric.text} of at {'least' if is_lower else 'most'} {bound}"
        if by in (PEAK, FINAL):
            words = f"{'stay' if by == PEAK else 'end'} within {bound} of their reference"
        # how sure the quantile is, in one unit for both ends, unless a small machine's differ
        least, most = ends
        if least is not None and most is not None:
            first, last = at_least(quantity, least), at_most(quantity, most)
            first = first.removesuffix(f" {last.split()[-1]}") if quantity.unit else first
            how_sure = f"{first} to {last}"
        else:
            side = f"at least {at_least(quantity, least)}; " if least is not None else ""
            side = f"at most {at_most(quantity, most)}; " if most is not None else side
            how_sure = f"{side}too few members for more"
        parts.append(f"{percent(SHARE_TOLD)} of them {words} ({how_sure})")
        name = f"{metric.text}, {percent(level)} of members below"
        method = "interval of the quantile between order statistics, 95 % confidence"
        carried.append(Number("", name, value, metric.quantity, *ends, explanation=method))
    # the input with the largest effect, or those that may have it, as far as they have one beyond doubt
    if sensitivity is not None and sensitivity.explains:
        effect, half = sensitivity.effects[-1]
        sure = [k for k in (sensitivity.order[0], *sensitivity.alike) if abs(effect[k]) > half[k]]
        names = [sensitivity.inputs[k] for k in sure[:_MOST_NAMED]]
        if sure == sensitivity.order[:1] and not sensitivity.alike:
            parts.append(f"{names[0]} matters most")
        elif len(sure) > 1 and sure[0] == sensitivity.order[0]:
            unnamed = [count(len(sure) - _MOST_NAMED, "other")] if len(sure) > _MOST_NAMED else []
            told = [f"{effect[k]:.2f} [{effect[k] - half[k]:.2f}, {effect[k] + half[k]:.2f}]" for k in sure]
            parts.append(f"{listed([*names, *unnamed])} matter alike ({listed(told[:_MOST_NAMED])})")
    outside = list(ensemble.metadata.get("outside", ()))
    status: Status = "bad" if not sound else "good" if sound == n and not outside else "marginal"
    return Verdict(sentence([*outside[:1], *parts]), status, tuple(carried))


def ensemble_numbers(ensemble: MemberTable) -> tuple[Number, ...]:
    """All metrics with a value for each member, NaN of those that did not complete, but for margins."""
    numbers = []
    for name in ensemble.metrics:
        values = ensemble.numbers(name)
        of_members = values if name.startswith("margins.") else np.where(ensemble.is_complete, values, np.nan)
        numbers.append(number_of_members(name, of_members, ensemble.block, ensemble.metadata.get("sampling")))
    return tuple(numbers)


def number_of_members(name: str, members: FloatArray, block: int = 1, sampling: str | None = None) -> Number:
    """A metric with its value for each member (N,), and the value that 95 % of those with one do not exceed.

    Of a metric that is better if larger, 95 % stay above.
    """
    metric, defined = metric_of(name), members[np.isfinite(members)]
    is_lower = metric.better == "larger"
    value = float(np.quantile(defined, 1 - SHARE_TOLD if is_lower else SHARE_TOLD)) if len(defined) else None
    return Number(name, metric.text, value, metric.quantity, explanation=metric.sentence, members=members,
                  small_is_worse=is_lower, block=block, in_sequence=sampling in ("sobol", "saltelli"))  # fmt: skip


def _quantile_table(ensemble: MemberTable, names: Sequence[str]) -> Table:
    """A row for each metric: its quantiles, and of how many members they are."""
    members, left_out = ensemble.members, int(np.count_nonzero(~ensemble.is_complete))
    rows: list[tuple[Cell, ...]] = []
    remarks = []
    for name in names:
        values, metric = ensemble.counted(name), metric_of(name)
        quantity = replace(metric.quantity, digits=3)
        marks = np.quantile(values, LEVELS).tolist() if len(values) else [None] * len(LEVELS)
        rows.append((metric.text, *(Value(mark, quantity) for mark in marks), len(values)))
        # of a time of a step response that some lack: after how long they had not reached it
        part, _, time = name.rpartition(".")
        words = {"settling_time": "settled to 2 %", "rise_time": "risen to 90 %"}.get(time)
        total = members.height - left_out
        if words is not None and len(values) < total and f"{part}.at" in members.columns:
            at, duration, axis = ensemble.counted(f"{part}.at"), ensemble.counted("ended"), part.rpartition(".")[2]
            waited = ""
            if len(at) and len(duration):
                waited = f" {about(TIME, float(duration.max() - at.min()))} after its step, when the run ended"
            remarks.append(
                f"In {total - len(values):,} of {count(total, 'member')} {axis} had not {words}{waited}: "
                "they have no such time, and the quantiles are of the faster ones."
            )
    remarks += [f"Quantiles are without the {count(left_out, 'member')} not completed."] if left_out else []
    columns = (
        Column(""),
        *(Column(f"{100 * level:g} %", None, f"{100 * level:g} % of the members stay below") for level in LEVELS),
        Column("members", None, "how many members have this number"),
    )
    counts = members["outcome"].value_counts().sort("outcome").iter_rows()
    ended = ", ".join(f"{number} {outcome}" for outcome, number in counts)
    motions = [f"{len(which)} {kind}" for kind, which in ensemble.oscillating.items() if which]
    ended += f" ({' and '.join(motions)} without input)" if motions else ""
    return Table(f"{count(members.height, 'member')}: {ended}", columns, tuple(rows), note=" ".join(remarks))
