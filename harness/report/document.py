"""What a study found, as plain data: title, verdict, numbers, sections of tables, charts, scenes and surfaces.

A study makes a `Report` and knows nothing of HTML, matplotlib or rich; `terminal`, `page` and `figures` render it.
All numbers are in SI units (`quantities`), a value that is not defined is None, or NaN in an array.

As JSON, fields with their default value are left out. Quantities are listed once, under `quantities`, and named
elsewhere. A part of a section says what it is by `part`. docs/report.md describes the fields.
"""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass
from pydantic_core import to_json as to_json_bytes
from rich.cells import cell_len

from gough_stewart.harness.report.chart import COLUMNS, Chart, Scene, Surface
from gough_stewart.harness.report.data import CONFIG, Data, Defined, Vector
from gough_stewart.harness.report.packing import decimated
from gough_stewart.harness.report.quantities import NUMBER, Quantity, plain_text

VERSION = 1
# Points of a line, and frames of a scene, that other programs are given.
POINTS, FRAMES = 800, 201
Status = Literal["good", "marginal", "bad", "told"]
Verdicts = Literal["met", "missed", "open"]
_NUMBER = re.compile(r"[-+±×<(\s]*\d")
# Longer texts of several words are sentences, which wrap.
PROSE = 18


# --- tables -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, config=CONFIG)
class Value(Data):
    """A number in a cell of a table whose quantity is not that of its column."""

    value: Defined
    quantity: Quantity


def _cell(value: Any) -> Any:
    if isinstance(value, str) and value in ("Infinity", "-Infinity"):  # as JSON has them
        return float(value)
    return None if isinstance(value, float) and math.isnan(value) else value


Cell = Annotated[str | bool | int | float | Value | None, BeforeValidator(_cell)]


@dataclass(frozen=True, config=CONFIG)
class Column(Data):
    """A column of a table; `quantity` for numbers that are all of one kind."""

    name: str
    quantity: Quantity | None = None
    explanation: str = ""

    @property
    def title(self) -> str:
        """Name, and unit of numbers that are all of one kind."""
        return self.quantity.headed(self.name) if self.quantity else self.name


@dataclass(frozen=True, config=CONFIG)
class Table(Data):
    """Rows of cells under columns; the first cell of a row names it."""

    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    sortable: bool = False
    first_shown: int | None = None  # the rows that are shown at first; None for all
    group_ends: tuple[int, ...] = ()  # rows after which a group ends
    note: str = ""
    detail: bool = False  # on the page only, and not shown at first
    beside: bool = False  # on the page under the verdict, where a chart or surface is the picture
    links: tuple[str, ...] = ()  # a page for each row, relative to the report's; "" for none

    def __post_init__(self) -> None:
        links, rows = len(self.links), len(self.rows)
        if links not in (0, rows):
            raise ValueError(f"{links} links of '{self.title}'; expected one for each of {rows} rows")
        for k, row in enumerate(self.rows):
            if len(row) != len(self.columns):
                raise ValueError(f"row {k + 1} of '{self.title}' has {len(row)} cells; expected {len(self.columns)}")

    @property
    def shown(self) -> list[tuple[str, ...]]:
        """The cells of all rows as a terminal shows them; a unit that a row shares is beside its first cell."""
        rows = []
        for k, unit in enumerate(self.shared_units):
            name, *others = self.texts(k, units=not unit)
            rows.append((f"{name} {unit}" if unit else name, *others))
        return rows

    @cached_property
    def shared_units(self) -> tuple[str, ...]:
        """By row, the unit of one whose values have the same one, which is then said once; "" for another row.

        Where columns state units too, this holds for all rows or none, so that they look alike.
        """
        units = [{cell.quantity.unit_text for cell in cells[1:] if isinstance(cell, Value)} for cells in self.rows]
        is_mixed = any(column.quantity for column in self.columns[1:]) and any(len(kinds) > 1 for kinds in units)
        return tuple("" if is_mixed or len(kinds) != 1 else kinds.pop() for kinds in units)

    def texts(self, row: int, *, units: bool = True) -> tuple[str, ...]:
        """The cells of a row as shown; units only where the column does not state it, or never."""
        shown = list[str]()
        for cell, column in zip(self.rows[row], self.columns, strict=True):
            if isinstance(cell, Value):
                shown.append(cell.quantity.text(cell.value, unit=units))
            elif isinstance(cell, bool):
                shown.append("yes" if cell else "no")
            elif isinstance(cell, str) or (isinstance(cell, int) and column.quantity is None):
                shown.append(str(cell))
            else:
                shown.append((column.quantity or NUMBER).text(cell, unit=False))
        return tuple(shown)


