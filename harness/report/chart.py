"""What a report draws: charts with series, maps and marks; in three dimensions a platform in motion, and a surface."""

from collections.abc import Sequence
from dataclasses import field
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field
from pydantic.dataclasses import dataclass

from gough_stewart.harness.report.data import CONFIG, Array, Data, Layers, Rows, Vector, check_shapes
from gough_stewart.harness.report.palette import (
    DASHES,
    PLAIN_ROLES,
    SIX_DASHES,
    Role,
    colour_of,
    colour_of_six,
)
from gough_stewart.harness.report.quantities import NUMBER, TIME, Quantity
from gough_stewart.model.vectors import FloatArray

ChartKind = Literal["line", "step", "points", "bars", "histogram", "heat"]
Scale = Literal["linear", "log"]
Finite = Annotated[float, Field(allow_inf_nan=False)]
# More intervals are joined over the shortest gaps; a screen has some 2,000 pixels.
_MOST_INTERVALS = 1000
_THREE = Field(min_length=3, max_length=3)
# Arrays of a scene with a row for each frame, and their columns.
COLUMNS = {"pose": 7, "reference": 7, "orientation": 3, "leg_length": 6}
COLUMNS |= {"actuator_force": 6, "external_force": 3, "nearness": 6}


@dataclass(frozen=True, eq=False, config=CONFIG)
class Axis(Data):
    """An axis of a chart: values (n,), or labels of bars; edges (n + 1,) of a histogram."""

    name: str
    quantity: Quantity = NUMBER
    values: Vector = field(default_factory=lambda: np.zeros(0))
    labels: tuple[str, ...] = ()
    scale: Scale = "linear"

    @property
    def title(self) -> str:
        """Name and unit."""
        return self.quantity.headed(self.name)


@dataclass(frozen=True, eq=False, config=CONFIG)
class Series(Data):
    """Values (n,) over the axis of a chart, with a band from `low` to `high`; (rows, columns) of a heat map.

    A heat map in slices has (slices, rows, columns).
    """

    name: str
    quantity: Quantity
    values: Array
    role: Role = "actual"
    leg: Annotated[int, Field(ge=1, le=6)] | None = None
    run: int | None = None  # index in `Report.runs`
    component: str = ""  # such as "x", "yaw"
    low: Vector | None = None
    high: Vector | None = None
    x: Vector | None = None  # where it has times or frequencies of its own
    members: Vector | None = None  # index of the member of each point
    of: int = 0  # values of which these are the smallest and largest of each interval; 0 if they are all

    def __post_init__(self) -> None:
        for name in ("low", "high", "x", "members"):
            beside = getattr(self, name)
            if beside is not None and len(beside) != len(self.values):
                raise ValueError(f"{len(beside)} values '{name}' of {self.name}; expected {len(self.values)}")


class Look(NamedTuple):
    """How a series is drawn."""

    colour: Role | int  # of a role, or one of six
    dashes: tuple[float, ...]  # in widths of the line; none for a full line
    shade: str  # the colour on a light ground, as #rrggbb


