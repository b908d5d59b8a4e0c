"""The worst members of an ensemble beside the nominal machine: their records, pages, signals and differences."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from gough_stewart.harness.ensemble.ensemble_report import Ensemble
from gough_stewart.harness.experiment.members import members_from
from gough_stewart.harness.experiment.run import records_of
from gough_stewart.harness.report.chart import Axis, Chart, Series, time_axis
from gough_stewart.harness.report.document import Cell, Column, File, Report, Section, Table, Value
from gough_stewart.harness.report.page import PAGE
from gough_stewart.harness.report.quantities import ANGLE, FORCE, LENGTH, Quantity
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.harness.results.metrics import finite_part, flattened, metrics
from gough_stewart.harness.results.oscillation import outcome_text
from gough_stewart.harness.view.view import MOST_RECORDS, difference, view_page
from gough_stewart.model.process.files import Content, write_files

WORST = "worst"
_METRICS = ("tracking.position.norm_peak", "tracking.orientation.norm_peak", "force.peak")
# Title and column of a record that is drawn as one curve: the length of its vector, or its largest magnitude.
_SIGNALS: tuple[tuple[str, str, Quantity, float], ...] = (
    ("position error", "error.position", LENGTH, 2),
    ("orientation error", "error.orientation", ANGLE, 2),
    ("largest force of a leg", "actuator_force", FORCE, np.inf),
)


def write_worst(ensemble: Ensemble, folder: Path, *, pages: bool = False, charts: bool = True) -> Report:
    """Run the nominal machine and the worst members again, and write their records.

    Returns
    -------
    Report
        Of the ensemble, with links to the members' pages, if there are `pages`, and after what it shows over time the
        worst member beside the nominal machine.
    """
    number = ensemble.metadata["experiment"]["ensemble"]["worst"]
    members = ensemble.worst_members(ensemble.worst_by, number)
    shutil.rmtree(folder / WORST, ignore_errors=True)  # those of an older run
    if not members:
        return ensemble.report(charts=charts)
    names = ["nominal machine", *(f"member {member}" for member in members)]
    folders = [f"{WORST}/nominal", *(f"{WORST}/member-{member}" for member in members)]
    records = records_of(members_from(ensemble.metadata["plan"]), [None, *members])
    page = f"{WORST}/{PAGE}" if pages else ""
    for name, place, record in zip(names, folders, records, strict=True):
        files: dict[str, Content] = {"record.parquet": record.to_parquet(), "metadata.json": record.to_metadata()}
        if pages:
            files[PAGE] = view_page([record], [name])
        write_files(folder / place, files)
    if pages:
        write_files(folder / WORST, {PAGE: view_page(records[:MOST_RECORDS], names[:MOST_RECORDS])})

    # what the worst does otherwise than the nominal machine: metrics, signals over each other, and differences
    worst, machines = names[1], dict(zip(names[:2], records[:2], strict=True))
    measured = [metrics(record) for record in machines.values()]
    flat = [flattened(of_record) for of_record in measured]
    shown = [path for path in _METRICS if any(of_record.get(path) is not None for of_record in flat)]
    rows: list[tuple[Cell, ...]] = [
        (
            name,
            outcome_text(of_record["outcome"]),
            *(Value(values.get(path), metric_of(path).quantity) for path in shown),
        )
        for name, of_record, values in zip(machines, measured, flat, strict=True)
    ]
    columns = (Column("machine"), Column("outcome"), *(Column(metric_of(path).text) for path in shown))
    note = f"On the page, {worst} leads to both machines in 3-D." if page else ""
    parts: list[Table | Chart] = [Table("", columns, tuple(rows), links=("", page) if page else (), note=note)]

    for title, name, quantity, order in _SIGNALS:
        finite = [finite_part(record) for record in machines.values()]
        if any(name not in part or not part.table.height for part in finite):
            continue
        (t0, first), (t1, second) = (
            (part["time"], np.asarray(np.linalg.norm(np.asarray(part[name], dtype=float), order, axis=1)))
            for part in finite
        )
        common, gap = difference((t0, t1), (first, second))
        curves = (
            Series("nominal machine", quantity, first, "nominal", x=t0),
            Series(worst, quantity, second, "actual", x=t1),
        )
        axis = time_axis(t0 if len(t0) >= len(t1) else t1)
        parts.append(Chart(title, axis, curves, y=Axis(title, quantity), group="beside"))
        if len(common):
            series = (Series(f"{worst} − nominal machine", quantity, gap, "error"),)
            y = Axis("difference", quantity)
            parts.append(Chart(f"{title}, difference", time_axis(common), series, y=y, group="beside"))
    beside = Section(f"Worst member, {members[0]}, beside the nominal machine", tuple(parts))

    links = {member: f"{place}/{PAGE}" if pages else "" for member, place in zip(members, folders[1:], strict=True)}
    report = ensemble.report(charts=charts, worst=links)
    titles = [section.title for section in report.sections]
    at = titles.index("Over time") + 1 if "Over time" in titles else 1
    return replace(
        report,
        sections=(*report.sections[:at], beside, *report.sections[at:]),
        files=(*report.files, *([File(page, "the worst members beside the nominal machine")] if page else [])),
    )