def is_at_right(cells: Sequence[Cell], texts: Sequence[str]) -> bool:
    """Whether a column is right-aligned: its cells are numbers or blank, or its texts numbers and no sentences."""
    filled = [cell for cell in cells if cell not in (None, "")]
    if filled and all(isinstance(cell, int | float | Value) and not isinstance(cell, bool) for cell in filled):
        return True
    numbers = [_NUMBER.match(text) is not None for text in texts]
    return any(numbers) and (all(numbers) or not any(cell_len(text) > PROSE and " " in text for text in texts))


# --- the report -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, config=CONFIG)
class Number(Data):
    """A number that the study found, and that a requirement may name by its path."""

    path: str  # as "tracking.position.norm_peak"; "" for one without
    name: str  # its words
    value: Defined
    quantity: Quantity = NUMBER
    low: Defined = None  # confidence interval, or range
    high: Defined = None
    limit: Defined = None
    margin: Defined = None  # to the limit; < 0 beyond it
    explanation: str = ""
    # One per member of an ensemble (N,), NaN where it is not defined.
    members: Vector | None = None
    small_is_worse: bool = False
    block: int = 1  # so many members share their numbers; only blocks are independent
    in_sequence: bool = False  # blocks are of a Sobol' sequence, whose numbers are powers of two
    doubt: str = ""  # why a requirement on it is inconclusive, if so

    @property
    def text(self) -> str:
        """The value as shown, with its unit."""
        return self.quantity.text(self.value)

    @property
    def remark(self) -> str:
        """What stands behind it: its interval, its limit, the margin."""
        quantity = self.quantity
        interval = None if self.low is self.high is None else quantity.range_text(self.low, self.high)
        limit = None if self.limit is None else f"limit {quantity.text(self.limit)}"
        margin = None
        if self.margin is not None:
            margin = f"{quantity.text(abs(self.margin))} {'beyond' if self.margin < 0 else 'left'}"
        return ", ".join(filter(None, (interval, limit, margin, self.doubt)))


@dataclass(frozen=True, config=CONFIG)
class Verdict(Data):
    """The answer to the study's question, in one line, and the numbers that carry it."""

    text: Annotated[str, Field(pattern=r"^[^\n]+$")]
    status: Status
    numbers: tuple[Number, ...] = ()


@dataclass(frozen=True, config=CONFIG)
class Note(Data):
    """A sentence for the reader."""

    detail: ClassVar[bool] = False  # unlike a table or a chart
    text: str
    kind: Literal["note", "warning"] = "note"


@dataclass(frozen=True, config=CONFIG)
class File(Data):
    """A file that the study wrote, and what it has."""

    name: str
    what: str = ""


@dataclass(frozen=True, config=CONFIG)
class Setting(Data):
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
    settings = (
        Setting(key, (plain_text(values["value"]),), "" if values["file"] is None else plain_text(values["file"]))
        for key, values in changed.items()
    )
    return tuple(setting for setting in settings if setting.values[0] != setting.default)


@dataclass(frozen=True, config=CONFIG)
class Requirement(Data):
    """What was required of a number, and how it came out."""

    text: str  # as written
    path: str
    name: str
    status: Verdicts  # "open" if the study cannot tell
    value: Defined
    bound: float
    quantity: Quantity
    margin: Defined = None  # < 0 if it is missed
    note: str = ""  # how sure, or what would tell

    @property
    def found(self) -> str:
        """The value with its margin, and how sure."""
        value = None if self.value is None else self.quantity.text(self.value)
        margin = None
        if self.margin is not None:
            margin = f"{self.quantity.text(abs(self.margin))} {'beyond' if self.margin < 0 else 'left'}"
        return "; ".join(filter(None, (", ".join(filter(None, (value, margin))), self.note)))


Part = Annotated[
    Annotated[Table, Tag("table")]
    | Annotated[Chart, Tag("chart")]
    | Annotated[Scene, Tag("scene")]
    | Annotated[Surface, Tag("surface")]
    | Annotated[Note, Tag("note")],
    # in JSON, a key says what a part is, which is no field
    Discriminator(lambda part: part.pop("part", None) if isinstance(part, dict) else type(part).__name__.lower()),
]