def looks_of(lines: Sequence[Series], *, in_print: bool = False) -> list[Look]:
    """Colour and dashes of each series: by role, or by run, leg or order where several have one role.

    No two lines share both. Those of six colours have dashes, too, if they differ by run, or `in_print`.
    """
    names, roles = [line.leg or line.component or line.name for line in lines], [line.role for line in lines]
    components, looks, used = list(dict.fromkeys(names)), list[Look](), set[tuple[str, tuple[float, ...]]]()
    for line, name in zip(lines, names, strict=True):
        place, is_plain = components.index(name), line.role in PLAIN_ROLES
        colour: Role | int = line.role
        dashes = DASHES.get(line.role, ())
        if line.run is not None:
            colour = line.run % 6
            dashes = SIX_DASHES[place % 6] if is_plain else dashes
        elif is_plain and (line.leg or roles.count(line.role) > 1):
            place = line.leg - 1 if line.leg else place
            # of more than six, the colours come again with other dashes
            colour, dashes = place % 6, SIX_DASHES[(place + place // 6) % 6] if in_print else ()
        shade = colour_of_six(colour) if isinstance(colour, int) else colour_of(colour)
        while line.role != "band" and (shade, dashes) in used:
            dashes = (*dashes, 1.0, 3.0) if dashes else (6.0, 3.0)
        used.add((shade, dashes))
        looks.append(Look(colour, dashes, shade))
    return looks


@dataclass(frozen=True, config=CONFIG)
class Mark(Data):
    """A line across a chart at a value, with a text."""

    value: Finite
    text: str
    direction: Literal["vertical", "horizontal"] = "horizontal"
    role: Role = "limit"
    tells: bool = True  # legends add the value to the text


@dataclass(frozen=True, config=CONFIG)
class Span(Data):
    """A distance along the vertical axis at one abscissa, with a text: such as a gain margin, from a curve to 1."""

    at: Finite
    low: Finite
    high: Finite
    text: str
    role: Role = "good"


@dataclass(frozen=True, config=CONFIG)
class Strip(Data):
    """When something holds along the axis of a chart, such as a limit that is active: intervals from – to."""

    name: str
    intervals: tuple[tuple[float, float], ...]
    role: Role = "limit"
    share: float = 0.0  # of the axis, 0 to 1


@dataclass(frozen=True, eq=False, config=CONFIG)
class Samples(Data):
    """Values of some members of a chart's signal over its abscissa."""

    members: Vector  # (M,): their numbers
    x: Vector  # (T,)
    values: Rows  # (M, T), NaN after a member has ended
    of: int  # members of the ensemble

    def __post_init__(self) -> None:
        check_shapes(self, "the samples of members", {"values": (len(self.members), len(self.x))})


@dataclass(frozen=True, eq=False, config=CONFIG)
class Map(Data):
    """What a heat map has besides its values."""

    # Positive where the values hold, of their shape; colours end at 0, and values beyond are told at the pointer only.
    inside: Layers | None = None
    scale: Scale = "linear"  # of the colours; logarithmic ones span three decades at most
    classes: tuple[str, ...] = ()  # what the values 0, 1, … mean, if they are kinds
    slices: Axis | None = None  # the third coordinate
    first: int = 0  # the slice that is shown first
    point: tuple[float, ...] = ()  # a point to mark in that slice, such as home
    point_name: str = ""

    def __post_init__(self) -> None:
        number = 1 if self.slices is None else len(self.slices.values)
        if not 0 <= self.first < number:
            raise ValueError(f"the slice {self.first} is shown first; expected one of {number}, counted from 0")
        if len(self.point) not in (0, 2):
            raise ValueError(f"a point of {len(self.point)} coordinates; expected 2, or none")


@dataclass(frozen=True, eq=False, config=CONFIG)
class Chart(Data):
    """Series of one quantity over one axis."""

    title: str
    x: Axis
    series: Annotated[tuple[Series, ...], Field(min_length=1)]
    kind: ChartKind = "line"
    y: Axis | None = None  # its name and scale; labels of the values 0, 1, …; the values of a heat map's rows
    marks: tuple[Mark, ...] = ()
    note: str = ""
    group: str = ""  # charts of a group are drawn together, as panels of one figure
    detail: bool = False  # not shown at first
    map: Map | None = None  # of a heat map
    spans: tuple[Span, ...] = ()
    strips: tuple[Strip, ...] = ()  # when limits are active
    samples: Samples | None = None  # of single members; on the page only

    def __post_init__(self) -> None:
        units = sorted({series.quantity.unit or "1" for series in self.series})
        if len(units) > 1:
            raise ValueError(f"the chart '{self.title}' has series in {', '.join(units)}; expected one unit")
        along = len(self.x.labels) or len(self.x.values)
        slices = () if self.map is None or self.map.slices is None else (len(self.map.slices.values),)
        rows = (*slices, 0 if self.y is None else len(self.y.values)) if self.kind == "heat" else ()
        needed = (*rows, along - 1 if self.kind == "histogram" else along)
        for series in self.series:
            shape = series.values.shape
            if shape != needed and (len(needed) != len(shape) or series.x is None):
                raise ValueError(f"the series '{series.name}' of '{self.title}' has {shape} values; expected {needed}")
        if self.map is not None:
            check_shapes(self.map, f"the map '{self.title}'", {"inside": needed})

    @property
    def y_title(self) -> str:
        """Name and unit of the vertical axis."""
        quantity = self.series[0].quantity
        if self.y is not None and (self.kind == "heat" or self.y.labels):
            return self.y.title if self.kind == "heat" else self.y.name
        return quantity.headed(self.y.name if self.y else "")

    @property
    def is_over_time(self) -> bool:
        """Whether its curves are over time."""
        return self.kind in ("line", "step") and self.x.quantity == TIME

    def x_of(self, series: Series) -> FloatArray:
        """The abscissae of one of its series."""
        return self.x.values if series.x is None else series.x


def time_axis(values: ArrayLike) -> Axis:
    """The axis of time."""
    return Axis("time", TIME, np.asarray(values, dtype=float))


def strip_of(name: str, at: FloatArray, holds: ArrayLike, role: Role = "limit") -> Strip | None:
    """A strip where `holds` (n,) is true; each row counts until the next one (n,). None if it never holds."""
    active = np.asarray(holds, dtype=bool)[:-1]
    if not active.any():
        return None
    edges = np.flatnonzero(np.diff(np.concatenate([[False], active, [False]]).astype(int)))
    starts, ends = at[edges[::2]], at[edges[1::2]]
    share = float((ends - starts).sum() / (at[-1] - at[0]))
    if len(starts) > _MOST_INTERVALS:
        gaps = starts[1:] - ends[:-1]
        kept = np.sort(np.argsort(gaps, kind="stable")[-(_MOST_INTERVALS - 1) :])
        starts, ends = np.concatenate([starts[:1], starts[kept + 1]]), np.concatenate([ends[kept], ends[-1:]])
    return Strip(name, tuple(zip(starts.tolist(), ends.tolist(), strict=True)), role, share)


@dataclass(frozen=True, config=CONFIG)
class Flag(Data):
    """Something that is on or off over time: `values` has a character "0" or "1" per frame but the last."""

    name: str
    values: str


@dataclass(frozen=True, eq=False, config=CONFIG)
class Scene(Data):
    """A platform in motion: points of both bodies, and n frames."""

    name: str
    base_points: Rows  # (6, 3), world [m]
    platform_points: Rows  # (6, 3), platform axes [m]
    lower: float  # drawn lengths of the parts of a leg [m]
    upper: float
    time: Vector  # (n,) [s]
    pose: Rows  # (n, 7): position [m] and quaternion (x, y, z, w)
    leg_length: Rows  # (n, 6) [m]
    home: Vector = field(default_factory=lambda: np.array([0.0, 0, 0, 0, 0, 0, 1]))  # (7,)
    orientation: Rows | None = None  # (n, 3): roll, pitch, yaw [rad]
    reference: Rows | None = None  # (n, 7)
    actuator_force: Rows | None = None  # (n, 6) [N]
    external_force: Rows | None = None  # (n, 3), world [N]
    nearness: Rows | None = None  # (n, 6): to the nearest limit, which is at 1
    nearness_of: tuple[str, ...] = ()
    flags: tuple[Flag, ...] = ()
    rows: int = 0  # of the record; frames may be fewer
    run: int | None = None  # index in `Report.runs`
    decimals: int = 4  # of poses and lengths in m; angles in degrees have two less

    def __post_init__(self) -> None:
        shapes = {name: (len(self.time), width) for name, width in COLUMNS.items()}
        fixed = {"base_points": (6, 3), "platform_points": (6, 3), "home": (7,)}
        check_shapes(self, f"the scene {self.name}", {**fixed, **shapes})


@dataclass(frozen=True, eq=False, config=CONFIG)
class Surface(Data):
    """Triangles in the box of three coordinates, with a value at every corner that sets its colour."""

    title: str
    names: Annotated[tuple[str, ...], _THREE]  # of the three coordinates
    quantities: Annotated[tuple[Quantity, ...], _THREE]
    low: Vector  # (3,): the box
    high: Vector  # (3,)
    vertices: Rows  # (n, 3), SI units
    triangles: Rows  # (m, 3): indices of vertices, counter-clockwise seen from outside
    values: Vector  # (n,)
    name: str = ""  # of the values
    quantity: Quantity = NUMBER
    scale: Scale = "linear"  # of the colours
    detail: bool = False

    def __post_init__(self) -> None:
        n, m = len(self.vertices), len(self.triangles)
        shapes = {"low": (3,), "high": (3,), "vertices": (n, 3), "triangles": (m, 3), "values": (n,)}
        check_shapes(self, f"the surface {self.title}", shapes)
        if m and not (self.triangles.min() >= 0 and self.triangles.max() < n):
            raise ValueError(f"a triangle of the surface '{self.title}' names a corner that is not there")
