"""Whether a terminal shows every text of a table, read back from the characters between its lines."""

from rich.console import Console
from rich.text import Text

from gough_stewart.harness.report.table import Table
from gough_stewart.harness.report.terminal import TerminalTable
from tests.support.tables_shown import heads_of, rows_of


def printed(table: Table, width: int) -> str:
    """As a terminal of this width shows it."""
    console = Console(width=width, color_system=None, legacy_windows=False)
    with console.capture() as capture:
        console.print(TerminalTable(table))
    return capture.get()


def check_is_whole(table: Table, width: int) -> None:
    """No line is too wide; numbers stand in one piece and in order; names and sentences are there, perhaps folded.

    Expected: the cells of the table. Every table that is printed begins with the names.
    """
    text = printed(table, width)
    assert max((Text(line).cell_len for line in text.splitlines()), default=0) <= width, text
    expected = [
        [head, *(row[k] for row in rows_of(table)[: table.first_shown])] for k, head in enumerate(heads_of(table))
    ]
    names, *others = expected
    found: list[list[str]] = []
    for part in _tables(text):
        assert _joined(part[0]) == _joined(names), text
        found += part[1:]
    assert len(found) == len(others), text
    for pieces, cells in zip(found, others, strict=True):
        assert _joined(pieces) == _joined(cells), text
        if all(len(cell) <= 16 for cell in cells[1:]):
            numbers = [cell for cell in cells[1:] if cell]
            assert numbers == pieces[len(pieces) - len(numbers) :], text


def _tables(text: str) -> list[list[list[str]]]:
    """Of each table, by column, what stands in its lines, without what is empty."""
    tables: list[list[list[str]]] = []
    for line in text.splitlines():
        if line.startswith("┏"):
            tables.append([[] for _ in line.split("┳")])
        elif line[:1] in ("┃", "│"):
            pieces = line[1:-1].split(line[0])
            assert len(pieces) == len(tables[-1]), line
            for k, piece in enumerate(pieces):
                tables[-1][k] += [piece.strip()] if piece.strip() else []
    return tables


def _joined(pieces: list[str]) -> str:
    return "".join("".join(pieces).split())
