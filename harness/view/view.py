"""The page of a run, or of several over each other: what differs between their files, metrics and charts."""

import webbrowser
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.experiment.overrides import value_text
from gough_stewart.harness.report.chart import Axis, Chart, Scene, Series
from gough_stewart.harness.report.document import Cell, Column, Note, Number, Report, Section, Setting, Table, Verdict
from gough_stewart.harness.report.page import PAGE, page_of
from gough_stewart.harness.report.quantities import Quantity, at_most, fine, fineness_of, listed
from gough_stewart.harness.results.metric_folds import METRICS, metric_of
from gough_stewart.harness.results.metrics import flattened, metrics, metrics_tables
from gough_stewart.harness.results.oscillation import is_sound, outcome_text
from gough_stewart.harness.results.record import Record, platform_of, read_record
from gough_stewart.harness.results.run_charts import DrawnRun, run_charts, scenes, shown
from gough_stewart.harness.results.run_report import parameters_table, run_table, versions_table
from gough_stewart.model.errors import GoughStewartError, OutputError
from gough_stewart.model.process.files import check_output_folder, write_files
from gough_stewart.model.process.progress import StepProgress
from gough_stewart.model.vectors import FloatArray

# As many as there are colours that differ enough.
MOST_RECORDS = 6
_BEST = "★ "
_PEAK, _LEFT = "tracking.position.norm_peak", ("tracking.position.norm_final", "tracking.orientation.norm_final")
# Times of two clocks closer than this are the same, computed differently [s].
_SAME_TIME = 1e-9
# Letters of values that stand beside a key in a sentence, and keys that are named there.
_SHORT, _MOST_KEYS = 40, 4
Shown = Record | Path | str


def view(
    records: Shown | Iterable[Shown],
    out: Path | str = PAGE,
    *,
    names: Sequence[str] | None = None,
    show: bool = False,
    progress: StepProgress | None = None,
) -> Path:
    """Write one page for the browser: the platform in 3-D motion, with charts, metrics and parameters.

    The page is self-contained: it needs no network, server or other file. Several records are overlaid.

    Parameters
    ----------
    records
        A `Record`, or the folder or file of one; or a sequence of up to six.
    out
        The page to write, ending in .html; its folder is created if needed.
    names
        Name of each record; by default its folder, or the title of a record without a file.
    show
        Open the page in the browser.
    progress
        Called with the name of each step.

    Returns
    -------
    Path
        The page written.

    Raises
    ------
    RecordError
        There is no record, more than six, or one that cannot be read or drawn; or the number of names differs.
    OutputError
        The page cannot be written there.

    See Also
    --------
    run, save_record, metrics

    Examples
    --------
    >>> records = [gs.run("pitch_sine", {"controller.bandwidth": hertz, "loop.duration": 0.1}) for hertz in (2, 4)]
    >>> page = gs.view(records, "bandwidths.html", names=["2 Hz", "4 Hz"])
    """
    out, say = Path(out), progress or (lambda _step: None)
    if out.suffix not in (".html", ".htm"):
        raise OutputError(f"{out}: expected the name of a page, such as {out}.html")
    items = [records] if isinstance(records, Shown) else list(records)
    check_output_folder(out.parent, [out.name])
    say("reading")
    read = [item if isinstance(item, Record) else read_record(item) for item in items]
    if names is None:
        # folders, or paths if these are equal; of other records their titles
        paths = [Path(item) for item in items if not isinstance(item, Record)]
        folders = [(path.absolute() if path.is_dir() else path.absolute().parent).name for path in paths]
        of_files = iter(folders if len(set(folders)) == len(folders) else map(str, paths))
        titles = [
            str(item.metadata.get("title", "record")) if isinstance(item, Record) else next(of_files) for item in items
        ]
        labels = [f"{title} ({k + 1})" if titles.count(title) > 1 else title for k, title in enumerate(titles)]
    else:
        labels = list(names)
    if len(labels) != len(read):
        raise RecordError(f"{len(labels)} names for {len(read)} records; expected one per record")
    say("writing the page")
    write_files(out.parent, {out.name: view_page(read, labels)})
    if show:
        webbrowser.open(out.absolute().as_uri())
    return out


