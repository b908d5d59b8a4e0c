"""What a study found, as plain data: title, verdict, numbers, sections of tables, charts, scenes and surfaces.

A study makes a `Report` and knows nothing of HTML, matplotlib or rich; `terminal`, `page` and `figures` render it.
`codec` writes it as JSON and reads it back. All numbers are in SI units (`quantities`), a value that is not defined is
None, or NaN in an array.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np

from gough_stewart.harness.report.marks import Span, Strip
from gough_stewart.harness.report.palette import ROLES, Role
from gough_stewart.harness.report.quantities import NUMBER, TIME, Quantity
from gough_stewart.harness.report.samples import Samples
from gough_stewart.harness.report.surface import Surface
from gough_stewart.harness.report.words import plain_text
from gough_stewart.model.vectors import FloatArray

ChartKind = Literal["line", "step", "points", "bars", "histogram", "heat"]
Status = Literal["good", "marginal", "bad", "told"]
Verdicts = Literal["met", "missed", "open"]
Scale = Literal["linear", "log"]


def _array(values: Any, what: str, dimensions: tuple[int, ...] = (1,)) -> FloatArray:
    """A read-only array of numbers; NaN where there is none."""
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{what}: {type(values).__name__}; expected an array of numbers") from None
    if array.ndim not in dimensions:
        raise ValueError(f"{what}: an array of {array.ndim} dimensions; expected {' or '.join(map(str, dimensions))}")
    array.setflags(write=False)
    return array


def _defined(value: float | None) -> float | None:
    """A number, or None for NaN."""
    return None if value is None or math.isnan(value) else float(value)


def _one_of(value: str, kind: Any, what: str) -> None:
    if value not in get_args(kind):
        raise ValueError(f"{what} '{value}'; expected one of {', '.join(get_args(kind))}")


@dataclass(frozen=True)
class Value:
    """A number in a cell of a table whose quantity is not that of its column."""

    value: float | None
    quantity: Quantity

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", _defined(self.value))

    @property
    def text(self) -> str:
        """As shown, with its unit."""
        return self.quantity.text(self.value)


Cell = str | bool | int | float | Value | None


@dataclass(frozen=True, eq=False)
class Number:
    """A number that the study found, and that a requirement may name by its path."""

    path: str  # as "tracking.position.norm_peak"; "" for one without
    name: str  # its words
    value: float | None
    quantity: Quantity = NUMBER
    low: float | None = None  # confidence interval, or range
    high: float | None = None
    limit: float | None = None
    margin: float | None = None  # to the limit; < 0 beyond it
    explanation: str = ""
    # One per member of an ensemble (N,), NaN where it is not defined.
    members: FloatArray | None = None
    small_is_worse: bool = False

    def __post_init__(self) -> None:
        for name in ("value", "low", "high", "limit", "margin"):
            object.__setattr__(self, name, _defined(getattr(self, name)))
        if self.members is not None:
            object.__setattr__(self, "members", _array(self.members, f"the members of {self.path}"))

    @property
    def text(self) -> str:
        """The value as shown, with its unit."""
        return self.quantity.text(self.value)


@dataclass(frozen=True)
class Verdict:
    """The answer to the study's question, in one line, and the numbers that carry it."""

    text: str
    status: Status
    numbers: tuple[Number, ...] = ()

    def __post_init__(self) -> None:
        _one_of(self.status, Status, "the status")
        if not self.text or "\n" in self.text:
            raise ValueError(f"the verdict {self.text!r}; expected one line")


@dataclass(frozen=True, eq=False)
class Axis:
    """An axis of a chart: values (n,), or labels of bars; edges (n + 1,) of a histogram."""

    name: str
    quantity: Quantity = NUMBER
    values: FloatArray = field(default_factory=lambda: np.zeros(0))
    labels: tuple[str, ...] = ()
    scale: Scale = "linear"

    def __post_init__(self) -> None:
        _one_of(self.scale, Scale, "the scale")
        object.__setattr__(self, "values", _array(self.values, f"the axis {self.name}"))
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
        values = _array(self.values, f"the series {self.name}", (1, 2, 3))
        object.__setattr__(self, "values", values)
        for name in ("low", "high", "x", "members"):
            given = getattr(self, name)
            if given is not None:
                array = _array(given, f"{name} of the series {self.name}")
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
        _one_of(self.scale, Scale, "the scale of colours")
        if self.inside is not None:
            object.__setattr__(self, "inside", _array(self.inside, "the inside of a heat map", (2, 3)))
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
        _one_of(self.kind, ChartKind, "the kind of chart")
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


@dataclass(frozen=True)
class Column:
    """A column of a table; `quantity` for numbers that are all of one kind."""

    name: str
    quantity: Quantity | None = None
    explanation: str = ""


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


@dataclass(frozen=True)
class Flag:
    """Something that is on or off over time: `values` has a character "0" or "1" per frame but the last."""

    name: str
    values: str


