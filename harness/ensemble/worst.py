"""The worst members of an ensemble beside the nominal machine: their records, pages, signals and differences."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gough_stewart.harness.ensemble.data import worst_members
from gough_stewart.harness.ensemble.report import Ensemble, worst_by
from gough_stewart.harness.experiment.members import plan_from
from gough_stewart.harness.experiment.run import records_of
from gough_stewart.harness.report.chart import Axis, Chart, Series, time_axis
from gough_stewart.harness.report.document import File, Report, Section
from gough_stewart.harness.report.quantities import ANGLE, FORCE, LENGTH, Quantity
from gough_stewart.harness.report.table import Cell, Column, Table, Value
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.harness.results.metrics import finite_part, flattened, metrics
from gough_stewart.harness.results.oscillation import outcome_text
from gough_stewart.harness.results.record import Record
from gough_stewart.harness.view.view import difference
from gough_stewart.model.process.files import Content, write_files
from gough_stewart.model.vectors import FloatArray

WORST = "worst"
_METRICS = ("tracking.position.norm_peak", "tracking.orientation.norm_peak", "force.peak")
# Title, columns of a record, how they are drawn as one curve, and whether that is held between rows.
_SIGNALS: tuple[tuple[str, str, Quantity, str], ...] = (
    ("position error", "error.position", LENGTH, "length"),
    ("orientation error", "error.orientation", ANGLE, "length"),
    ("largest force of a leg", "actuator_force", FORCE, "largest"),
)


class Worst(NamedTuple):
    """The worst members as files, and what is shown of the first one."""

    links: dict[int, str]  # the address of each one's page, or ""
    section: Section | None  # beside the nominal machine; None without members
    page: str  # of the nominal machine and the worst members over each other; "" for none

    def shown_in(self, report: Report) -> Report:
        """The report with the worst member beside the nominal machine after what it shows over time, and its page."""
        if self.section is None:
            return report
        titles = [section.title for section in report.sections]
        at = titles.index("Over time") + 1 if "Over time" in titles else 1
        sections = (*report.sections[:at], self.section, *report.sections[at:])
        beside = [File(self.page, "the worst members beside the nominal machine")] if self.page else []
        return replace(report, sections=sections, files=(*report.files, *beside))


def write_worst(ensemble: Ensemble, folder: Path, *, pages: bool = False) -> Worst:
    """Run the nominal machine and the worst members again, and write their records."""
    number = ensemble.metadata["experiment"]["ensemble"]["worst"]
    members = worst_members(ensemble.members, worst_by(ensemble), number)
    shutil.rmtree(folder / WORST, ignore_errors=True)  # those of an older run
    if not members:
        return Worst({}, None, "")
    links, names = {}, ["nominal machine", *(f"member {member}" for member in members)]
    folders = [f"{WORST}/nominal", *(f"{WORST}/member-{member}" for member in members)]
    records = records_of(plan_from(ensemble.metadata["plan"]), [None, *members])
    page = ""
    if pages:
        from gough_stewart.harness.report.page import PAGE
        from gough_stewart.harness.view.view import MOST_RECORDS, view_page
    for member, name, where, record in zip([None, *members], names, folders, records, strict=True):
        files: dict[str, Content] = {"record.parquet": record.to_parquet(), "metadata.json": record.to_metadata()}
        if pages:
            files[PAGE] = view_page([record], [name])
        write_files(folder / where, files)
        if member is not None:
            links[member] = f"{where}/{PAGE}" if pages else ""
    if pages:
        page = f"{WORST}/{PAGE}"
        write_files(folder / WORST, {PAGE: view_page(records[:MOST_RECORDS], names[:MOST_RECORDS])})
    return Worst(links, _beside_nominal(records[0], records[1], members[0], page, links[members[0]]), page)


def _beside_nominal(nominal: Record, worst: Record, member: int, page: str = "", own_page: str = "") -> Section:
    """What a member does otherwise than the nominal machine: metrics, signals over each other, and differences.

    `page` is the address of a page of both, `own_page` that of the member alone, which stands in for it; "" for none.
    """
    charts: list[Chart] = []
    for title, name, quantity, kind in _SIGNALS:
        curves = [_curve(record, name, kind) for record in (nominal, worst)]
        if any(curve is None for curve in curves):
            continue
        (t0, first), (t1, second) = (curve for curve in curves if curve is not None)
        common, gap = difference((t0, t1), (first, second))
        curves_of_both = (
            Series("nominal machine", quantity, first, "nominal", x=t0),
            Series(f"member {member}", quantity, second, "actual", x=t1),
        )
        axis = Axis(title, quantity)
        charts.append(Chart(title, time_axis(t0 if len(t0) >= len(t1) else t1), curves_of_both, y=axis, group="beside"))
        if len(common):
            series = (Series(f"member {member} − nominal machine", quantity, gap, "error"),)
            y = Axis("difference", quantity)
            charts.append(Chart(f"{title}, difference", time_axis(common), series, y=y, group="beside"))
    return Section(
        f"Worst member, {member}, beside the nominal machine", (_table(nominal, worst, member, page, own_page), *charts)
    )


def _curve(record: Record, name: str, kind: str) -> tuple[FloatArray, FloatArray] | None:
    """Times and one value of a signal: its length as a vector, or its largest magnitude."""
    part = finite_part(record)
    if name not in part or not part.table.height:
        return None
    values = np.asarray(part[name], dtype=float)
    curve = np.linalg.norm(values, axis=1) if kind == "length" else np.abs(values).max(axis=1)
    return part["time"], np.asarray(curve)


def _table(nominal: Record, worst: Record, member: int, page: str, own_page: str) -> Table:
    measured = [metrics(record) for record in (nominal, worst)]
    flat = [flattened(of_record) for of_record in measured]
    shown = [path for path in _METRICS if any(of_record.get(path) is not None for of_record in flat)]
    rows: list[tuple[Cell, ...]] = []
    for name, of_record, values in zip(("nominal machine", f"member {member}"), measured, flat, strict=True):
        numbers = (Value(values.get(path), metric_of(path).quantity) for path in shown)
        rows.append((name, outcome_text(of_record["outcome"]), *numbers))
    columns = (Column("machine"), Column("outcome"), *(Column(metric_of(path).text) for path in shown))
    links = ("", page or own_page) if page or own_page else ()
    note = f"On the page, member {member} leads to both machines in 3-D." if page else ""
    return Table("", columns, tuple(rows), links=links, note=note)
