"""A report in a notebook: verdict and tables as HTML."""

from html import escape

from gough_stewart.harness.report.document import Note, Report
from gough_stewart.harness.report.table import Table


def to_html(report: Report) -> str:
    """The verdict, the tables but those of details, and the notes; all texts escaped."""
    parts = [f"<p><strong>{escape(report.verdict.text)}</strong></p>"]
    for section in report.sections:
        for part in () if section.detail else section.parts:
            if isinstance(part, Table) and not part.detail and part.rows:
                parts.append(table_to_html(part))
                parts += [f"<p>{escape(part.note)}</p>"] if part.note else []
            elif isinstance(part, Note):
                parts.append(f"<p>{escape(part.text)}</p>")
    parts += [f"<p>{escape(note.text)}</p>" for note in report.notes]
    return f"<div>{''.join(parts)}</div>"


def table_to_html(table: Table) -> str:
    """A table, all texts escaped; a unit that all numbers of a row share stands beside its first cell."""
    rows = []
    for k in range(len(table.rows)):
        unit = table.shared_unit(k)
        first, *rest = table.texts(k, units=not unit)
        kind = ' class="group-end"' if k in table.group_ends else ""
        cells = "".join(f"<td>{escape(cell)}</td>" for cell in rest)
        rows.append(f"<tr{kind}>{_heading('row', first, unit)}{cells}</tr>")
    head = "".join(_heading("col", each.title) for each in table.columns)
    caption = f"<caption>{escape(table.title)}</caption>"
    return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _heading(scope: str, text: str, unit: str = "") -> str:
    """The head of a column or row; an empty cell is no head."""
    of = f' <span class="unit">{escape(unit)}</span>' if unit else ""
    return f'<th scope="{scope}">{escape(text)}{of}</th>' if text else "<td></td>"
