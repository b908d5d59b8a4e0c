"""A report in a terminal: the verdict, the numbers that carry it, requirements, then short tables.

Charts, scenes and details are for the page. Without a terminal there are no colours, and the verdict is one line.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from typing import TYPE_CHECKING, Literal

from rich.cells import cell_len
from rich.console import Console, Group
from rich.padding import Padding
from rich.table import Table as Rows
from rich.text import Text

from gough_stewart.harness.report.document import PROSE, Note, Report, Table, is_at_right
from gough_stewart.harness.report.requirements import OUTCOMES

if TYPE_CHECKING:
    from rich.console import ConsoleOptions, RenderResult

_STYLES = {"good": "bold green", "marginal": "bold yellow", "bad": "bold red", "told": "bold"}
_OUTCOMES = {"met": "green", "missed": "bold red", "open": "bold yellow"}
# Least width of long texts, which wrap; a longer word is broken.
_LONGEST_WORD = 26


def show(report: Report, console: Console) -> None:  # noqa: PLR0912 - a section for each part of a report
    """Print a whole report, without markup in texts; warnings among its notes are left to the error stream."""
    # words wrap for a reader; for another program the verdict is one line
    verdict = Text(report.verdict.text, _STYLES[report.verdict.status])
    console.print(verdict, soft_wrap=not console.is_terminal)
    if about := ": ".join(filter(None, (report.title, report.lead))):
        console.print(Text(about, "dim"))
    if report.changed:
        console.print(Text(f"set: {report.changed}", "dim"))
    numbers = report.verdict.numbers
    if numbers:
        # words, value, then interval and margin to the limit; an empty column would take room from the words
        rows, has_remarks = Rows.grid(padding=(0, 2, 0, 0)), any(number.remark for number in numbers)
        rows.add_column(overflow="fold")
        rows.add_column(justify="right", no_wrap=True)
        if has_remarks:
            rows.add_column(overflow="fold")
        for number in numbers:
            remark = [Text(number.remark, "dim")] if has_remarks else []
            rows.add_row(Text(number.name), Text(number.text, "bold"), *remark)
        console.print(Padding(rows, (0, 0, 0, 2), expand=False))
    if report.requirements:
        console.print(Text(""))
        # how each came out, the value found, the margin, and how sure that is
        rows = Rows.grid(padding=(0, 2, 0, 0))
        rows.add_column(no_wrap=True)
        rows.add_column(overflow="fold")
        rows.add_column(overflow="fold")
        for required in report.requirements:
            outcome = Text(OUTCOMES[required.status], _OUTCOMES[required.status])
            rows.add_row(outcome, Text(required.text), Text(required.found))
        console.print(rows)
    for section in report.sections:
        for part in () if section.detail else section.parts:
            if isinstance(part, Table) and not part.detail and part.rows:
                console.print(Text(""))
                console.print(TerminalTable(part))
            elif isinstance(part, Note):
                console.print(Text(part.text))
    for note in report.notes:
        if note.kind == "note":
            console.print(Text(note.text, "dim"))


def text_of(shown: Report | Sequence[Table], width: int = 100) -> str:
    """A report, or tables, as text without colours."""
    console = Console(width=width, color_system=None, file=StringIO(), markup=False, emoji=False, highlight=False)
    with console.capture() as printed:
        if isinstance(shown, Report):
            show(shown, console)
        else:
            console.print(Group(*map(TerminalTable, shown)))
    return "\n".join(line.rstrip() for line in printed.get().splitlines())


@dataclass(frozen=True)
class TerminalTable:
    """A table as wide as the terminal; columns that do not fit continue in tables below, each with the names of rows.

    A row whose numbers have one unit has it once, beside its name. Heads and names wrap first. If the numbers alone are
    too wide, the columns are divided among as few tables as possible: legs 1 to 3, then legs 4 to 6 and all.
    """

    table: Table

    def __rich_console__(self, _console: Console, options: "ConsoleOptions") -> "RenderResult":  # noqa: PLR0912
        """The title, the rows that are shown at first, and what is left out."""
        table = self.table
        shown = len(table.rows) if table.first_shown is None else min(table.first_shown, len(table.rows))
        heads = [column.title for column in table.columns]
        columns = list(zip(heads, *table.shown[:shown], strict=True))

        # the width at which nothing in a column wraps, and its least one
        natural = [max(map(cell_len, column)) for column in columns]
        least = []
        for k, (head, *cells) in enumerate(columns):
            if k == 0 or any(cell_len(cell) > PROSE and " " in cell for cell in cells):
                word = max((cell_len(word) for cell in (head, *cells) for word in cell.split()), default=0)
                least.append(min(natural[k], max(PROSE, min(word, _LONGEST_WORD))))
            else:
                least.append(max(map(cell_len, (*head.split(), *cells)), default=0))

        # the columns of each table; a column has a space on both sides and a line, and the table one line more
        room, others = options.max_width - 1, len(columns) - 1
        for number in range(1, max(others, 1) + 1):
            # the last tables take one more
            share, more = divmod(others, number)
            ends = [share * k + max(0, k - number + more) for k in range(number + 1)]
            parts = [[0, *range(ends[k] + 1, ends[k + 1] + 1)] for k in range(number)]
            if all(sum(least[k] + 3 for k in part) <= room for part in parts):
                break
        else:
            # even one column beside the names is too wide: narrow the names
            least[0] = max(1, min(least[0], room - 6 - max(least[1:], default=0)))

        # their widths: what is left goes to the columns that wrap, first to the one that lacks most
        widths = []
        for part in parts:
            of_part = {k: least[k] for k in part}
            for _ in range(room - sum(of_part.values()) - 3 * len(of_part)):
                k = max(part, key=lambda k: natural[k] - of_part[k])
                if of_part[k] == natural[k]:
                    break
                of_part[k] += 1
            widths.append(of_part)
        names = min(of_part[0] for of_part in widths)  # as wide in all tables

        if table.title:
            yield Text(table.title, "bold")
        for of_part in widths:
            rows = Rows()
            for k, width in of_part.items():
                is_number = k > 0 and heads[k] != "" and is_at_right([row[k] for row in table.rows], columns[k][1:])
                justify: Literal["left", "right"] = "right" if is_number else "left"
                rows.add_column(Text(heads[k]), justify=justify, overflow="fold", width=width if k else names)
            for number in range(shown):
                texts = [Text(columns[k][number + 1]) for k in of_part]
                if unit := table.shared_units[number]:
                    texts[0].stylize("dim", len(texts[0]) - len(unit))
                rows.add_row(*texts, end_section=number in table.group_ends)
            yield rows
        if shown < len(table.rows):
            yield Text(f"… {len(table.rows) - shown} more on the page", "dim")
        if table.note:
            yield Text(table.note, "dim")
