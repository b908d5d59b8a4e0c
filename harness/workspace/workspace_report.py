"""What a sweep of the workspace found: how far the platform reaches, what keeps it from more, and every pose as CSV."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import polars as pl

from gough_stewart.harness.report.chart import Axis, Chart, Map, Series, Surface
from gough_stewart.harness.report.document import (
    Cell,
    Column,
    Note,
    Number,
    Part,
    Report,
    Section,
    Table,
    Value,
    Verdict,
)
from gough_stewart.harness.report.quantities import (
    NUMBER,
    SHARE,
    Quantity,
    counted,
    listed,
    number_text,
    of_unit,
    percent,
    sentence,
)
from gough_stewart.harness.workspace.isosurface import clearance, surface_of
from gough_stewart.model.interface import unit_text
from gough_stewart.model.kinematics import joint_angles, leg_geometry
from gough_stewart.model.parameters import LIMITS, of_legs
from gough_stewart.model.vectors import FloatArray, first_of_largest
from gough_stewart.model.workspace import COORDINATES, STIFFNESS, Limit, Workspace, limits_at, rows_reached

# The group of the maps, and the name of their figure.
FIGURES = ("maps",)
# Smaller platforms are shown in mm [m]; forces of at least this in kN [N].
_SMALL, _STRONG = 0.5, 1e4
# Coordinates closer than this count as equal [m, rad].
_SAME = 1e-9
# Results by their names in `PoseQualities`: title, SI unit, and a note.
_RESULTS: Mapping[str, tuple[str, str, str]] = {
    "condition_number": (
        "condition number",
        "",
        "Of the leg Jacobian, with angles as displacements of the joints. 1 is best; it is infinite at a singular "
        "pose.",
    ),
    "payload": (
        "largest payload",
        "kg",
        "The largest point mass at the platform frame's origin that the actuators hold at rest.",
    ),
    "force_margin": (
        "force margin",
        "N",
        "The largest force at the platform frame's origin, in any direction, that the actuators hold at rest.",
    ),
    "largest_speed": (
        "largest speed",
        "m/s",
        "The largest speed in any direction, turning included, at which no leg is faster than its limit.",
    ),
    "translational_stiffness": (
        "stiffness, softest direction",
        "N/m",
        "Force at the platform frame's origin over the displacement along it, in the softest direction, with motors "
        "that hold.",
    ),
    "translational_stiffness_max": ("stiffness, stiffest direction", "N/m", "The same in the stiffest direction."),
    "rotational_stiffness": (
        "stiffness, softest axis",
        "N.m/rad",
        "Torque over the rotation about it, about the softest axis, with motors that hold.",
    ),
    "rotational_stiffness_max": ("stiffness, stiffest axis", "N.m/rad", "The same about the stiffest axis."),
    "first_mode": (
        "first mode",
        "Hz",
        "The lowest natural frequency of the platform on its legs, with motors that hold.",
    ),
    "leg_length_margin": ("stroke left", "m", "Of the leg that is nearest to an end of its stroke; negative beyond."),
    "joint_angle_margin": (
        "joint angle left",
        "rad",
        "Of the joint that is nearest to its largest angle; negative beyond.",
    ),
}
# Why poses are out of reach, where the limit's own words do not follow "because of".
_WHY = {
    Limit.SINGULAR: Limit.SINGULAR.text,
    Limit.BASE_JOINT: "because of the angle of a base joint",
    Limit.PLATFORM_JOINT: "because of the angle of a platform joint",
}
# What the limits of a platform keep it from.
_KEPT: Mapping[str, tuple[Limit, ...]] = {
    "leg_length_min": (Limit.LEG_TOO_SHORT,),
    "leg_length_max": (Limit.LEG_TOO_LONG,),
    "joint_angle_max": (Limit.BASE_JOINT, Limit.PLATFORM_JOINT),
}


# --- units and results ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Shown:
    """A unit for display, and the factor from SI units to it."""

    unit: str
    factor: float = 1.0
    more_digits: int = 0  # than a large machine needs

    def text(self, value: float, digits: int = 4) -> str:
        """A value in SI units, as text with the unit."""
        space = "" if self.unit in ("", "°") else " "
        # avoids −0 and rounding errors of degrees
        size = round(value * self.factor, 9) + 0.0 if np.isfinite(value) else value
        return f"{number_text(size, digits + self.more_digits)}{space}{unit_text(self.unit)}"

    def quantity(self, digits: int = 4) -> Quantity:
        """The same for tables and charts."""
        unit = "deg" if self.unit == "°" else self.unit
        return Quantity(of_unit(unit).si, unit, self.factor, digits=digits)


def _shown(workspace: Workspace, unit: str) -> _Shown:
    """How a unit is shown: angles in degrees; lengths in m, or in mm for a small platform, to a thousandth of a stroke.

    Its speeds are shown likewise.
    """
    platform, more = workspace.platform, 0
    if unit in ("m", "m/s"):
        factor, prefix = (1e3, "m") if platform.characteristic_length < _SMALL else (1.0, "")
        if unit == "m" and (stroke := platform.stroke) is not None:
            more = max(0, math.ceil(math.log10(1e3 * platform.characteristic_length / stroke)) - 4)
        return _Shown(f"{prefix}{unit}", factor, more)
    units = {"rad": ("°", 180 / np.pi), "N/m": ("N/µm", 1e-6), "N.m/rad": ("kN.m/rad", 1e-3)}
    return _Shown(*units.get(unit, (unit, 1.0)))


def _coordinate(workspace: Workspace, name: str) -> _Shown:
    return _shown(workspace, COORDINATES[name])


@dataclass(frozen=True, eq=False)
class _Result:
    """A quantity at every pose, and how to display it."""

    name: str  # column of the CSV file
    title: str
    note: str
    shown: _Shown
    values: FloatArray  # in the shape of the grid, SI units
    is_best_low: bool


def _results(workspace: Workspace) -> Iterator[_Result]:
    """The results at the poses; those that need a limit which the platform does not state are left out."""
    q = workspace.qualities
    for name, (title, unit, note) in _RESULTS.items():
        values: FloatArray | None = getattr(q, name)
        if values is not None:
            shown = _shown(workspace, unit)
            if unit == "N" and values[q.reachable & np.isfinite(values)].max(initial=0.0) >= _STRONG:
                shown = _Shown("kN", 1e-3)
            yield _Result(name, title, note, shown, values, name == "condition_number")


def workspace_csv(workspace: Workspace) -> bytes:
    """One row per pose: coordinates, whether it can be reached, which limit is passed, and all results.

    SI units. Columns of results are empty if the platform does not state the limit they need; those of stiffness are
    there if its legs are compliant. `limit` is in words.
    """
    q = workspace.qualities
    poses = workspace.coordinates().reshape(-1, 6)
    columns: dict[str, pl.Series] = {name: pl.Series(poses[:, k]) for k, name in enumerate(COORDINATES)}
    columns["reachable"] = pl.Series(q.reachable.ravel())
    columns["limit"] = pl.Series(np.array([limit.name.lower() for limit in Limit])[q.limit.ravel()])
    for name in q._fields[1:]:
        values: FloatArray | None = getattr(q, name)
        if values is not None:
            columns[name] = pl.Series(values.ravel())
        elif name not in STIFFNESS:
            columns[name] = pl.Series([None] * len(poses), dtype=pl.Float64)
    return pl.DataFrame(columns).write_csv().encode()


# --- the report -------------------------------------------------------------------------------------------------


def workspace_report(workspace: Workspace, *, surface: bool = True) -> Report:
    """The report of a sweep, with maps of all results; of a volume also the `surface`, which takes seconds."""
    platform, maps = workspace.platform, list[Part](_maps(workspace))
    around = surface_of(workspace) if surface and len(workspace.shape) == 3 else None
    if around is not None:
        condition = next(_results(workspace))
        maps.insert(
            0,
            Surface(
                "the volume that can be reached",
                tuple(workspace.swept),
                tuple(_coordinate(workspace, name).quantity() for name in workspace.swept),
                np.array([values[0] for values in workspace.swept.values()]),
                np.array([values[-1] for values in workspace.swept.values()]),
                around.vertices,
                around.triangles.astype(float),
                10**around.colour,
                condition.title,
                condition.shown.quantity(),
                "log",
            ),
        )
    tables = [table for table in _tables(workspace) if table.rows]
    source = (Note(f"{platform.name}: {platform.source}"),) if platform.source else ()
    swept, fixed = [], []
    for name, values in workspace.swept.items():
        shown = _coordinate(workspace, name)
        swept.append(f"{name} from {shown.text(values[0])} to {shown.text(values[-1])}")
    for name, value in workspace.fixed.items():
        fixed.append(f"{name} {_coordinate(workspace, name).text(value)}")
    return Report(
        f"Workspace of {platform.name}",
        _verdict(workspace),
        (Section("Maps", tuple(maps)), Section("Workspace", (*tables, *source))),
        study="workspace",
        lead=f"{', '.join(swept)}; at {', '.join(fixed)}",
        numbers=_numbers(workspace),
        notes=tuple(Note(text, "warning") for text in _notices(workspace)),
    )


def _verdict(workspace: Workspace) -> Verdict:
    """How far the platform reaches along each coordinate, the share of the grid, and the limit that keeps off most."""
    reached, code = workspace.qualities.reachable, workspace.qualities.limit
    share = float(reached.mean())
    # margins end at the border
    defined = (n for n in _numbers(workspace) if n.value is not None)
    numbers = tuple(n for n in defined if not n.path.endswith("_margin") or "force" in n.path)
    shares = {limit: float((code == limit).mean()) for limit in Limit if limit != Limit.NONE}
    first = max(shares, key=lambda limit: shares[limit])
    why = _WHY.get(first, f"because of {first.text}")
    most = f"{percent(shares[first])} of it is out of reach {why}" if share < 1 else None
    if not reached.any():
        none = f"reaches none of {counted(reached.size, 'pose')} of this grid"
        return Verdict(sentence([none, most]), "bad", numbers)
    ends = []
    for axis, (name, values) in enumerate(workspace.swept.items()):
        rows, shown = rows_reached(reached, axis), _coordinate(workspace, name)
        low, high = (shown.text(float(values[rows[k]]), 3) for k in (0, -1))
        ends.append(f"{name} {low} to {high}{' or more' if rows[0] == 0 or rows[-1] == len(values) - 1 else ''}")
    part = f"{percent(share)} of the grid"
    n = len(workspace.swept)
    if all(COORDINATES[name] == "m" for name in workspace.swept):
        # each pose represents a cell; those at the ends of the grid, a part of one
        size: FloatArray = reached.astype(float)
        for values in reversed([*workspace.swept.values()]):
            size = np.asarray(np.trapezoid(size, values, axis=-1))
        # in the largest unit in which an area is at least 0.1, or a volume at least 0.01
        unit, factor = next(
            (unit, factor)
            for unit, factor in (("m", 1.0), ("cm", 1e2), ("mm", 1e3))
            if size * factor**n >= 10.0 ** (1 - n) or unit == "mm"
        )
        kind, power = {2: ("an area", "²"), 3: ("a volume", "³")}[n]
        part += f", {kind} of {number_text(float(size) * factor**n)} {unit}{power}"
    parts = [f"reaches {listed(ends)}", part, most]
    return Verdict(sentence(parts), "told" if share < 1 else "good", numbers)


def _numbers(workspace: Workspace) -> tuple[Number, ...]:
    reached = workspace.qualities.reachable
    poses = f"{int(reached.sum())} of {counted(reached.size, 'pose')}"
    numbers = [
        Number(
            "reachable",
            "share of the grid that can be reached",
            float(reached.mean()),
            SHARE,
            explanation=f"{poses}; the ranges decide what it is a share of",
        )
    ]
    for result in _results(workspace):
        values = result.values[reached]
        numbers.append(
            Number(
                f"worst.{result.name}",
                f"{result.title} at the worst pose",
                float(np.nanmax(values) if result.is_best_low else np.nanmin(values)) if values.size else None,
                result.shown.quantity(),
                explanation=f"Over all poses that can be reached. {result.note}",
            )
        )
    return tuple(numbers)


# --- maps -------------------------------------------------------------------------------------------------------


def _maps(workspace: Workspace) -> list[Chart]:
    """What limits each pose, then each result, over the first two coordinates; of a volume in slices of the third."""
    names, home, others = list(workspace.swept), workspace.home, dict(workspace.fixed)
    axes = [Axis(name, _coordinate(workspace, name).quantity(), workspace.swept[name]) for name in names]
    slices, first = None, 0
    if len(names) == 3:
        # the slice nearest to home is shown first
        slices = axes[2]
        first = int(np.abs(slices.values - home[names[2]]).argmin())
        others[names[2]] = float(slices.values[first])
    is_through_home = all(abs(value - home[name]) < _SAME for name, value in others.items())
    point = tuple(home[name] for name in names[:2]) if is_through_home else ()
    q = workspace.qualities
    inside = clearance(workspace.platform, q, workspace.coordinates()[..., 4])
    # heat maps have slices, then rows of the second coordinate
    whole = Map(inside.T, slices=slices, first=first, point=point, point_name="home" if point else "")

    def chart(title: str, series: Series, drawn: Map, note: str = "") -> Chart:
        return Chart(title, axes[0], (series,), "heat", y=axes[1], group=FIGURES[0], map=drawn, note=note)

    limits = Series("limit", NUMBER, q.limit.astype(float).T)
    charts = [chart("reachable region", limits, replace(whole, classes=tuple(limit.text for limit in Limit)))]
    # of a region that no pose is in, there is nothing to show
    for result in _results(workspace) if q.reachable.any() else ():
        series = Series(result.title, result.shown.quantity(), result.values.T)
        drawn = replace(whole, scale="log" if result.is_best_low else "linear")
        charts.append(chart(result.title, series, drawn, result.note))
    return charts


# --- tables -----------------------------------------------------------------------------------------------------


def _without_rounding(value: float) -> float:
    """A coordinate of the grid, whose middle is 0 up to rounding."""
    return round(float(value), 12) + 0.0


def _tables(workspace: Workspace) -> list[Table]:
    """What was swept; the limits; the best and the worst value of each result, with the swept coordinates there."""
    reached, code = workspace.qualities.reachable, workspace.qualities.limit
    swept: list[tuple[Cell, ...]] = []
    for axis, (name, values) in enumerate(workspace.swept.items()):
        quantity, within = _coordinate(workspace, name).quantity(), rows_reached(reached, axis)
        ends = [_without_rounding(values[k]) for k in (within[0], within[-1])] if within.size else [None, None]
        origin = "computed" if name in workspace.found else "assumed" if name in workspace.assumed else "given"
        low, high, *reaches = (Value(end, quantity) for end in (*map(_without_rounding, values[[0, -1]]), *ends))
        swept.append((name, low, high, len(values), *reaches, origin))
    heads = ("", "from", "to", "points", "reached from", "reached to", "range")
    tables = [Table("Swept", tuple(map(Column, heads)), tuple(swept))]

    stated: list[tuple[Cell, ...]] = []
    for row in LIMITS:
        title, value = row.description.removeprefix("maximum "), getattr(workspace.platform, row.name)
        if value is None:
            stated.append((title, "not stated", "nothing" if row.name in _KEPT else ""))
        else:
            kept = float(np.isin(code, _KEPT[row.name]).mean()) if row.name in _KEPT else ""
            shown = _shown(workspace, row.unit)
            stated.append((title, ", ".join(shown.text(float(number)) for number in np.ravel(value)), kept))
    for limit in (Limit.SINGULAR, Limit.PITCH):
        if (code == limit).any():
            stated.append((limit.text, "", float((code == limit).mean())))
    keeps = Column("keeps from", replace(SHARE, digits=3), "share of the poses of the grid")
    tables.append(Table("Limits of the platform", (Column(""), Column("value"), keeps), tuple(stated)))

    extremes: list[tuple[Cell, ...]] = []
    group_ends = []
    for result in _results(workspace) if reached.any() else ():
        known, sign = reached & ~np.isnan(result.values), -1 if result.is_best_low else 1
        ends_at_border = result.name in ("leg_length_margin", "joint_angle_margin")  # where it is 0
        for word, side in (("best", sign), ("worst", -sign))[: 1 if ends_at_border else 2]:
            k = int(first_of_largest(np.where(known, side * result.values, -np.inf).ravel()))
            at = np.unravel_index(k, workspace.shape)
            places = [_without_rounding(values[i]) for i, values in zip(at, workspace.swept.values(), strict=True)]
            extreme = Value(float(result.values[at]), result.shown.quantity())
            extremes.append((result.title, word, extreme, *places))
        group_ends.append(len(extremes) - 1)
    coordinates = [Column(name, _coordinate(workspace, name).quantity(3)) for name in workspace.swept]
    columns = (Column(""), Column(""), Column("value"), *coordinates)
    return [
        *tables,
        Table("Where it can be reached", columns, tuple(extremes), group_ends=tuple(group_ends), beside=True),
    ]


# --- notices ----------------------------------------------------------------------------------------------------


def _notices(workspace: Workspace) -> list[str]:
    """Notices to read before the maps; an empty list in usual cases."""
    platform, notices = workspace.platform, []
    if all(getattr(platform, name) is None for name in _KEPT):
        *names, last = _KEPT
        notices.append(
            f"{platform.name} states no {', '.join(names)} or {last}: only singular poses and a "
            "pitch of ±90° bound this region. State limits in the platform's file to see what the machine can reach."
        )
    if not workspace.qualities.reachable.any():
        poses = workspace.coordinates()
        at = np.unravel_index(int(clearance(platform, workspace.qualities, poses[..., 4]).argmax()), workspace.shape)
        places = [
            f"{name} {_coordinate(workspace, name).text(values[k], 3)}"
            for k, (name, values) in zip(at, workspace.swept.items(), strict=True)
        ]
        nearest = f"{', '.join(places)}: {_cause(workspace, poses[at][:3], poses[at][3:])}"
        # home is within the limits of every platform
        home, remedy = workspace.home, "but lies between two poses of this grid: use more points or smaller ranges"
        fixed_elsewhere = [name for name, value in workspace.fixed.items() if abs(value - home[name]) > _SAME]
        left_out = [n for n, v in workspace.swept.items() if not v[0] - _SAME <= home[n] <= v[-1] + _SAME]
        if names := fixed_elsewhere or left_out:
            places = [f"{name} at {_coordinate(workspace, name).text(home[name])}" for name in names]
            advice = "fix coordinates nearer to it" if fixed_elsewhere else "sweep a range about it, or omit the range"
            remedy = f"with {', '.join(places)}: {advice}"
        notices.append(
            f"No pose of this grid can be reached. The one nearest to the limits is {nearest}. "
            f"Home can be reached, {remedy}."
        )
    return notices


def _cause(workspace: Workspace, position: FloatArray, orientation: FloatArray) -> str:
    """The first limit that a pose exceeds, and by how much."""
    platform, limit = workspace.platform, Limit(int(limits_at(workspace.platform, position, orientation)))
    name = next((name for name, limits in _KEPT.items() if limit in limits), None)
    if name is None:
        return limit.text
    if name == "joint_angle_max":
        angles = joint_angles(platform, position, orientation, platform.home_position, platform.home_orientation)
        values, shown, digits = angles[limit == Limit.PLATFORM_JOINT], _shown(workspace, "rad"), 3
    else:
        values, shown, digits = leg_geometry(platform, position, orientation).length, _shown(workspace, "m"), 4
    most = of_legs(platform, name)
    k = int((most - values if limit == Limit.LEG_TOO_SHORT else values - most).argmax())
    size, stated = shown.text(values[k], digits), shown.text(most[k], digits)
    if name == "joint_angle_max":
        joint = "base" if limit == Limit.BASE_JOINT else "platform"
        return f"the {joint} joint of leg {k + 1} is {size} from its direction at home; {name} is {stated}"
    return f"leg {k + 1} is {size} long; {name} is {stated}"
