"""Tables of a workspace: its limits, its results, and every pose as CSV."""

import numpy as np
import polars as pl
from numpy.typing import NDArray

from gough_stewart.harness.output.tables import Named, Sheet, number_text
from gough_stewart.harness.workspace.display import (
    Result,
    Shown,
    limit_title,
    limit_values,
    limits_met,
    results_of,
    shown_coordinate,
)
from gough_stewart.model.vectors import FloatArray
from gough_stewart.model.workspace import Limit
from gough_stewart.model.workspace_grid import COORDINATES, Workspace


def sheets_of(workspace: Workspace) -> list[Sheet]:
    """Tables of swept coordinates, limits of the platform, limits exceeded, and least and largest results."""
    return [_swept(workspace), _limits(workspace), _extremes(workspace)]


def workspace_csv(workspace: Workspace) -> bytes:
    """One row per pose: coordinates, whether it can be reached, which limit is passed, and all results.

    SI units. Columns of results are empty if the platform does not state the limit they need; `limit` is in words.
    """
    q = workspace.qualities
    poses = workspace.coordinates().reshape(-1, 6)
    columns: dict[str, pl.Series] = {name: pl.Series(poses[:, k]) for k, name in enumerate(COORDINATES)}
    columns["reachable"] = pl.Series(q.reachable.ravel())
    names = np.array([limit.name.lower() for limit in Limit])
    columns["limit"] = pl.Series(names[q.limit.ravel()])
    for name in q._fields[1:]:
        values: FloatArray | None = getattr(q, name)
        empty = pl.Series([None] * len(poses), dtype=pl.Float64)
        columns[name] = empty if values is None else pl.Series(values.ravel())
    return pl.DataFrame(columns).write_csv().encode()


def _swept(workspace: Workspace) -> Sheet:
    sheet = Sheet("Swept", ("", "from", "to", "points", "reached from", "to", "range"))
    reached = workspace.qualities.reachable
    for axis, (name, values) in enumerate(workspace.swept.items()):
        shown = shown_coordinate(workspace, name)
        others = tuple(k for k in range(reached.ndim) if k != axis)
        rows = np.flatnonzero(reached.any(axis=others))
        ends = [shown.text(values[k]) for k in (rows[0], rows[-1])] if rows.size else ["–", "–"]
        origin = "computed" if name in workspace.found else "assumed" if name in workspace.assumed else "given"
        sheet.add(name, shown.text(values[0]), shown.text(values[-1]), str(len(values)), *ends, origin)
    return sheet


def _limits(workspace: Workspace) -> Sheet:
    sheet = Sheet("Limits of the platform", ("", "value", "keeps from"))
    code = workspace.qualities.limit
    kept = {
        "leg_length_min": (Limit.LEG_TOO_SHORT,),
        "leg_length_max": (Limit.LEG_TOO_LONG,),
        "joint_angle_max": (Limit.BASE_JOINT, Limit.PLATFORM_JOINT),
    }
    for name, value in limit_values(workspace).items():
        if name in kept and value != "not stated":
            sheet.add(limit_title(name), value, _percent(np.isin(code, kept[name])))
        else:
            sheet.add(limit_title(name), value, "" if name not in kept else "nothing")
    for limit in (Limit.SINGULAR, Limit.PITCH):
        if limit in limits_met(workspace):
            sheet.add(limit.text, "", _percent(code == limit))
    return sheet


def _percent(there: NDArray[np.bool_]) -> str:
    return f"{100 * there.mean():.3g} % of the grid"


def size_text(workspace: Workspace) -> str:
    """The reachable share of the grid, in words; also as area or volume if the coordinates are lengths."""
    reached, total = int(workspace.qualities.reachable.sum()), workspace.qualities.reachable.size
    text = f"{reached} of {total} poses can be reached ({100 * reached / total:.3g} %)"
    if any(COORDINATES[name] != "m" for name in workspace.swept):
        return text
    # each pose represents a cell; those at the ends of the grid, a part of one
    cell, weights = 1.0, workspace.qualities.reachable.astype(float)
    for axis, values in enumerate(workspace.swept.values()):
        cell *= float(values[1] - values[0])
        ends = np.ones(len(values))
        ends[[0, -1]] = 0.5
        weights = weights * ends.reshape([-1 if k == axis else 1 for k in range(weights.ndim)])
    kind = "an area" if len(workspace.swept) == 2 else "a volume"
    return f"{text}, {kind} of {extent_text(cell * weights.sum(), len(workspace.swept))}"


def extent_text(size: float, dimensions: int) -> str:
    """An area [m²] or a volume [m³] in a readable unit: m, cm or mm, squared or cubed.

    It is the largest unit in which an area is at least 0.1, or a volume at least 0.01.
    """
    power, least = {2: "²", 3: "³"}[dimensions], 10.0 ** (1 - dimensions)
    for unit, factor in (("m", 1.0), ("cm", 1e2)):
        value = size * factor**dimensions
        if value >= least or size == 0:
            return f"{number_text(value)} {unit}{power}"
    return f"{number_text(size * 1e3**dimensions)} mm{power}"


def _extremes(workspace: Workspace) -> Sheet:
    shown = {name: shown_coordinate(workspace, name) for name in workspace.swept}
    heads = [f"{name} / {each.unit}" for name, each in shown.items()]
    sheet = Sheet("Where it can be reached", ("", "", "value", *heads))
    reached = workspace.qualities.reachable
    if not reached.any():
        return sheet
    for result in results_of(workspace):
        values = np.where(reached, result.values, np.nan)
        lowest, highest = int(np.nanargmin(values)), int(np.nanargmax(values))
        best, worst = (lowest, highest) if result.is_best_low else (highest, lowest)
        named = Named(result.title, result.shown.unit)
        sheet.add(named, "best", *_value_and_place(workspace, result, best), ends_group=result.ends_at_border)
        # margins are 0 at the border
        if not result.ends_at_border:
            sheet.add("", "worst", *_value_and_place(workspace, result, worst), ends_group=True)
    return sheet


def _value_and_place(workspace: Workspace, result: Result, k: int) -> tuple[str, ...]:
    """A value and its swept coordinates, all in display units, without the units."""
    at = np.unravel_index(k, workspace.shape)
    places = []
    for i, (name, values) in zip(at, workspace.swept.items(), strict=True):
        places.append(Shown("", shown_coordinate(workspace, name).factor).text(values[i], 3))
    return (Shown("", result.shown.factor).text(float(result.values.flat[k])), *places)
