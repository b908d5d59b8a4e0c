"""Tables of a report: cells under columns, and how they are written."""

import math
import re
from collections.abc import Sequence
from functools import cached_property
from typing import Annotated, Any

from pydantic import BeforeValidator
from pydantic.dataclasses import dataclass
from rich.cells import cell_len

from gough_stewart.harness.report.data import CONFIG, Data, Defined
from gough_stewart.harness.report.quantities import NUMBER, Quantity

_NUMBER = re.compile(r"[-+±×<(\s]*\d")
# Longer texts of several words wrap.
PROSE = 18


@dataclass(frozen=True, config=CONFIG)
class Value(Data):
    """A number in a cell of a table whose quantity is not that of its column."""

    value: Defined
    quantity: Quantity


def _cell(value: Any) -> Any:
    if isinstance(value, str) and value in ("Infinity", "-Infinity"):  # as JSON has them
        return float(value)
    return None if isinstance(value, float) and math.isnan(value) else value


Cell = Annotated[str | bool | int | float | Value | None, BeforeValidator(_cell)]


@dataclass(frozen=True, config=CONFIG)
class Column(Data):
    """A column of a table; `quantity` for numbers that are all of one kind."""

    name: str
    quantity: Quantity | None = None
    explanation: str = ""

    @property
    def title(self) -> str:
        """Name, and unit of numbers that are all of one kind."""
        return self.quantity.headed(self.name) if self.quantity else self.name


@dataclass(frozen=True, config=CONFIG)
class Table(Data):
    """Rows of cells under columns; the first cell of a row names it."""

    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    sortable: bool = False
    first_shown: int | None = None  # the rows that are shown at first; None for all
    group_ends: tuple[int, ...] = ()  # rows after which a group ends
    note: str = ""
    detail: bool = False  # on the page only, and not shown at first
    beside: bool = False  # on the page under the verdict, where a chart or surface is the picture
    links: tuple[str, ...] = ()  # a page for each row, relative to the report's; "" for none

    def __post_init__(self) -> None:
        links, rows = len(self.links), len(self.rows)
        if links not in (0, rows):
            raise ValueError(f"{links} links of '{self.title}'; expected one for each of {rows} rows")
        for k, row in enumerate(self.rows):
            if len(row) != len(self.columns):
                raise ValueError(f"row {k + 1} of '{self.title}' has {len(row)} cells; expected {len(self.columns)}")

    @property
    def shown(self) -> list[tuple[str, ...]]:
        """The cells of all rows as a terminal shows them; a unit that a row shares is beside its first cell."""
        rows = []
        for k, unit in enumerate(self.shared_units):
            name, *others = self.texts(k, units=not unit)
            rows.append((f"{name} {unit}" if unit else name, *others))
        return rows

    @cached_property
    def shared_units(self) -> tuple[str, ...]:
        """By row, the unit of one whose values have the same one, which is then said once; "" for another row.

        Where columns state units too, this holds for all rows or none, so that they look alike.
        """
        units = [{cell.quantity.unit_text for cell in cells[1:] if isinstance(cell, Value)} for cells in self.rows]
        is_mixed = any(column.quantity for column in self.columns[1:]) and any(len(kinds) > 1 for kinds in units)
        return tuple("" if is_mixed or len(kinds) != 1 else kinds.pop() for kinds in units)

    def texts(self, row: int, *, units: bool = True) -> tuple[str, ...]:
        """The cells of a row as shown; units only where the column does not state it, or never."""
        shown = list[str]()
        for cell, column in zip(self.rows[row], self.columns, strict=True):
            if isinstance(cell, Value):
                shown.append(cell.quantity.text(cell.value, unit=units))
            elif isinstance(cell, bool):
                shown.append("yes" if cell else "no")
            elif isinstance(cell, str) or (isinstance(cell, int) and column.quantity is None):
                shown.append(str(cell))
            else:
                shown.append((column.quantity or NUMBER).text(cell, unit=False))
        return tuple(shown)


def is_prose(cells: Sequence[str]) -> bool:
    """Whether a column has texts that may wrap: several words, longer than any number."""
    return any(cell_len(cell) > PROSE and " " in cell for cell in cells)


def is_at_right(cells: Sequence[Cell], texts: Sequence[str]) -> bool:
    """Whether a column is right-aligned: its cells are numbers or blank, or its texts numbers and no sentences."""
    filled = [cell for cell in cells if cell not in (None, "")]
    if filled and all(isinstance(cell, int | float | Value) and not isinstance(cell, bool) for cell in filled):
        return True
    numbers = [_NUMBER.match(text) is not None for text in texts]
    return any(numbers) and (all(numbers) or not is_prose(texts))
