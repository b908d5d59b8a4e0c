"""Tables of a report: cells under columns, and how they are written."""

import math
from dataclasses import dataclass

from gough_stewart.harness.report.fields import defined
from gough_stewart.harness.report.quantities import NUMBER, Quantity


@dataclass(frozen=True)
class Value:
    """A number in a cell of a table whose quantity is not that of its column."""

    value: float | None
    quantity: Quantity

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", defined(self.value))

    @property
    def text(self) -> str:
        """As shown, with its unit."""
        return self.quantity.text(self.value)


Cell = str | bool | int | float | Value | None


@dataclass(frozen=True)
class Column:
    """A column of a table; `quantity` for numbers that are all of one kind."""

    name: str
    quantity: Quantity | None = None
    explanation: str = ""

    @property
    def title(self) -> str:
        """Name, and unit of numbers that are all of one kind."""
        return self.quantity.headed(self.name) if self.quantity else self.name


@dataclass(frozen=True)
class Table:
    """Rows of cells under columns; the first cell of a row names it."""

    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    sortable: bool = False
    first_shown: int | None = None  # the rows that are shown at first; None for all
    group_ends: tuple[int, ...] = ()  # rows after which a group ends
    note: str = ""
    detail: bool = False  # on the page only, and not shown at first
    links: tuple[str, ...] = ()  # a page for each row, relative to the report's; "" for none

    def __post_init__(self) -> None:
        if self.links and len(self.links) != len(self.rows):
            raise ValueError(
                f"{len(self.links)} links of '{self.title}'; expected one for each of {len(self.rows)} rows"
            )
        rows = tuple(tuple(None if isinstance(c, float) and math.isnan(c) else c for c in row) for row in self.rows)
        object.__setattr__(self, "columns", tuple(self.columns))
        object.__setattr__(self, "rows", rows)
        for k, row in enumerate(rows):
            if len(row) != len(self.columns):
                raise ValueError(f"row {k + 1} of '{self.title}' has {len(row)} cells; expected {len(self.columns)}")

    def shared_unit(self, row: int) -> str:
        """The unit of a row whose values have the same one, which is then said once; "" for another row.

        Where columns state units too, this holds for all rows or none, so that they look alike.
        """
        units = [{cell.quantity.unit_text for cell in each[1:] if isinstance(cell, Value)} for each in self.rows]
        is_mixed = any(column.quantity for column in self.columns[1:]) and any(len(each) > 1 for each in units)
        return next(iter(units[row])) if len(units[row]) == 1 and not is_mixed else ""

    def texts(self, row: int, *, units: bool = True) -> tuple[str, ...]:
        """The cells of a row as shown; units only where the column does not state it, or never."""
        cells = zip(self.rows[row], self.columns, strict=True)
        return tuple(_cell_text(cell, column.quantity, units=units) for cell, column in cells)


def _cell_text(cell: Cell, quantity: Quantity | None, *, units: bool) -> str:
    if isinstance(cell, Value):
        return cell.quantity.text(cell.value, unit=units)
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    if isinstance(cell, str):
        return cell
    return (quantity or NUMBER).number(cell) if quantity or not isinstance(cell, int) else str(cell)
