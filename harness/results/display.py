"""A record as a few lines for a terminal, and as HTML for a notebook."""

import base64
import html
from collections.abc import Callable

import numpy as np

from gough_stewart.harness.output.tables import Named, Sheet, number_text, to_html
from gough_stewart.harness.report.document import Report
from gough_stewart.harness.results.metrics import metrics
from gough_stewart.harness.results.outcome import outcome_of, outcome_text
from gough_stewart.harness.results.record_data import RecordData
from gough_stewart.harness.results.tables import metrics_sheets

_ERRORS = {"position": ("mm", 1e3), "orientation": ("deg", 180 / np.pi), "leg_length": ("mm", 1e3)}
_MEASURED = ("position", "orientation", "leg_length", "leg_velocity", "actuator_force")


def record_text(record: RecordData) -> str:
    """Title, run settings, size and peak errors, one per line."""
    sheet = _circumstances(record)
    width = max(len(_head(row[0])) for row in sheet.rows)
    return "\n".join([sheet.title, *(f"  {_head(row[0]):{width}}  {row[1]}" for row in sheet.rows)])


def record_html(record: RecordData, report_of: Callable[[], Report]) -> str:
    """The same as a table, with metrics and the pose figure if the record has the columns they need."""
    parts = [to_html(_circumstances(record))]
    is_whole = {"outcome", "platform"} <= record.metadata.keys() and all(name in record for name in _MEASURED)
    if is_whole and record.table.height:
        parts += [to_html(sheet) for sheet in metrics_sheets(metrics(record))]
        picture = base64.b64encode(_pose(report_of())).decode()
        title = html.escape(str(record.metadata.get("title", "untitled")), quote=True)
        parts.append(f'<img alt="pose over time: {title}" width="800" src="data:image/png;base64,{picture}">')
    return f"<div>{''.join(parts)}</div>"


def _pose(report: Report) -> bytes:
    """The pose over time as PNG."""
    from gough_stewart.harness.report.figures import figures  # slow to import

    return figures(report, ("png",), "pose").get("pose.png", b"")


def _circumstances(record: RecordData) -> Sheet:
    """How the run was made, and its peak errors."""
    known, sheet = record.metadata, Sheet(f"Record: {record.metadata.get('title', 'untitled')}", ("", ""))
    if "platform" in known:
        sheet.add("platform", str(known["platform"].get("name", "unnamed")))
    if known.get("plant"):
        sheet.add("plant", str(known["plant"]))
    if "outcome" in known:
        sheet.add("outcome", outcome_text(outcome_of(record) if "platform" in known else known["outcome"]))
    rows, columns = record.table.shape
    sheet.add("table", f"{rows} rows, {columns} columns")
    if rows and "time" in record:
        sheet.add(Named("time", "s"), f"{number_text(record['time'][0], 6)} to {number_text(record['time'][-1], 6)}")
    for name, (unit, factor) in _ERRORS.items():
        error = np.abs(record[f"error.{name}"]) if f"error.{name}" in record else np.zeros(0)
        finite = error[np.isfinite(error)]
        if finite.size:
            sheet.add(Named(f"peak error of {name.replace('_', ' ')}", unit), number_text(factor * finite.max()))
    return sheet


def _head(cell: str | Named) -> str:
    return f"{cell.what} [{cell.unit}]" if isinstance(cell, Named) else cell
