"""Tables as plain data, for the terminal and for pages."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from io import StringIO
from typing import TYPE_CHECKING, NamedTuple

from rich.cells import cell_len
from rich.table import Table
from rich.text import Text

from gough_stewart.harness.output.display_resolution import LEAST_SPANS

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType, RenderResult

_NUMBER = re.compile(r"[-+±×<(\s]*\d")
# Least widths of names and of long texts, which wrap; a word longer than the second is broken.
_NAME, _LONGEST_WORD = 18, 26


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


class Column(NamedTuple):
    """A column of a table in the terminal."""

    number: int
    width: int


class _Need(NamedTuple):
    """The least width of a column, and the width at which nothing in it wraps."""

    least: int
    natural: int


def is_prose(cells: Sequence[str]) -> bool:
    """Whether a column has texts that may wrap: several words, longer than any number."""
    return any(cell_len(cell) > _NAME and " " in cell for cell in cells)


def is_number(cells: Sequence[str]) -> bool:
    """Whether a column is right-aligned: it has numbers or vectors, and no sentences."""
    numbers = [_NUMBER.match(cell) is not None for cell in cells]
    return any(numbers) and (all(numbers) or not is_prose(cells))


def stacked_columns(columns: Sequence[Sequence[str]], width: int) -> list[list[Column]]:
    """Tables, one above the other, that show all columns within a width; each starts with the first column.

    A column is its head and its cells. Heads and names wrap first. If the numbers alone are too wide, the columns are
    divided among as few tables as possible: legs 1 to 3, then legs 4 to 6 and all.
    """
    needs = [_need(column, k == 0) for k, column in enumerate(columns)]
    number = max(len(needs) - 1, 1)
    for tables in range(1, number + 1):
        parts = _shared_out(len(needs), tables)
        if all(_framed(needs[k].least for k in part) <= width for part in parts):
            return _aligned([_widened(part, needs, width) for part in parts])
    # even one column beside the names is too wide: narrow the names
    widest = max((need.least for need in needs[1:]), default=0)
    needs[0] = _Need(max(1, min(needs[0].least, width - _framed([widest, 0]))), needs[0].natural)
    return _aligned([_widened(part, needs, width) for part in _shared_out(len(needs), number)])


def _need(column: Sequence[str], is_first: bool) -> _Need:
    head, *cells = column
    natural = max(map(cell_len, column))
    if is_first or is_prose(cells):
        word = max((cell_len(word) for cell in column for word in cell.split()), default=0)
        return _Need(min(natural, max(_NAME, min(word, _LONGEST_WORD))), natural)
    return _Need(max(map(cell_len, (*head.split(), *cells)), default=0), natural)


def _framed(widths: Iterable[int]) -> int:
    """Total width, with a space on both sides of each column, and lines between and around them."""
    return sum(each + 3 for each in widths) + 1


def _shared_out(columns: int, tables: int) -> list[list[int]]:
    """The first column and a share of the others, for each table; the last tables take one more."""
    share, more = divmod(columns - 1, tables)
    parts, start = [], 1
    for k in range(tables):
        end = start + share + (k >= tables - more)
        parts.append([0, *range(start, end)])
        start = end
    return parts


def _widened(part: list[int], needs: Sequence[_Need], width: int) -> list[Column]:
    """Give the remaining width to the columns that wrap, first to the one that lacks most."""
    widths = {k: needs[k].least for k in part}
    for _ in range(width - _framed(widths.values())):
        k = max(part, key=lambda k: needs[k].natural - widths[k])
        if widths[k] == needs[k].natural:
            break
        widths[k] += 1
    return [Column(k, widths[k]) for k in part]


def _aligned(tables: list[list[Column]]) -> list[list[Column]]:
    """Give the column of names the same width in all tables."""
    width = min(names.width for names, *_ in tables)
    return [[Column(0, width), *others] for _, *others in tables]
