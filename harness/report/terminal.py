"""A report in a terminal: the verdict, the numbers that carry it, requirements, then short tables.

Charts, scenes and details are for the page. Without a terminal there are no colours, and the verdict is one line.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from io import StringIO
from typing import TYPE_CHECKING

from rich.console import Console, Group
from rich.padding import Padding
from rich.table import Table as Rows
from rich.text import Text

from gough_stewart.harness.report.columns import is_at_right, stacked_columns
from gough_stewart.harness.report.document import Note, Number, Report, Requirement
from gough_stewart.harness.report.requirements import OUTCOMES
from gough_stewart.harness.report.table import Table

if TYPE_CHECKING:
    from rich.console import ConsoleOptions, RenderableType, RenderResult

_STYLES = {"good": "bold green", "marginal": "bold yellow", "bad": "bold red", "told": "bold"}
_OUTCOMES = {"met": "green", "missed": "bold red", "open": "bold yellow"}


def show(report: Report, console: Console) -> None:
    """Print a whole report, without markup in texts; warnings among its notes are left to the error stream."""
    # words wrap for a reader; for another program the verdict is one line
    verdict = Text(report.verdict.text, _STYLES[report.verdict.status])
    console.print(verdict, soft_wrap=not console.is_terminal)
    console.print(Group(*_parts(report)))


def text_of(report: Report, width: int = 100) -> str:
    """The same as text without colours."""
    with _console(width) as (console, lines):
        show(report, console)
    return "\n".join(lines)


def tables_text(tables: Sequence[Table], width: int = 100) -> str:
    """Tables as text without colours."""
    with _console(width) as (console, lines):
        console.print(Group(*map(TerminalTable, tables)))
    return "\n".join(lines)


@contextmanager
def _console(width: int) -> Iterator[tuple[Console, list[str]]]:
    """A console without colours, and the lines that were printed to it meanwhile."""
    console = Console(width=width, color_system=None, file=StringIO(), markup=False, emoji=False, highlight=False)
    lines: list[str] = []
    with console.capture() as shown:
        yield console, lines
    lines += [line.rstrip() for line in shown.get().splitlines()]


def _parts(report: Report) -> Iterable["RenderableType"]:
    if about := ": ".join(filter(None, (report.title, report.lead))):
        yield Text(about, "dim")
    if report.changed:
        yield Text(f"set: {report.changed}", "dim")
    if report.verdict.numbers:
        yield Padding(_numbers(report.verdict.numbers), (0, 0, 0, 2), expand=False)
    if report.requirements:
        yield Text("")
        yield requirements_of(report.requirements)
    for section in report.sections:
        if section.detail:
            continue
        for part in section.parts:
            if isinstance(part, Table) and not part.detail and part.rows:
                yield Text("")
                yield TerminalTable(part)
            elif isinstance(part, Note):
                yield Text(part.text)
    for note in report.notes:
        if note.kind == "note":
            yield Text(note.text, "dim")


def _numbers(numbers: Sequence[Number]) -> Rows:
    """A line for each number: words, value, interval, margin to its limit."""
    rows = Rows.grid(padding=(0, 2, 0, 0))
    rows.add_column(overflow="fold")
    rows.add_column(justify="right", no_wrap=True)
    remarks = [Text(each.remark, "dim") for each in numbers]
    if any(remark.plain for remark in remarks):
        # an empty column would take room from the words
        rows.add_column(overflow="fold")
    for each, remark in zip(numbers, remarks, strict=True):
        rows.add_row(Text(each.name), Text(each.text, "bold"), *([remark] if len(rows.columns) > 2 else []))
    return rows


def requirements_of(requirements: Sequence[Requirement]) -> Rows:
    """Each requirement: how it came out, the value found, the margin, and how sure that is."""
    rows = Rows.grid(padding=(0, 2, 0, 0))
    rows.add_column(no_wrap=True)
    rows.add_column(overflow="fold")
    rows.add_column(overflow="fold")
    for each in requirements:
        rows.add_row(Text(OUTCOMES[each.status], _OUTCOMES[each.status]), Text(each.text), Text(each.found))
    return rows


class TerminalTable:
    """A table as wide as the terminal; columns that do not fit continue in a table below.

    A row whose numbers have one unit has it once, beside its name.
    """

    def __init__(self, table: Table) -> None:
        self.table = table

    def __rich_console__(self, _console: Console, options: "ConsoleOptions") -> "RenderResult":
        """The title, the rows that are shown at first, and what is left out."""
        table = self.table
        shown = len(table.rows) if table.first_shown is None else min(table.first_shown, len(table.rows))
        heads = [each.title for each in table.columns]
        texts = [row_texts(table, k) for k in range(shown)]
        columns = [(head, *(row[k].plain for row in texts)) for k, head in enumerate(heads)]
        if table.title:
            yield Text(table.title, "bold")
        for part in stacked_columns(columns, options.max_width):
            rows = Rows()
            for k, width in part:
                cells = [row[k] for row in table.rows]
                is_number = k > 0 and heads[k] != "" and is_at_right(cells, columns[k][1:])
                rows.add_column(Text(heads[k]), justify="right" if is_number else "left", overflow="fold", width=width)
            for number, row in enumerate(texts):
                rows.add_row(*(row[k] for k, _ in part), end_section=number in table.group_ends)
            yield rows
        if shown < len(table.rows):
            yield Text(f"… {len(table.rows) - shown} more on the page", "dim")
        if table.note:
            yield Text(table.note, "dim")


def row_texts(table: Table, index: int) -> list[Text]:
    """The cells of a row; a unit that all its numbers share stands beside its first cell."""
    unit = table.shared_unit(index)
    texts = [Text(each) for each in table.texts(index, units=not unit)]
    return [Text.assemble(texts[0], " ", (unit, "dim")), *texts[1:]] if unit else texts
