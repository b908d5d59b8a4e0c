"""Tables of a workspace: its limits, its results, and every pose as CSV."""

from dataclasses import replace

import numpy as np
import polars as pl

from gough_stewart.harness.report.quantities import SHARE, Quantity, of_unit
from gough_stewart.harness.report.table import Cell, Column, Table, Value
from gough_stewart.harness.report.words import number_text
from gough_stewart.harness.workspace.display import (
    Result,
    Shown,
    limit_title,
    limit_values,
    limits_met,
    results_of,
    shown_coordinate,
)
from gough_stewart.model.vectors import FloatArray, first_of_largest
from gough_stewart.model.workspace import COORDINATES, Limit, PoseStiffness, Workspace


def workspace_tables(workspace: Workspace) -> list[Table]:
    """Swept coordinates, limits of the platform and what they keep it from, and where results are best and worst."""
    tables = [_swept(workspace), _limits(workspace), _extremes(workspace)]
    return [table for table in tables if table.rows]


def quantity_of(shown: Shown, digits: int = 4) -> Quantity:
    """How a coordinate or a result is written."""
    unit = "deg" if shown.unit == "°" else shown.unit
    return Quantity(of_unit(unit).si, unit, shown.factor, digits=digits)


def workspace_csv(workspace: Workspace) -> bytes:
    """One row per pose: coordinates, whether it can be reached, which limit is passed, and all results.

    SI units. Columns of results are empty if the platform does not state the limit they need; those of stiffness are
    there if its legs give. `limit` is in words.
    """
    q = workspace.qualities
    poses = workspace.coordinates().reshape(-1, 6)
    columns: dict[str, pl.Series] = {name: pl.Series(poses[:, k]) for k, name in enumerate(COORDINATES)}
    columns["reachable"] = pl.Series(q.reachable.ravel())
    names = np.array([limit.name.lower() for limit in Limit])
    columns["limit"] = pl.Series(names[q.limit.ravel()])
    for name in q._fields[1:]:
        values: FloatArray | None = getattr(q, name)
        # of rigid legs there are no such columns
        if values is None and name in PoseStiffness._fields:
            continue
        empty = pl.Series([None] * len(poses), dtype=pl.Float64)
        columns[name] = empty if values is None else pl.Series(values.ravel())
    return pl.DataFrame(columns).write_csv().encode()


def _swept(workspace: Workspace) -> Table:
    rows: list[tuple[Cell, ...]] = []
    reached = workspace.qualities.reachable
    for axis, (name, values) in enumerate(workspace.swept.items()):
        quantity = quantity_of(shown_coordinate(workspace, name))
        others = tuple(k for k in range(reached.ndim) if k != axis)
        there = np.flatnonzero(reached.any(axis=others))
        ends = [_without_rounding(values[k]) for k in (there[0], there[-1])] if there.size else [None, None]
        origin = "computed" if name in workspace.found else "assumed" if name in workspace.assumed else "given"
        low, high, *reaches = (Value(each, quantity) for each in (*map(_without_rounding, values[[0, -1]]), *ends))
        rows.append((name, low, high, len(values), *reaches, origin))
    heads = ("", "from", "to", "points", "reached from", "reached to", "range")
    return Table("Swept", tuple(map(Column, heads)), tuple(rows))


def _without_rounding(value: float) -> float:
    """A coordinate of the grid, whose middle is 0 up to rounding."""
    return round(float(value), 12) + 0.0


def _limits(workspace: Workspace) -> Table:
    code = workspace.qualities.limit
    kept = {
        "leg_length_min": (Limit.LEG_TOO_SHORT,),
        "leg_length_max": (Limit.LEG_TOO_LONG,),
        "joint_angle_max": (Limit.BASE_JOINT, Limit.PLATFORM_JOINT),
    }
    rows: list[tuple[Cell, ...]] = []
    for name, value in limit_values(workspace).items():
        if name in kept and value != "not stated":
            rows.append((limit_title(name), value, float(np.isin(code, kept[name]).mean())))
        else:
            rows.append((limit_title(name), value, "" if name not in kept else "nothing"))
    rows += [
        (limit.text, "", float((code == limit).mean()))
        for limit in (Limit.SINGULAR, Limit.PITCH)
        if limit in limits_met(workspace)
    ]
    keeps = Column("keeps from", replace(SHARE, digits=3), "share of the poses of the grid")
    return Table("Limits of the platform", (Column(""), Column("value"), keeps), tuple(rows))


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


def _extremes(workspace: Workspace) -> Table:
    places = [Column(name, quantity_of(shown_coordinate(workspace, name), 3)) for name in workspace.swept]
    rows: list[tuple[Cell, ...]] = []
    ends = []
    reached = workspace.qualities.reachable
    for result in results_of(workspace) if reached.any() else ():
        known = reached & ~np.isnan(result.values)
        lowest, highest = (
            int(first_of_largest(np.where(known, sign * result.values, -np.inf).ravel())) for sign in (-1, 1)
        )
        best, worst = (lowest, highest) if result.is_best_low else (highest, lowest)
        rows.append((result.title, "best", *_value_and_place(workspace, result, best)))
        # margins are 0 at the border
        if not result.ends_at_border:
            rows.append((result.title, "worst", *_value_and_place(workspace, result, worst)))
        ends.append(len(rows) - 1)
    columns = (Column(""), Column(""), Column("value"), *places)
    return Table("Where it can be reached", columns, tuple(rows), group_ends=tuple(ends))


def _value_and_place(workspace: Workspace, result: Result, k: int) -> tuple[Cell, ...]:
    """A value and its swept coordinates."""
    at = np.unravel_index(k, workspace.shape)
    places = [_without_rounding(values[i]) for i, values in zip(at, workspace.swept.values(), strict=True)]
    return (Value(float(result.values.flat[k]), quantity_of(result.shown)), *places)
