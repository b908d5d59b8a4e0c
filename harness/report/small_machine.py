"""Reports of small machines: how finely they tell numbers follows the stroke, their units the numbers' own size."""

from dataclasses import replace

import numpy as np

from gough_stewart.harness.report.chart import Chart
from gough_stewart.harness.report.document import Number, Part, Report
from gough_stewart.harness.report.quantities import Quantity
from gough_stewart.harness.report.table import Cell, Table, Value
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.parameters import PlatformFields

# A machine with at least this stroke is shown to micrometres [m]; a smaller one to a millionth of its stroke.
_SMALL = 0.01
# The stroke of a machine that does not state one, as a share of its legs.
_SHARE_OF_LEGS = 0.01


def fineness_of(platform: PlatformFields) -> float:
    """The smallest numbers that are told of a machine, as a share of those of a machine with a stroke of 1 m."""
    low, high = platform.leg_length_min, platform.leg_length_max
    legs = leg_geometry(platform, platform.home_position, platform.home_orientation).length
    stroke = _SHARE_OF_LEGS * float(legs.mean()) if low is None or high is None else high - low
    return stroke if stroke < _SMALL else 1.0


def in_own_size(report: Report, fineness: float) -> Report:
    """The report with the quantities of its numbers, tables and charts as `Quantity.sized`; 1 changes nothing."""
    if fineness >= 1:
        return report
    parts_of = [tuple(_part(part, fineness) for part in section.parts) for section in report.sections]
    sections = tuple(replace(one, parts=parts) for one, parts in zip(report.sections, parts_of, strict=True))
    numbers = tuple(_number(each, fineness) for each in report.numbers)
    verdict = replace(report.verdict, numbers=tuple(_number(each, fineness) for each in report.verdict.numbers))
    return replace(report, sections=sections, numbers=numbers, verdict=verdict)


def _sized(quantity: Quantity, fineness: float, *values: object) -> Quantity:
    """The quantity for the largest of these numbers; anything else among them does not count."""
    arrays = [np.abs(np.asarray(value, dtype=float)) for value in values if isinstance(value, float | np.ndarray)]
    finite = [array[np.isfinite(array)].max(initial=0.0) for array in arrays]
    return quantity.sized(fineness, float(max(finite, default=0.0)))


def _number(number: Number, fineness: float) -> Number:
    return replace(number, quantity=_sized(number.quantity, fineness, number.value, number.low, number.high))


def _part(part: Part, fineness: float) -> Part:
    if isinstance(part, Chart):
        # all series share the vertical axis
        values = [each.values for each in part.series]
        series = tuple(replace(each, quantity=_sized(each.quantity, fineness, *values)) for each in part.series)
        x = replace(part.x, quantity=_sized(part.x.quantity, fineness, part.x.values))
        return replace(part, x=x, series=series)
    return table_in_own_size(part, fineness) if isinstance(part, Table) else part


def table_in_own_size(table: Table, fineness: float) -> Table:
    """A table in which values of a row that have one quantity, and the numbers of a column, share a unit."""
    columns = [
        each.quantity and _sized(each.quantity, fineness, *(row[k] for row in table.rows))
        for k, each in enumerate(table.columns)
    ]
    named = tuple(replace(each, quantity=own) for each, own in zip(table.columns, columns, strict=True))
    return replace(table, columns=named, rows=tuple(_row(row, fineness) for row in table.rows))


def _row(row: tuple[Cell, ...], fineness: float) -> tuple[Cell, ...]:
    values = [cell for cell in row if isinstance(cell, Value)]
    shown = {
        each.quantity: _sized(each.quantity, fineness, *(v.value for v in values if v.quantity == each.quantity))
        for each in values
    }
    return tuple(replace(cell, quantity=shown[cell.quantity]) if isinstance(cell, Value) else cell for cell in row)
