"""Tables as plain data, for the terminal and for pages."""

from dataclasses import dataclass, field
from html import escape
from io import StringIO
from typing import TYPE_CHECKING, Literal

from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from rich.console import RenderableType


# A narrow terminal, and what it has to leave to names, so that they can still be read if they are broken.
_NARROW, _NAMES = 80, 18


@dataclass(frozen=True)
class Named:
    """A first cell: what the row is of, and its unit."""

    what: str
    unit: str


@dataclass
class Sheet:
    """A table before anybody has chosen how it looks: heads and rows of text, names at the left."""

    title: str
    heads: tuple[str, ...]
    rows: list[tuple[str | Named, ...]] = field(default_factory=list)
    # indices of rows that end a group
    group_ends: list[int] = field(default_factory=list)

    def add(self, *cells: str | Named, ends_group: bool = False) -> None:
        """One more row."""
        if ends_group:
            self.group_ends.append(len(self.rows))
        self.rows.append(cells)


def to_terminal(sheet: Sheet) -> Table:
    """For rich; every text is only a text."""
    table = Table(title=Text(sheet.title), title_justify="left", title_style="bold")
    # where a terminal is too narrow, names go on in a second line: a number that is cut off would be another number
    names_fold = _names_fold(sheet)
    for k, head in enumerate(sheet.heads):
        justify: Literal["left", "right"] = "right" if head and k else "left"
        table.add_column(Text(head), justify=justify, no_wrap=k > 0 or not names_fold)
    for k, row in enumerate(sheet.rows):
        table.add_row(*map(_text, row), end_section=k in sheet.group_ends)
    return table


def _names_fold(sheet: Sheet) -> bool:
    """Whether numbers, with three characters around each column, leave names their place."""
    columns = zip(sheet.heads[1:], *(row[1:] for row in sheet.rows), strict=False)
    numbers = sum(max(len(_text(cell)) for cell in column) + 3 for column in columns)
    return numbers + _NAMES + 4 <= _NARROW


def to_html(sheet: Sheet) -> str:
    """For a page; every text is escaped."""
    heads = "".join(f'<th scope="col">{escape(head)}</th>' for head in sheet.heads)
    rows = []
    for k, (first, *rest) in enumerate(sheet.rows):
        kind = ' class="group-end"' if k in sheet.group_ends else ""
        cells = "".join(f"<td>{_hypertext(cell)}</td>" for cell in rest)
        rows.append(f'<tr{kind}><th scope="row">{_hypertext(first)}</th>{cells}</tr>')
    caption = f"<caption>{escape(sheet.title)}</caption>"
    return f"<table>{caption}<thead><tr>{heads}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def text_of(table: "RenderableType") -> str:
    """What a terminal without colours shows, at most 100 columns wide."""
    from rich.console import Console

    console = Console(width=100, color_system=None, file=StringIO())
    with console.capture() as shown:
        console.print(table)
    return "\n".join(line.rstrip() for line in shown.get().splitlines())


def number_text(value: float | None, digits: int = 4) -> str:
    """At most so many significant digits."""
    if value is None:
        return "–"
    text = f"{value:.{digits}g}"
    # large ones as they are: 18610 is shorter than 1.861e+04
    return f"{value:.0f}" if "e+" in text and abs(value) < 1e7 else text


def _text(cell: str | Named) -> Text:
    if isinstance(cell, Named):
        return Text.assemble(cell.what, " ", (cell.unit, "dim"))
    return Text(cell)


def _hypertext(cell: str | Named) -> str:
    if isinstance(cell, Named):
        return f'{escape(cell.what)} <span class="unit">{escape(cell.unit)}</span>'
    return escape(cell)
