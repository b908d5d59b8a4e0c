"""Tables of a report as HTML."""

import html
from urllib.parse import quote

from gough_stewart.harness.report.columns import is_at_right
from gough_stewart.harness.report.glossary import explained, with_terms
from gough_stewart.harness.report.table import Cell, Column, Table, Value
from gough_stewart.harness.report.words import with_minus


def table_html(table: Table) -> str:
    """A table; the columns of numbers are at the right, and rows beyond the first ones wait for a button."""
    all_texts = [table.texts(k) for k in range(len(table.rows))]
    at_right = [
        k > 0 and is_at_right([row[k] for row in table.rows], [texts[k] for texts in all_texts])
        for k in range(len(table.columns))
    ]
    heads = "".join(
        _head_cell(column, table.sortable, right) for column, right in zip(table.columns, at_right, strict=True)
    )
    rows = []
    for k, row in enumerate(table.rows):
        classes = ["group-end"] if k in table.group_ends else []
        classes += ["late"] if table.first_shown is not None and k >= table.first_shown else []
        kind = f' class="{" ".join(classes)}"' if classes else ""
        texts = all_texts[k]
        first = with_terms(texts[0])
        if table.links and table.links[k]:
            first = link(table.links[k], texts[0])
        cells = [f'<th scope="row"{_sorted_by(row[0]) if table.sortable else ""}>{first}</th>']
        for cell, text, right in zip(row[1:], texts[1:], at_right[1:], strict=True):
            value = _sorted_by(cell) if table.sortable else ""
            shown = html.escape(with_minus(text) if right else text)
            cells.append(f"<td{_class('n' if right else '')}{value}>{shown}</td>")
        kind += f' data-member="{row[0]}"' if table.columns[0].name == "member" else ""
        rows.append(f"<tr{kind}>{''.join(cells)}</tr>")
    late = len(table.rows) - (table.first_shown or len(table.rows))
    button = f'<button type="button" class="all">show all {len(table.rows)} rows</button>' if late > 0 else ""
    caption = f"<caption>{with_terms(table.title)}</caption>"
    note = f'<p class="hint">{with_terms(table.note)}</p>' if table.note else ""
    head = f"<thead><tr>{heads}</tr></thead>" if any(column.name for column in table.columns) else ""
    body = f"<table{_class('folded' if late > 0 else '')}>{caption}{head}<tbody>{''.join(rows)}</tbody></table>"
    label = html.escape(table.title or "table")
    return (
        f'<div class="table" role="group" aria-label="{label}"><div class="sideways">{body}</div>{button}{note}</div>'
    )


def link(file: str, text: str) -> str:
    """A link to a file in the page's folder, whose name may have marks of URLs; only the text of a path out of it."""
    is_inside = not file.startswith("/") and ".." not in file.split("/")
    return f'<a href="{quote(file)}">{html.escape(text)}</a>' if is_inside else html.escape(text)


def _class(name: str) -> str:
    return f' class="{name}"' if name else ""


def _head_cell(column: Column, sortable: bool, right: bool) -> str:
    kind = _class("n" if right else "")
    if not column.name:
        return f"<td{kind}></td>"
    text = explained(column.title, column.explanation)
    if not sortable:
        return f'<th scope="col"{kind}>{text}</th>'
    button = f'<button type="button" class="sort">{html.escape(column.title)}</button>'
    return f'<th scope="col"{kind} aria-sort="none">{button}</th>'


def _sorted_by(cell: Cell) -> str:
    value = cell.value if isinstance(cell, Value) else cell
    return f' data-value="{float(value)!r}"' if isinstance(value, int | float) and not isinstance(value, bool) else ""
