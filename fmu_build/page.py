"""Shared parts of the units' documentation pages: the HTML page and the table of variables."""

from collections.abc import Iterable, Mapping
from html import escape

from gough_stewart.fmu_build.formulas import STYLE
from gough_stewart.fmu_build.layout import Layout, Role, Row
from gough_stewart.model.vectors import Array

_STYLE = """
body { font-family: Helvetica, Arial, sans-serif; line-height: 1.45; color: #222222; background: #ffffff;
       max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
h1, h2 { line-height: 1.2; } h2 { margin-top: 2.2rem; border-bottom: 1px solid #c8d0d8; padding-bottom: 0.2rem; }
svg { max-width: 100%; height: auto; }
table { border-collapse: collapse; font-size: 0.9rem; } td, th { border: 1px solid #c8d0d8; padding: 0.25rem 0.5rem;
       text-align: left; vertical-align: top; } th { background: #eef1f4; }
code, pre { font-family: Consolas, Menlo, monospace; font-size: 0.9em; }
pre { background: #f4f6f8; padding: 0.8rem; white-space: pre-wrap; }
sub, sup { line-height: 0; }
.numbers { white-space: nowrap; font-size: 0.85em; }
"""


def html_page(title: str, sections: Iterable[str]) -> bytes:
    """A page as well-formed, self-contained HTML; sections are HTML."""
    return (
        '<!DOCTYPE html>\n<html xmlns="http://www.w3.org/1999/xhtml" lang="en">\n<head>\n<meta charset="utf-8"/>\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}{STYLE}</style>\n</head>\n<body>\n"
        + "\n".join(section.strip() for section in sections)
        + "\n</body>\n</html>\n"
    ).encode()


def variables_table(layout: Layout, starts: Mapping[str, Array], fmi_version: str, note: str = "") -> str:
    """The section that lists every variable; `note` is added to the text about arrays."""
    rows = "\n".join(_variable(row, starts, fmi_version) for row in layout.described(fmi_version))
    naming = (
        "FMI 2.0 has scalars only: elements have indices from 1, row by row, as shown in the first column."
        if fmi_version == "2.0"
        else "Arrays are listed row by row."
    )
    return f"""
<h2>Variables</h2>
<p>{f"{naming} {note}".strip()}</p>
<table>
<thead><tr><th>name</th><th>shape</th><th>causality</th><th>unit</th><th>start</th><th>description</th></tr></thead>
<tbody>
{rows}
</tbody>
</table>
""".strip()


def _variable(row: Row, starts: Mapping[str, Array], fmi_version: str) -> str:
    v = row.variable
    name = f"<code>{escape(v.name)}</code>"
    if fmi_version == "2.0" and v.shape:
        name += f"<br/><code>{escape(row.scalar_names[0])}</code> … <code>{escape(row.scalar_names[-1])}</code>"
    causality: str = "independent" if row.role is Role.INDEPENDENT else v.causality
    if causality == "parameter":
        causality = f"{v.variability} parameter"
    shape = " × ".join(map(str, v.shape)) or "scalar"
    return (
        f'<tr><td>{name}</td><td class="numbers">{shape}</td><td>{causality}</td>'
        f'<td class="numbers">{escape(v.unit)}</td><td class="numbers">{_start(starts.get(v.name))}</td>'
        f"<td>{escape(v.description)}</td></tr>"
    )


def _start(values: Array | None) -> str:
    """Start values with six digits, a line for every row of a matrix; one number if all digits are equal."""
    if values is None:
        return ""
    shown = {_number(value) for value in values.flat}
    if len(shown) == 1:
        return shown.pop()
    lines = values if values.ndim == 2 else values[None]
    return "<br/>".join(" ".join(map(_number, line)) for line in lines)


def _number(value: float) -> str:
    return f"{value + 0.0:.6g}".replace("-", "−")