def view_page(records: Sequence[Record], names: Sequence[str]) -> bytes:
    """Create the page of one record, or of several over each other.

    The same records give the same bytes.

    Rows from the first one that is not finite are left out of charts and animation; tables use all rows. A RecordError
    names a record without a finite row, its platform, or a column that is drawn; there may be `MOST_RECORDS`.
    """
    if not 1 <= len(records) <= MOST_RECORDS:
        raise RecordError(f"{len(records)} records; expected 1 to {MOST_RECORDS} of them on a page")
    runs = []
    for record, name in zip(records, names, strict=True):
        if not record.metadata.get("outcome"):
            raise RecordError(f"{name}: the metadata have no outcome; expected what `gough-stewart run` writes")
        try:
            run = shown(record, platform_of(record, "machine"), name)
        except GoughStewartError as error:
            raise RecordError(f"{name}: {error}") from error
        if run is None:
            raise RecordError(f"{name}: no row with finite values; there is nothing to show")
        runs.append(run)
    if len(records) > 1:
        report = comparison_report(records, runs, " · ".join(names))
    else:
        report = records[0].report()
        named = []
        for section in report.sections:
            parts = (replace(part, name=names[0]) if isinstance(part, Scene) else part for part in section.parts)
            named.append(replace(section, parts=tuple(parts)))
        title = str(records[0].metadata.get("title", names[0]))
        report = replace(report, title=title, sections=tuple(named))
    return page_of(report)


def comparison_report(records: Sequence[Record], runs: Sequence[DrawnRun], title: str) -> Report:
    """The report of several runs; charts show the runs over each other, and each run minus the first."""
    names, measured = tuple(run.name for run in runs), [metrics(record) for record in records]
    first, others = run_charts(runs)
    fineness = min(fineness_of(run.machine) for run in runs)
    # the keys of the runs' files, and the parameters of their machines
    settings = differing(
        {
            **{name: record.metadata.get(name) for name in ("plant", "experiment")},
            "machine": record.metadata["platform"],
        }
        for record in records
    )
    sections = [
        Section("Motion", tuple(scenes(runs))),
        Section("Metrics side by side", (side_by_side(records, measured, names, fineness),)),
        first,
        Section(f"Differences from {names[0]}", tuple(differences(first, names))),
        others,
    ]
    for record, run, metrics_of_run in zip(records, runs, measured, strict=True):
        believed = platform_of(record)
        about_run = run_table(record, believed, metrics_of_run["outcome"]), parameters_table(run.machine, believed)
        tables = (*metrics_tables(metrics_of_run), *about_run, versions_table(record))
        sections.append(Section(f"{run.name}: all metrics, run, parameters", tables, True))
    outcomes = [(name, run["outcome"]) for name, run in zip(names, measured, strict=True)]
    report = Report(
        title,
        _verdict(records, measured, names, fineness),
        tuple(section for section in sections if section.parts),
        study="compare",
        lead=differ_in(settings),
        settings=settings,
        runs=names,
        notes=tuple(Note(f"{name}: {outcome_text(end)}", "warning") for name, end in outcomes if not is_sound(end)),
    )
    return fine(report, fineness)


# --- which is best ---------------------------------------------------------------------------------------------------


