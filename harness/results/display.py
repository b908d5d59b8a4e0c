"""A record as a few lines for a terminal, and as HTML for a notebook."""

import base64
import html
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gough_stewart.harness.report.document import Report
from gough_stewart.harness.report.notebook import table_to_html
from gough_stewart.harness.report.quantities import ANGLE, LENGTH, TIME
from gough_stewart.harness.report.small_machine import fine, fineness_of_record
from gough_stewart.harness.report.table import Cell, Column, Table, Value
from gough_stewart.harness.results.metrics import metrics
from gough_stewart.harness.results.outcome import outcome_of, outcome_text
from gough_stewart.harness.results.record_data import RecordData
from gough_stewart.harness.results.tables import metrics_tables

_ERRORS = {"position": LENGTH, "orientation": ANGLE, "leg_length": LENGTH}
_MEASURED = ("position", "orientation", "leg_length", "leg_velocity", "actuator_force")


def record_text(record: RecordData) -> str:
    """Title, run settings, size and peak errors, one per line."""
    table = _circumstances(record)
    rows = [table.texts(k) for k in range(len(table.rows))]
    width = max(len(name) for name, _ in rows)
    return "\n".join([table.title, *(f"  {name:{width}}  {text}" for name, text in rows)])


def record_html(record: RecordData, report_of: Callable[[], Report]) -> str:
    """The same as a table, with metrics and the pose figure if the record has the columns they need."""
    parts = [table_to_html(_circumstances(record))]
    is_whole = {"outcome", "platform"} <= record.metadata.keys() and all(name in record for name in _MEASURED)
    if is_whole and record.table.height:
        parts += map(table_to_html, metrics_tables(metrics(record)))
        picture = base64.b64encode(_pose(report_of())).decode()
        title = html.escape(str(record.metadata.get("title", "untitled")), quote=True)
        parts.append(f'<img alt="pose over time: {title}" width="800" src="data:image/png;base64,{picture}">')
    return f"<div>{''.join(parts)}</div>"


def _pose(report: Report) -> bytes:
    """The pose over time as PNG."""
    from gough_stewart.harness.report.figures import figures  # slow to import

    return figures(report, ("png",), "pose").get("pose.png", b"")


def _circumstances(record: RecordData) -> Table:
    """How the run was made, and its peak errors."""
    fineness = fineness_of_record(record.metadata)
    known = record.metadata
    found: list[tuple[Cell, ...]] = []
    if "platform" in known:
        found.append(("platform", str(known["platform"].get("name", "unnamed"))))
    if known.get("plant"):
        found.append(("plant", str(known["plant"])))
    if "outcome" in known:
        found.append(("outcome", outcome_text(outcome_of(record) if "platform" in known else known["outcome"])))
    rows, columns = record.table.shape
    found.append(("table", f"{rows} rows, {columns} columns"))
    if rows and "time" in record:
        first, last = (replace(TIME, digits=6).text(float(record["time"][k]), unit=k < 0) for k in (0, -1))
        found.append(("time", f"{first} to {last}"))
    for name, quantity in _ERRORS.items():
        error = np.abs(record[f"error.{name}"]) if f"error.{name}" in record else np.zeros(0)
        finite = error[np.isfinite(error)]
        if finite.size:
            found.append(
                (f"peak error of {name.replace('_', ' ')}", Value(float(finite.max()), fine(quantity, fineness)))
            )
    return Table(f"Record: {known.get('title', 'untitled')}", (Column(""), Column("")), tuple(found))
