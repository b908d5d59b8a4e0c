"""Tables as plain data, for the terminal and for pages."""

from dataclasses import dataclass, field
from html import escape
from io import StringIO
from typing import TYPE_CHECKING

from rich.table import Table
from rich.text import Text

from gough_stewart.harness.output.columns import is_number, stacked_columns
from gough_stewart.harness.output.quantities_shown import LEAST_SPANS

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType, RenderResult


@dataclass(frozen=True)
class Named:
    """The first cell of a row: its quantity and unit."""

    what: str
    unit: str


@dataclass
class Sheet:
    """A table independent of its display: heads and rows of text, with names at the left."""

    title: str
    heads: tuple[str, ...]
    rows: list[tuple[str | Named, ...]] = field(default_factory=list)
    # indices of rows that end a group
    group_ends: list[int] = field(default_factory=list)

    def add(self, *cells: str | Named, ends_group: bool = False) -> None:
        """Add a row."""
        if ends_group:
            self.group_ends.append(len(self.rows))
        self.rows.append(cells)


class TerminalTable:
    """A sheet for rich, as wide as the terminal; columns that do not fit continue in a table below."""

    def __init__(self, sheet: Sheet) -> None:
        self.sheet = sheet

    def __rich_console__(self, _console: "Console", options: "ConsoleOptions") -> "RenderResult":
        """Print the title, and one table or several."""
        sheet = self.sheet
        texts = [tuple(map(_text, row)) for row in sheet.rows]
        columns = [(head, *(row[k].plain for row in texts)) for k, head in enumerate(sheet.heads)]
        if sheet.title:
            yield Text(sheet.title, "bold")
        for part in stacked_columns(columns, options.max_width):
            table = Table()
            for k, width in part:
                at_right = k > 0 and sheet.heads[k] != "" and is_number(columns[k][1:])
                table.add_column(
                    Text(sheet.heads[k]), justify="right" if at_right else "left", overflow="fold", width=width
                )
            for number, row in enumerate(texts):
                table.add_row(*(row[k] for k, _ in part), end_section=number in sheet.group_ends)
            yield table


def to_terminal(sheet: Sheet) -> TerminalTable:
    """A table for rich, without markup in texts."""
    return TerminalTable(sheet)


def to_html(sheet: Sheet) -> str:
    """A table in HTML, with all texts escaped."""
    heads = "".join(_heading("col", head) for head in sheet.heads)
    rows = []
    for k, (first, *rest) in enumerate(sheet.rows):
        kind = ' class="group-end"' if k in sheet.group_ends else ""
        cells = "".join(f"<td>{_hypertext(cell)}</td>" for cell in rest)
        rows.append(f"<tr{kind}>{_heading('row', first)}{cells}</tr>")
    caption = f"<caption>{escape(sheet.title)}</caption>"
    return f"<table>{caption}<thead><tr>{heads}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _heading(scope: str, cell: str | Named) -> str:
    """The head of a column or row; an empty cell is no head."""
    return f'<th scope="{scope}">{_hypertext(cell)}</th>' if cell else "<td></td>"


def text_of(table: "RenderableType") -> str:
    """The output of a terminal without colours, at most 100 columns wide."""
    from rich.console import Console

    console = Console(width=100, color_system=None, file=StringIO())
    with console.capture() as shown:
        console.print(table)
    return "\n".join(line.rstrip() for line in shown.get().splitlines())


def number_text(value: float | None, digits: int = 4) -> str:
    """A number with at most this many significant digits."""
    if value is None:
        return "–"
    text = f"{value:.{digits}g}"
    # large numbers in full: 18610 is shorter than 1.861e+04
    return f"{value:.0f}" if "e+" in text and abs(value) < 1e7 else text


def quantity_text(value: float | None, unit: str, digits: int = 4) -> str:
    """A number in a unit; below the display resolution, as for rounding errors, only "< 0.001" or the like."""
    least = LEAST_SPANS.get(unit, 0.0)
    if value is None or value == 0 or abs(value) >= least:
        return number_text(value, digits)
    return f"< {least:g}"


def _text(cell: str | Named) -> Text:
    if isinstance(cell, Named):
        return Text.assemble(cell.what, " ", (cell.unit, "dim"))
    return Text(cell)


def _hypertext(cell: str | Named) -> str:
    if isinstance(cell, Named):
        return f'{escape(cell.what)} <span class="unit">{escape(cell.unit)}</span>'
    return escape(cell)