def _verdict(
    records: Sequence[Record], measured: Sequence[Mapping[str, Any]], names: Sequence[str], fineness: float
) -> Verdict:
    """Which run follows best, if all had the same task and completed it.

    The largest error of a step is the step itself; steps are compared by what is left after settling, then by the time
    that settling takes, and their rise times are told.
    """
    flat = [flattened(metrics_of_run) for metrics_of_run in measured]
    steps = sorted({path.rpartition(".")[0] for run in flat for path in run if path.endswith(".rise_time")})
    settling, rise = ([f"{step}.{kind}" for step in steps] for kind in ("settling_time", "rise_time"))
    values = {path: [run.get(path) for run in flat] for path in (_PEAK, *_LEFT, *settling, *rise)}
    ranked = [*_LEFT, *settling, _PEAK] if steps else [_PEAK, *_LEFT]
    known = [path for path in ranked if None not in values[path]]

    numbers = []
    for path in [_LEFT[0], *rise, *settling, _LEFT[1]] if steps else [_PEAK]:
        metric = metric_of(path)
        pairs = zip(names, values[path], strict=True)
        numbers += [Number("", f"{metric.text}: {name}", v, metric.quantity) for name, v in pairs if v is not None]
    told = tuple(numbers)
    ended = [name for name, run in zip(names, measured, strict=True) if not is_sound(run["outcome"])]
    if ended:
        return Verdict(f"{listed(ended)} did not end well; the others are side by side below", "marginal", told)
    if not has_same_task(records):
        return Verdict("The runs have different references or durations, so that none is best", "told", told)

    beside = ""
    for path in rise:
        times = [fine(metric_of(path).quantity, fineness).text(value) for value in values[path]]
        if len(set(times)) > 1:
            told_times = [f"{text} ({name})" for name, text in zip(names, times, strict=True)]
            beside += f"; {metric_of(path).text} {listed(told_times)}"
    for path in known:
        quantity = fine(metric_of(path).quantity, fineness)
        top = best(path, values[path], quantity)
        if not top:
            continue
        sizes = [abs(value or 0.0) for value in values[path]]
        leaders, last = listed([names[k] for k in sorted(top)]), max(range(len(names)), key=sizes.__getitem__)
        bounds = [at_most(quantity, sizes[k]) for k in (min(top), last)]
        ending = "s" if len(top) == 1 else ""
        verb, place = (f"settle{ending} first", "in") if path in settling else (f"follow{ending} best", "within")
        after = (" after settling" if steps else " at the end") if path in _LEFT else ""
        text = f"{leaders} {verb}, {place} {bounds[0]}{after}; {names[last]} {place} {bounds[1]}{beside}"
        return Verdict(text, "told", told)
    alike = f"{listed(names)} end equally near" if beside else f"{listed(names)} follow equally well"
    return Verdict(alike + beside, "told", told)


def side_by_side(
    records: Sequence[Record], measured: Sequence[Mapping[str, Any]], names: Sequence[str], fineness: float = 1.0
) -> Table:
    """The metrics of the runs, one column each.

    The best values of a row are marked if all runs have the same reference and duration, all completed, and no loop
    oscillates or grows without input.
    """
    flat = [flattened(run) for run in measured]
    marks = has_same_task(records) and all(is_sound(run["outcome"]) for run in measured)
    rows: list[tuple[Cell, ...]] = [("outcome", *(outcome_text(run["outcome"]) for run in measured))]
    for metric in METRICS:
        if metric.is_compared and any(metric.path in run for run in flat):
            quantity = replace(fine(metric.quantity, fineness), digits=4)
            values = [run.get(metric.path) for run in flat]
            tops = best(metric.path, values, quantity) if marks else set()
            cells = (
                f"{_BEST if k in tops else ''}{quantity.text(value, unit=False)}" for k, value in enumerate(values)
            )
            rows.append((quantity.headed(metric.text), *cells))
    note = f"{_BEST.strip()} is the best of its row." if marks else ""
    return Table("", (Column(""), *map(Column, names)), tuple(rows), note=note)


def best(path: str, values: Sequence[float | None], quantity: Quantity) -> set[int]:
    """Indices of the best values of a metric, as displayed; none if all are equal or the metric is not ranked."""
    better = metric_of(path).better
    sizes = {k: -value if better == "larger" else abs(value) for k, value in enumerate(values) if value is not None}
    if better is None or len(sizes) < 2:
        return set()
    texts = {k: quantity.text(size, unit=False) for k, size in sizes.items()}
    least = min(sizes.values())
    top = {texts[k] for k, size in sizes.items() if size == least}
    leaders = {k for k, text in texts.items() if text in top}
    return leaders if len(leaders) < len(sizes) else set()


