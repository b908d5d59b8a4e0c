"""Columns of a table: which are right-aligned; in the terminal their widths, and tables one above the other."""

import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from rich.cells import cell_len

from gough_stewart.harness.report.table import Cell, Value

_NUMBER = re.compile(r"[-+±×<(\s]*\d")
# Least widths of names and of long texts, which wrap; a word longer than the second is broken.
_NAME, _LONGEST_WORD = 18, 26


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


def is_at_right(cells: Sequence[Cell], texts: Sequence[str]) -> bool:
    """Whether a column is right-aligned: its cells are numbers or blank, or its texts numbers and no sentences."""
    numbers = [isinstance(cell, int | float | Value) and not isinstance(cell, bool) for cell in cells]
    if any(numbers) and all(is_one or cell in (None, "") for is_one, cell in zip(numbers, cells, strict=True)):
        return True
    numbers = [_NUMBER.match(text) is not None for text in texts]
    return any(numbers) and (all(numbers) or not is_prose(texts))


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
