"""A report in a notebook: verdict and tables as HTML."""

from html import escape

from gough_stewart.harness.output.tables import to_html as html_of
from gough_stewart.harness.report.document import Note, Report, Table
from gough_stewart.harness.report.sheets import sheet_of


def to_html(report: Report) -> str:
    """The verdict, the tables but those of details, and the notes; all texts escaped."""
    parts = [f"<p><strong>{escape(report.verdict.text)}</strong></p>"]
    for section in report.sections:
        for part in () if section.detail else section.parts:
            if isinstance(part, Table) and not part.detail and part.rows:
                parts.append(html_of(sheet_of(part)))
                parts += [f"<p>{escape(part.note)}</p>"] if part.note else []
            elif isinstance(part, Note):
                parts.append(f"<p>{escape(part.text)}</p>")
    parts += [f"<p>{escape(note.text)}</p>" for note in report.notes]
    return f"<div>{''.join(parts)}</div>"