def has_same_task(records: Sequence[Record]) -> bool:
    """Whether all runs had the same reference for the same time."""
    tasks = [(r.metadata.get("duration"), (r.metadata.get("experiment") or {}).get("reference")) for r in records]
    return all(task == tasks[0] for task in tasks)


# --- what differs ----------------------------------------------------------------------------------------------------


def differing(values: Iterable[Mapping[str, Any]]) -> tuple[Setting, ...]:
    """The keys, down to single values, that are not the same in all, with units; an experiment's as in its file."""

    def flat(value: Any, path: str = "") -> list[tuple[str, Any]]:
        if isinstance(value, Mapping):
            return [pair for key, part in value.items() for pair in flat(part, f"{path}.{key}" if path else str(key))]
        if isinstance(value, list) and value and isinstance(value[0], Mapping):
            return [pair for k, part in enumerate(value) for pair in flat(part, f"{path}[{k + 1}]")]
        return [] if value is None else [(path, value)]

    files = [dict(flat(file)) for file in values]
    settings = []
    for key in dict.fromkeys(key for file in files for key in file):
        name = key.removeprefix("experiment.")
        texts = tuple(value_text(name, file[key]) if key in file else "–" for file in files)
        if len(set(texts)) > 1:
            settings.append(Setting(name, texts))
    return tuple(settings)


def differ_in(settings: Sequence[Setting]) -> str:
    """The keys in which the runs differ, with their values, but for names; "" if there is none."""
    keys = [setting for setting in settings if setting.key not in ("title", "description")]
    told = []
    for setting in keys[:_MOST_KEYS]:
        text = ", ".join(setting.values)
        told.append(setting.key + (f" ({text})" if len(text) <= _SHORT else ""))
    told += [f"{len(keys) - _MOST_KEYS} more"] if len(keys) > _MOST_KEYS else []
    return f"They differ in {listed(told)}" if told else ""


def differences(section: Section, names: Sequence[str]) -> list[Chart]:
    """The charts of a section with every other run minus the first, component by component."""
    charts = []
    for chart in section.parts:
        if not isinstance(chart, Chart):
            continue
        firsts = {(series.role, series.component): series for series in chart.series if series.run == 0}
        minus_first: list[Series] = []
        for series in chart.series:
            first = firsts.get((series.role, series.component))
            if not series.run or first is None or series.role == "reference":
                continue
            times = (chart.x_of(first), chart.x_of(series))
            common, values = difference(times, (first.values, series.values), chart.kind == "step")
            if len(common):
                name = f"{names[series.run]}: {series.component}"
                minus_first.append(replace(series, name=name, values=values, x=common, role="error"))
        if minus_first:
            longest = max((series.x for series in minus_first if series.x is not None), key=len)
            x, y = replace(chart.x, values=longest), Axis("difference", minus_first[0].quantity)
            charts.append(Chart(f"{chart.title}, difference", x, tuple(minus_first), chart.kind, y))
    return charts


def difference(
    time: tuple[FloatArray, FloatArray], values: tuple[FloatArray, FloatArray], holds: bool = False
) -> tuple[FloatArray, FloatArray]:
    """The second of two arrays (n,) and (m,) minus the first, at the times of both in their common span.

    Between rows, values are interpolated linearly, or held if `holds`. Without a common span there are no times.
    """
    if np.array_equal(*time):
        return time[0], values[1] - values[0]
    common = np.union1d(*time)
    # the last of those that are the same, at which both records have that row
    common = common[np.append(np.diff(common) > _SAME_TIME, True)]
    start, end = max(clock[0] for clock in time), min(clock[-1] for clock in time)
    common = common[(common >= start) & (common <= end + _SAME_TIME)]
    first, second = (
        column[np.searchsorted(clock, common, side="right") - 1] if holds else np.interp(common, clock, column)
        for clock, column in zip(time, values, strict=True)
    )
    return common, second - first
