"""Charts of a report: axes, series with their roles and bands, maps, and what is marked in them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.harness.report.fields import array_of, one_of, set_arrays
from gough_stewart.harness.report.palette import ROLES, Role
from gough_stewart.harness.report.quantities import NUMBER, TIME, Quantity
from gough_stewart.model.vectors import FloatArray

ChartKind = Literal["line", "step", "points", "bars", "histogram", "heat"]
Scale = Literal["linear", "log"]
# More intervals are joined over the shortest gaps; a screen has some 2,000 pixels.
_MOST_INTERVALS = 1000


@dataclass(frozen=True, eq=False)
class Axis:
    """An axis of a chart: values (n,), or labels of bars; edges (n + 1,) of a histogram."""

    name: str
    quantity: Quantity = NUMBER
    values: FloatArray = field(default_factory=lambda: np.zeros(0))
    labels: tuple[str, ...] = ()
    scale: Scale = "linear"

    def __post_init__(self) -> None:
        one_of(self.scale, Scale, "the scale")
        object.__setattr__(self, "values", array_of(self.values, f"the axis {self.name}"))
        object.__setattr__(self, "labels", tuple(self.labels))

    @property
    def title(self) -> str:
        """Name and unit."""
        return self.quantity.headed(self.name)


@dataclass(frozen=True, eq=False)
class Series:
    """Values (n,) over the axis of a chart, with a band from `low` to `high`; (rows, columns) of a heat map.

    A heat map in slices has (slices, rows, columns).
    """

    name: str
    quantity: Quantity
    values: FloatArray
    role: Role = "actual"
    leg: int | None = None  # 1 to 6
    run: int | None = None  # index in `Report.runs`
    component: str = ""  # such as "x", "yaw"
    low: FloatArray | None = None
    high: FloatArray | None = None
    x: FloatArray | None = None  # where it has times or frequencies of its own
    members: FloatArray | None = None  # index of the member of each point
    of: int = 0  # values of which these are the smallest and largest of each interval; 0 if they are all

    def __post_init__(self) -> None:
        if self.role not in ROLES:
            raise ValueError(f"the role '{self.role}' of {self.name}; expected one of {', '.join(ROLES)}")
        if self.leg is not None and not 1 <= self.leg <= 6:
            raise ValueError(f"the leg {self.leg} of {self.name}; expected 1 to 6")
        values = array_of(self.values, f"the series {self.name}", (1, 2, 3))
        object.__setattr__(self, "values", values)
        for name in ("low", "high", "x", "members"):
            given = getattr(self, name)
            if given is not None:
                array = array_of(given, f"{name} of the series {self.name}")
                if len(array) != len(values):
                    raise ValueError(f"{len(array)} values '{name}' of {self.name}; expected {len(values)}")
                object.__setattr__(self, name, array)


@dataclass(frozen=True)
class Mark:
    """A line across a chart at a value, with a text."""

    value: float
    text: str
    direction: Literal["vertical", "horizontal"] = "horizontal"
    role: Role = "limit"
    tells: bool = True  # legends add the value to the text

    def __post_init__(self) -> None:
        if not math.isfinite(self.value):
            raise ValueError(f"the mark '{self.text}' at {self.value}; expected a finite number")


@dataclass(frozen=True)
class Span:
    """A distance along the vertical axis at one abscissa, with a text: such as a gain margin, from a curve to 1."""

    at: float
    low: float
    high: float
    text: str
    role: Role = "good"

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (self.at, self.low, self.high))):
            raise ValueError(f"the span '{self.text}' at {self.at}, {self.low} to {self.high}; expected finite numbers")


@dataclass(frozen=True)
class Strip:
    """When something holds along the axis of a chart, such as a limit that is active: intervals from – to."""

    name: str
    intervals: tuple[tuple[float, float], ...]
    role: Role = "limit"
    share: float = 0.0  # of the axis, 0 to 1


@dataclass(frozen=True, eq=False)
class Samples:
    """Values of some members of a chart's signal over its abscissa."""

    members: FloatArray  # (M,): their numbers
    x: FloatArray  # (T,)
    values: FloatArray  # (M, T), NaN after a member has ended
    of: int  # members of the ensemble

    def __post_init__(self) -> None:
        m, n = len(self.members), len(self.x)
        set_arrays(self, {"members": (m,), "x": (n,), "values": (m, n)}, "the samples of members")


