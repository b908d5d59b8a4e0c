"""Data of a page's charts: lines of all signals of its records, and of differences between records."""

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np

from gough_stewart.harness.output.display_resolution import decimated, least_span
from gough_stewart.harness.output.pages import packed
from gough_stewart.harness.results.record import Record
from gough_stewart.harness.results.signals import SHOWN, Signal, signals_of
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# Points of a line for one record; several records share them.
POINTS = 800
_FEWEST_POINTS = 100
# Half the difference between the values of a flag.
_FLAG = 0.5
# Rows to compare first; most components that differ do so here.
_GLANCE = 16
# Times of two clocks closer than this are the same, computed differently [s].
_SAME_TIME = 1e-9

_Columns = Sequence[FloatArray | None]


def chart_of(records: Sequence[Record], platforms: Sequence[Platform]) -> dict[str, Any]:
    """Data for `charts.js`: `signals` by name, the names `shown` at first, and the `range` of time.

    A signal has a title, a unit, names of components, and lines by record. Components that stay within `least_span` of
    each other in all records share a line: `groups` has their indices. Lines are `decimated`, so no peak is lost. A
    line equal to that of an earlier record is stored as that record's index. `differences` between records j < k, by
    "j,k", are k minus j, see `difference`.
    """
    times = [record["time"] for record in records]
    signals = signals_of(records, platforms)
    ends = [float(time[k]) for time in times for k in (0, -1)]
    return {
        "signals": {signal.name: _packed_signal(signal, times) for signal in signals},
        "shown": [signal.name for signal in signals if signal.name in SHOWN],
        "range": [min(ends), max(ends)],
    }


def points_of(lines: int) -> int:
    """Points per line, if this number of records share them."""
    return max(POINTS // lines, _FEWEST_POINTS)


def coinciding(values: _Columns, least: float) -> list[list[int]]:
    """Groups of indices of columns (n, size) that stay within `least` of the first of their group in all arrays.

    NaN equals NaN here.
    """
    arrays = [array for array in values if array is not None]
    groups: list[list[int]] = []
    for column in range(arrays[0].shape[1] if arrays else 0):
        for group in groups:
            if all(_close(array[:, group[0]], array[:, column], least) for array in arrays):
                group.append(column)
                break
        else:
            groups.append([column])
    return groups


def difference(
    time: tuple[FloatArray, FloatArray], values: tuple[FloatArray, FloatArray], holds: bool = False
) -> tuple[FloatArray, FloatArray]:
    """The second of two arrays (n, size) and (m, size) minus the first, at the times of both in their common span.

    Between rows, values are interpolated linearly, or held if `holds`. Without a common span there are no times.
    """
    if np.array_equal(*time):
        return time[0], values[1] - values[0]
    common = np.union1d(*time)
    # the last of those that are the same, at which both records have that row
    common = common[np.append(np.diff(common) > _SAME_TIME, True)]
    start, end = (pick(float(each[at]) for each in time) for pick, at in ((max, 0), (min, -1)))
    common = common[(common >= start) & (common <= end + _SAME_TIME)]
    first, second = (_at(common, each, held, holds) for each, held in zip(time, values, strict=True))
    return common, second - first


def _at(common: FloatArray, time: FloatArray, values: FloatArray, holds: bool) -> FloatArray:
    if holds:
        held: FloatArray = values[np.searchsorted(time, common, side="right") - 1]
        return held
    return np.stack([np.interp(common, time, column) for column in values.T], axis=1)


def _close(one: FloatArray, other: FloatArray, least: float) -> bool:
    stride = max(1, len(one) // _GLANCE)
    for a, b in ((one[::stride], other[::stride]), (one, other)):
        gap = np.abs(a - b)
        if not np.all((gap < least) | (np.isnan(a) & np.isnan(b))):
            return False
    return True


def _packed_signal(signal: Signal, times: Sequence[FloatArray]) -> dict[str, Any]:
    values = [None if each is None else np.where(np.isfinite(each), each, np.nan) for each in signal.values]
    pairs = {
        f"{j},{k}": difference((times[j], times[k]), (one, other), signal.is_flag)
        for (j, one), (k, other) in combinations(enumerate(values), 2)
        if one is not None and other is not None
    }
    changes = [difference for _, difference in pairs.values()]
    least, least_change = _least(signal, values), _least(signal, changes)
    groups, groups_of_changes = coinciding(values, least), coinciding(changes, least_change)
    points = points_of(len(times))
    return {
        "title": signal.title,
        "unit": signal.unit,
        "group": signal.group,
        "kind": signal.kind,
        "components": signal.components,
        "reference": signal.reference,
        "limits": signal.limits,
        "holds": signal.is_flag,
        "curves": {"groups": groups, "least": least, "lines": _lines_by_record(values, times, groups, points)},
        "differences": {
            "groups": groups_of_changes,
            "least": least_change,
            "lines": {
                pair: _lines(time, each, groups_of_changes, points_of(len(pairs)))
                for pair, (time, each) in pairs.items()
            },
        },
    }


def _least(signal: Signal, values: _Columns) -> float:
    """The display resolution of these values, or of differences between such values."""
    if signal.is_flag:
        return _FLAG
    sizes = [np.nanmax(np.abs(each)) for each in (*values, *signal.values) if each is not None and each.size]
    return least_span(signal.unit, max(filter(np.isfinite, sizes), default=0.0))


def _lines_by_record(
    values: _Columns, times: Sequence[FloatArray], groups: Sequence[Sequence[int]], points: int
) -> list[Any]:
    found: list[Any] = []
    for k, (time, each) in enumerate(zip(times, values, strict=True)):
        if each is None:
            found.append(None)
            continue
        same = (
            j
            for j, other in enumerate(values[:k])
            if other is not None and np.array_equal(times[j], time) and np.array_equal(other, each, equal_nan=True)
        )
        earlier = next(same, None)
        found.append(_lines(time, each, groups, points) if earlier is None else earlier)
    return found


def _lines(time: FloatArray, values: FloatArray, groups: Sequence[Sequence[int]], points: int) -> list[dict[str, Any]]:
    """One line per group, that of its first component."""
    return [_line(time, values[:, group[0]], points) for group in groups]


def _line(time: FloatArray, values: FloatArray, points: int) -> dict[str, Any]:
    if len(values) > 2 and np.all(values == values[0]):
        time, values = time[[0, -1]], values[[0, -1]]
    kept, shown = decimated(time, values, points)
    return {"x": packed(kept, "f4"), "y": packed(shown, "f4")}