@dataclass(frozen=True, eq=False, config=CONFIG)
class Section(Data):
    """Parts of a report under a title; `detail` for those that a reader opens if needed."""

    title: str
    parts: tuple[Part, ...]
    detail: bool = False


@dataclass(frozen=True, eq=False, config=CONFIG)
class Report(Data):
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
        paths = [number.path for number in self.numbers if number.path]
        if len(set(paths)) < len(paths):
            twice = next(path for path in paths if paths.count(path) > 1)
            raise ValueError(f"the number {twice} is there twice; expected every path once")

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
        texts = [setting.text + (f" (file: {setting.default})" if setting.default else "") for setting in self.settings]
        return ", ".join(texts)

    def number(self, path: str) -> Number:
        """The number of a path; a KeyError if there is none."""
        return {number.path: number for number in self.numbers}[path]


# --- JSON ------------------------------------------------------------------------------------------------------------

_REPORT, _QUANTITY = TypeAdapter(Report), TypeAdapter(Quantity)


def to_json(report: Report) -> str:
    """A report as JSON, on one line."""
    keys: dict[Quantity, str] = {}
    # not by `dump_json`, whose mode for infinite numbers depends on which class was used first
    data = _REPORT.dump_python(report, context=keys)
    for section, written in zip(report.sections, data.get("sections", ()), strict=True):
        kinds = [type(part).__name__.lower() for part in section.parts]
        written["parts"] = [{"part": kind, **part} for kind, part in zip(kinds, written["parts"], strict=True)]
    for note in data.get("notes", ()):
        note["part"] = "note"
    quantities = {key: _QUANTITY.dump_python(quantity) for quantity, key in keys.items()}
    whole = {"version": VERSION, "quantities": quantities, **data}
    return to_json_bytes(whole, inf_nan_mode="strings").decode()


def from_json(text: str | bytes) -> Report:
    """The report of `to_json`; a ValueError names the field of other JSON."""
    data = json.loads(text)
    known = data if isinstance(data, dict) else {"version": type(data).__name__}
    if known.get("version") != VERSION:
        command = known.get("study") or "…"
        raise ValueError(
            f"version: {known.get('version')}; expected a report of version {VERSION}, as `gough-stewart {command} "
            "--report` writes"
        )
    del data["version"]
    for note in data.get("notes", ()):
        note.pop("part", None)
    try:
        return _REPORT.validate_python(data, context=data.pop("quantities", {}))
    except ValidationError as error:
        first = error.errors()[0]
        raise ValueError(f"report.{'.'.join(map(str, first['loc']))}: {first['msg']}") from error


def schema() -> dict[str, Any]:
    """The JSON schema of a report's fields."""
    return _REPORT.json_schema()


def thinned(report: Report, points: int = POINTS) -> Report:
    """The same report for other programs: of a line at most so many points, of each interval the smallest and largest.

    Samples of members, of millions of numbers, are left out.
    """
    sections = []
    for section in report.sections:
        parts: list[Part] = []
        for part in section.parts:
            fewer = part
            if isinstance(part, Scene) and len(part.time) > FRAMES:
                kept = np.unique(np.linspace(0, len(part.time) - 1, FRAMES).astype(int))
                arrays = {name: row[kept] for name in ("time", *COLUMNS) if (row := getattr(part, name)) is not None}
                # what was on in any part of the time between two of the frames is on
                flags = tuple(
                    replace(flag, values="".join("01"["1" in flag.values[a:b]] for a, b in pairwise(kept)))
                    for flag in part.flags
                )
                fewer = replace(part, flags=flags, **arrays)
            elif isinstance(part, Chart):
                fewer = part if part.samples is None else replace(part, samples=None)
                is_line = part.kind in ("line", "step")
                if is_line and any(len(series.values) > points for series in part.series):
                    curves = []
                    for series in part.series:
                        x = part.x_of(series)
                        kept = decimated(np.arange(len(x), dtype=float), series.values, points)[0].astype(int)
                        known = {name: getattr(series, name) for name in ("values", "low", "high", "members")}
                        arrays = {name: array[kept] for name, array in known.items() if array is not None}
                        curves.append(replace(series, x=x[kept], of=len(x), **arrays))
                    # every series has abscissae of its own now
                    fewer = replace(fewer, x=replace(part.x, values=np.zeros(0)), series=tuple(curves))
            parts.append(fewer)
        sections.append(replace(section, parts=tuple(parts)))
    return replace(report, sections=tuple(sections))
