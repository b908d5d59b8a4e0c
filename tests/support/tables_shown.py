"""Tables of a report as a terminal shows their cells."""

from gough_stewart.harness.report.table import Table
from gough_stewart.harness.report.terminal import row_texts


def heads_of(table: Table) -> tuple[str, ...]:
    """The heads of the columns, with their units."""
    return tuple(each.quantity.headed(each.name) if each.quantity else each.name for each in table.columns)


def rows_of(table: Table) -> list[tuple[str, ...]]:
    """The cells of all rows; a unit that all numbers of a row share is beside its first cell."""
    return [tuple(text.plain for text in row_texts(table, k)) for k in range(len(table.rows))]