@dataclass(frozen=True, eq=False)
class Map:
    """What a heat map has besides its values."""

    # Positive where the values hold, of their shape; colours end at 0, and values beyond are told at the pointer only.
    inside: FloatArray | None = None
    scale: Scale = "linear"  # of the colours; logarithmic ones span three decades at most
    classes: tuple[str, ...] = ()  # what the values 0, 1, … mean, if they are kinds
    slices: Axis | None = None  # the third coordinate
    first: int = 0  # the slice that is shown first
    point: tuple[float, ...] = ()  # a point to mark in that slice, such as home
    point_name: str = ""

    def __post_init__(self) -> None:
        one_of(self.scale, Scale, "the scale of colours")
        if self.inside is not None:
            object.__setattr__(self, "inside", array_of(self.inside, "the inside of a heat map", (2, 3)))
        object.__setattr__(self, "classes", tuple(self.classes))
        object.__setattr__(self, "point", tuple(map(float, self.point)))
        number = 1 if self.slices is None else len(self.slices.values)
        if not 0 <= self.first < number:
            raise ValueError(f"the slice {self.first} is shown first; expected one of {number}, counted from 0")
        if len(self.point) not in (0, 2):
            raise ValueError(f"a point of {len(self.point)} coordinates; expected 2, or none")


@dataclass(frozen=True, eq=False)
class Chart:
    """Series of one quantity over one axis."""

    title: str
    x: Axis
    series: tuple[Series, ...]
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
        one_of(self.kind, ChartKind, "the kind of chart")
        object.__setattr__(self, "series", tuple(self.series))
        for name in ("marks", "spans", "strips"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if not self.series:
            raise ValueError(f"the chart '{self.title}' has no series; expected at least one")
        if len({each.quantity.unit for each in self.series}) > 1:
            units = ", ".join(sorted({each.quantity.unit or "1" for each in self.series}))
            raise ValueError(f"the chart '{self.title}' has series in {units}; expected one unit")
        for each in self.series:
            self._check(each)

    def _check(self, series: Series) -> None:
        size, along = series.values.shape, len(self.x.labels) or len(self.x.values)
        if self.kind == "heat":
            rows = 0 if self.y is None else len(self.y.values)
            slices = None if self.map is None else self.map.slices
            wanted = (rows, along) if slices is None else (len(slices.values), rows, along)
            if size != wanted:
                raise ValueError(f"the heat map '{self.title}' has {size} values; expected {wanted}")
            if self.map is not None and self.map.inside is not None and self.map.inside.shape != wanted:
                raise ValueError(f"'inside' of '{self.title}' has {self.map.inside.shape} values; expected {wanted}")
            return
        expected = along - 1 if self.kind == "histogram" else along
        if series.values.ndim != 1 or (series.x is None and size[0] != expected):
            raise ValueError(f"the series '{series.name}' of '{self.title}' has {size} values; expected ({expected},)")

    @property
    def y_title(self) -> str:
        """Name and unit of the vertical axis."""
        quantity = self.series[0].quantity
        if self.y is not None and (self.kind == "heat" or self.y.labels):
            return self.y.title if self.kind == "heat" else self.y.name
        return quantity.headed(self.y.name if self.y else "")

    def x_of(self, series: Series) -> FloatArray:
        """The abscissae of one of its series."""
        return self.x.values if series.x is None else series.x


def time_axis(values: FloatArray | Sequence[float]) -> Axis:
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