@dataclass(frozen=True, eq=False)
class Scene:
    """A platform in motion: points of both bodies, and n frames."""

    name: str
    base_points: FloatArray  # (6, 3), world [m]
    platform_points: FloatArray  # (6, 3), platform axes [m]
    lower: float  # drawn lengths of the parts of a leg [m]
    upper: float
    time: FloatArray  # (n,) [s]
    pose: FloatArray  # (n, 7): position [m] and quaternion (x, y, z, w)
    leg_length: FloatArray  # (n, 6) [m]
    home: FloatArray = field(default_factory=lambda: np.array([0.0, 0, 0, 0, 0, 0, 1]))  # (7,)
    orientation: FloatArray | None = None  # (n, 3): roll, pitch, yaw [rad]
    reference: FloatArray | None = None  # (n, 7)
    actuator_force: FloatArray | None = None  # (n, 6) [N]
    external_force: FloatArray | None = None  # (n, 3), world [N]
    nearness: FloatArray | None = None  # (n, 6): to the nearest limit, which is at 1
    nearness_of: tuple[str, ...] = ()
    flags: tuple[Flag, ...] = ()
    rows: int = 0  # of the record; frames may be fewer
    run: int | None = None  # index in `Report.runs`

    def __post_init__(self) -> None:
        n = len(_array(self.time, f"the time of the scene {self.name}"))
        shapes: dict[str, tuple[int, ...]] = {
            **{"base_points": (6, 3), "platform_points": (6, 3), "time": (n,), "pose": (n, 7), "leg_length": (n, 6)},
            **{"home": (7,), "orientation": (n, 3), "reference": (n, 7), "actuator_force": (n, 6)},
            **{"external_force": (n, 3), "nearness": (n, 6)},
        }
        for name, shape in shapes.items():
            given = getattr(self, name)
            if given is None:
                continue
            array = _array(given, f"{name} of the scene {self.name}", (1, 2))
            if array.shape != shape:
                raise ValueError(f"{name} of the scene {self.name} has {array.shape} values; expected {shape}")
            object.__setattr__(self, name, array)


@dataclass(frozen=True)
class Note:
    """A sentence for the reader."""

    text: str
    kind: Literal["note", "warning"] = "note"


@dataclass(frozen=True)
class File:
    """A file that the study wrote, and what it has."""

    name: str
    what: str = ""


@dataclass(frozen=True)
class Setting:
    """A key of the experiment that was set, or that differs between runs: a value for each run."""

    key: str
    values: tuple[str, ...]
    default: str = ""  # in the file

    @property
    def text(self) -> str:
        """Key and value, for those of a single run."""
        return f"{self.key} = {self.values[0]}"


def settings_of(changed: Mapping[str, Mapping[str, Any]]) -> tuple[Setting, ...]:
    """The keys whose `value` is not that of the `file`, which is None if it has none."""
    texts = (
        (key, plain_text(each["value"]), "" if each["file"] is None else plain_text(each["file"]))
        for key, each in changed.items()
    )
    return tuple(Setting(key, (value,), of_file) for key, value, of_file in texts if value != of_file)


@dataclass(frozen=True)
class Requirement:
    """What was required of a number, and how it came out."""

    text: str  # as written
    path: str
    name: str
    status: Verdicts  # "open" if the study cannot tell
    value: float | None
    bound: float
    quantity: Quantity
    margin: float | None = None  # < 0 if it is missed
    note: str = ""  # how sure, or what would tell

    def __post_init__(self) -> None:
        _one_of(self.status, Verdicts, "the status")
        object.__setattr__(self, "value", _defined(self.value))
        object.__setattr__(self, "margin", _defined(self.margin))

    @property
    def found(self) -> str:
        """The value with its margin, and how sure."""
        value = None if self.value is None else self.quantity.text(self.value)
        margin = None if self.margin is None else margin_text(self.quantity, self.margin)
        return "; ".join(filter(None, (", ".join(filter(None, (value, margin))), self.note)))


def margin_text(quantity: Quantity, margin: float) -> str:
    """A margin to a limit, in words if it is beyond."""
    return f"{quantity.text(abs(margin))} {'beyond' if margin < 0 else 'left'}"


Part = Table | Chart | Scene | Surface | Note


@dataclass(frozen=True, eq=False)
class Section:
    """Parts of a report under a title; `detail` for those that a reader opens if needed."""

    title: str
    parts: tuple[Part, ...]
    detail: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(self.parts))


@dataclass(frozen=True, eq=False)
class Report:
    """What a study found."""

    title: str
    verdict: Verdict
    sections: tuple[Section, ...] = ()
    study: str = ""  # the command, as "run"
    lead: str = ""  # what was studied, in a sentence
    numbers: tuple[Number, ...] = ()  # all that requirements may name
    requirements: tuple[Requirement, ...] = ()
    settings: tuple[Setting, ...] = ()
    runs: tuple[str, ...] = ()  # names, where there are several
    notes: tuple[Note, ...] = ()
    files: tuple[File, ...] = ()
    repeat: str = ""  # the command that runs a member of an ensemble, without its number

    def __post_init__(self) -> None:
        for name in ("sections", "numbers", "requirements", "settings", "runs", "notes", "files"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        known: set[str] = set()
        for path in (each.path for each in self.numbers if each.path):
            if path in known:
                raise ValueError(f"the number {path} is there twice; expected every path once")
            known.add(path)

    def parts(self) -> Iterator[Part]:
        """All parts of all sections."""
        for section in self.sections:
            yield from section.parts

    @property
    def charts(self) -> list[Chart]:
        """All charts."""
        return [part for part in self.parts() if isinstance(part, Chart)]

    @property
    def changed(self) -> str:
        """What was set of the experiment's file, with what the file has; "" for nothing or several runs."""
        if len(self.runs) > 1:
            return ""
        return ", ".join(f"{e.text} (file: {e.default})" if e.default else e.text for e in self.settings)

    def number(self, path: str) -> Number:
        """The number of a path.

        Raises
        ------
        KeyError
            There is none.
        """
        found = next((each for each in self.numbers if each.path == path), None)
        if found is None:
            raise KeyError(path)
        return found


def time_axis(values: FloatArray | Sequence[float]) -> Axis:
    """The axis of time."""
    return Axis("time", TIME, np.asarray(values, dtype=float))
