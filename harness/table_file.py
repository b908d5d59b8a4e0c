"""Tables of numbers from CSV and Parquet files, as instruments and spreadsheets write them.

Of CSV: encodings, separators, decimal commas, comments, a row of units; what could mean two things is refused. Headings
have a name, and a unit in brackets, as in "leg_length[1] [mm]" or "time (ms)".

Paths that are not UTF-8, which Polars refuses, go through memory: the surrogates that stand for bytes of other
encodings are not printable. Interrupts are held back until Polars has ended, since a `KeyboardInterrupt` in one of the
Python functions that it calls from Rust becomes a panic.
"""

import math
import re
import warnings
from collections.abc import Callable, Mapping
from datetime import datetime
from importlib.resources.abc import Traversable
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.errors import TableError
from gough_stewart.model.process.progress import interrupts_held_back
from gough_stewart.model.units import UNITS, unit_typed
from gough_stewart.model.vectors import FloatArray

if TYPE_CHECKING:
    import polars

_SEPARATORS = (";", "\t", ",")
_COMMENT = "#"
_KNOWN_UNITS = {unit for units in UNITS.values() for unit in units} | {"-", ""}
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf)", re.IGNORECASE)
_WITH_UNIT = re.compile(r"(.*?)(\s*)[\[(]([^\[\]()]*)[\])]")
# Numbers that are seconds since 1970: from 2001 to 2096.
_EPOCH = (1e9, 4e9)
# Date and time, the fraction of a second, the zone.
_DATE = re.compile(r"(\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d)(?:[.,](\d+))?\s*(Z|[+-]\d\d:?\d\d)?$")
_INDEX = re.compile(r"\d+(,\d+)*")


class Heading(NamedTuple):
    """A heading in its parts."""

    column: str  # as in the file
    name: str
    unit: str | None

    @classmethod
    def of(cls, column: str) -> "Heading":
        """Split a heading; "position[1]" is a name with an index, "qx [1]" has the unit 1."""
        parts = _WITH_UNIT.fullmatch(column.strip())
        if parts is None or (_INDEX.fullmatch(parts[3]) and not parts[2]):
            return cls(column, column.strip(), None)
        return cls(column, parts[1], parts[3].strip())

    def factor(self, units: Mapping[str, float]) -> float:
        """What converts the column to the first of these units, each with its factor; 1 without a unit."""
        if self.unit is None:
            return 1.0
        unit = unit_typed(self.unit)
        if unit not in units:
            names = ", ".join(unit for unit in units if unit)
            raise ValueError(f"{self.column} has the unit '{self.unit}'; expected one of {names}")
        return units[unit]


def read_table(path: Path | Traversable, what: str) -> "polars.DataFrame":
    """The table of a file, a `what` in messages, such as "log": of CSV as strings, of Parquet with its own types."""
    import polars  # slow to import, and the schema of experiments uses this module without it

    try:
        content = path.read_bytes()
    except OSError as error:
        raise TableError(f"cannot read this {what}: {error.strerror or error}") from error
    if content.startswith(b"PAR1"):
        try:
            return read_parquet(BytesIO(content))
        except (polars.exceptions.PolarsError, OSError) as error:
            raise TableError(f"is not Parquet: {str(error).splitlines()[0]}") from error
    # UTF-8, UTF-16 with its mark, or the code page 1252 of Windows
    is_utf16 = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    for encoding in ("utf-16" if is_utf16 else "utf-8-sig", "cp1252"):
        try:
            return _columns_of(content.decode(encoding))
        except UnicodeDecodeError as error:
            where = error.start
    raise TableError(f"is not text: byte {where} is 0x{content[where]:02x}; expected CSV, best in UTF-8, or Parquet")


def numbers_of(table: "polars.DataFrame", name: str, remedy: str = "", *, gaps: bool = False) -> FloatArray:
    """A column as numbers (n,), with `gaps` NaN where it is empty or "nan"; a `TableError` ends with the remedy."""
    import polars

    if f"{name}_duplicated_0" in table.columns:
        raise TableError(f"has the column {name} twice; expected every column once")
    column = table[name]
    if not (column.dtype.is_numeric() or column.dtype == polars.String):
        raise TableError(f"{name} has values of the type {column.dtype}; expected numbers")
    numbers = column.cast(polars.Float64, strict=False)
    if gaps:
        empty = column.is_null() | (column.cast(polars.String).str.to_lowercase().is_in(["", "nan"]))
        filled = column.zip_with(~empty, polars.zeros(len(column), eager=True).cast(column.dtype))
        return np.where(empty, np.nan, numbers_of(table.with_columns(filled), name, remedy))
    bad = [k for k, value in enumerate(numbers) if value is None or not math.isfinite(value)]
    if bad:
        value = column[bad[0]]
        remedy = ", with a point, not a comma" if isinstance(value, str) and "," in value else remedy
        more = f", and {len(bad) - 1} more in this column" if len(bad) > 1 else ""
        raise TableError(f"{name} in row {bad[0] + 1} is {value!r}{more}; expected a finite number{remedy}")
    return np.array(numbers.to_numpy(), dtype=float)


def times_of(table: "polars.DataFrame", name: str, remedy: str = "") -> tuple[float, FloatArray]:
    """A column of times as its first number and the times (n,) since then.

    Integers are subtracted as integers: nanoseconds since 1970 have more digits than a floating-point number. Dates and
    times by ISO 8601, such as 2024-05-01T12:00:00.25Z, are in seconds since 1970; without a zone they are UTC.
    """
    import polars

    if has_dates(table, name):
        moments = table[name].to_list() if table[name].dtype == polars.String else table[name].dt.epoch("ns").to_list()
        nanoseconds = []  # since 1970
        for k, moment in enumerate(moments):
            if isinstance(moment, int):
                nanoseconds.append(moment)
                continue
            parts = _DATE.match(moment or "")
            date, fraction, zone = ("", "", "") if parts is None else parts.groups(default="")
            try:
                whole = datetime.fromisoformat(f"{date}{zone or 'Z'}")
            except ValueError:
                raise TableError(
                    f"{name} in row {k + 1} is {moment!r}; expected a date and time as 2024-05-01T12:00:00.25Z"
                ) from None
            nanoseconds.append(round(whole.timestamp()) * 10**9 + int(fraction.ljust(9, "0")[:9] or 0))
        return nanoseconds[0] / 1e9, np.array([moment - nanoseconds[0] for moment in nanoseconds], dtype=float) / 1e9
    numbers = numbers_of(table, name, remedy)
    integers = table[name].cast(polars.Int64, strict=False)
    is_exact = len(integers) and not (integers.null_count() or table[name].dtype.is_float())
    since = (integers - integers[0]).to_numpy().astype(float) if is_exact else numbers - numbers[:1]
    return (float(numbers[0]) if len(numbers) else 0.0), since


def has_dates(table: "polars.DataFrame", name: str) -> bool:
    """Whether a column of times has dates, as its first value tells."""
    import polars

    column = table[name]
    is_text = column.dtype == polars.String and len(column) and _DATE.match(column[0] or "")
    return bool(is_text) or isinstance(column.dtype, polars.Datetime)


def timestamps_of(table: "polars.DataFrame") -> set[str]:
    """The columns that need no unit as times: with dates, or without a unit and numbers of seconds since 1970."""
    import polars

    found = {name for name in table.columns if has_dates(table, name)}
    for name in set(table.columns) - found:
        first = table[name].head(1).cast(polars.Float64, strict=False).to_list()
        if Heading.of(name).unit is None and first and first[0] is not None and _EPOCH[0] <= first[0] < _EPOCH[1]:
            found.add(name)
    return found


def without_repeated_rows(since: FloatArray, values: FloatArray, first: float = 0.0) -> NDArray[np.intp]:
    """The rows to keep of times (n,) [s] since a first one and values (n, m): not those that repeat the row before.

    Two rows of one time with different values are refused.
    """
    if not since.size:
        raise TableError("has a header, and no rows below it")
    same_time = np.diff(since) == 0
    differ = ~((values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))).all(axis=1)
    contradicting = np.flatnonzero(same_time & differ)
    if contradicting.size:
        k = int(contradicting[0])
        raise TableError(
            f"time goes from {first + since[k]:g} to {first + since[k]:g} s in row {k + 2}, with other values; "
            "expected increasing times"
        )
    kept = np.concatenate([[0], np.flatnonzero(~same_time) + 1])
    if len(kept) < len(since):
        dropped = np.flatnonzero(same_time) + 2
        rows = (
            f"row {dropped[0]} repeats" if len(dropped) == 1 else f"{len(dropped)} rows, from {dropped[0]} on, repeat"
        )
        warnings.warn(f"{rows} the row before, with its time, and count once", stacklevel=3)
    return kept


def _columns_of(text: str) -> "polars.DataFrame":
    """The columns of CSV as strings, numbers with points; units of a second row are joined to the names, as "x [mm]".

    Blank rows, rows that begin with #, and blanks around names and values are left out. Columns are separated by
    semicolons or tabulators if the header has any, else by commas.
    """
    import polars

    lines = [line for line in text.splitlines() if line.strip(" \t\r;,") and not line.lstrip().startswith(_COMMENT)]
    if not lines:
        raise TableError("has no rows; expected a header and rows of numbers")
    separator = next((mark for mark in _SEPARATORS if mark in lines[0]), ",")
    # a second row of units, in brackets or without, "-" where there is none
    cells = [cell.strip().strip('"').strip("[]()").strip() for cell in "".join(lines[1:2]).split(separator)]
    n_columns = len(lines[0].split(separator))
    has_units = len(cells) == n_columns and any(cells) and all(cell in _KNOWN_UNITS for cell in cells)
    if has_units:
        lines.pop(1)
    try:
        # as strings, so that "true" is not read as a number
        table = polars.read_csv("\n".join(lines).encode(), infer_schema=False, separator=separator)
    except polars.exceptions.PolarsError as error:
        raise TableError(
            f"is not CSV: {str(error).splitlines()[0]}; expected one header, then as many values in every row"
        ) from error
    names = [name.strip() for name in table.columns]
    twice = next((name for k, name in enumerate(names) if name in names[:k]), None)
    if twice is not None:
        raise TableError(f"has the column {twice} twice; expected every column once")
    table.columns = names
    table = table.with_columns(polars.all().str.strip_chars())

    # decimal commas as points, where commas do not separate columns
    for name in names if separator != "," else ():
        values = [value for value in table[name].to_list() if value and _NUMBER.fullmatch(value.replace(".", ""))]
        commas = next((value for value in values if _DECIMAL_COMMA.fullmatch(value)), None)
        points = next((value for value in values if "." in value), None)
        if commas is not None and points is not None:
            raise TableError(
                f"the column {name} has {commas} and {points}; expected one decimal mark, and no marks of thousands"
            )
        if commas is not None:
            table = table.with_columns(polars.col(name).str.replace(",", ".", literal=True))

    if has_units:
        for k, (name, unit) in enumerate(zip(names, cells, strict=True)):
            heading_unit, is_stated = Heading.of(name).unit, unit not in ("", "-")
            if heading_unit is None and is_stated:
                names[k] = f"{name} [{unit}]"
            elif is_stated and heading_unit != unit:
                raise TableError(f"the column {name} has the unit {unit} in the second row; expected one of the two")
        table.columns = names
    return table


def readable(path: Path) -> Path | BytesIO:
    """What Polars reads a file from."""
    return path if str(path).isprintable() else BytesIO(path.read_bytes())


@interrupts_held_back()
def read_parquet(path: Path | BytesIO) -> "polars.DataFrame":
    """The table in a Parquet file; `*` and `[1]` are parts of a name."""
    import polars

    return polars.read_parquet(path if isinstance(path, BytesIO) else readable(path), glob=False)


@interrupts_held_back()
def scan_parquet(path: Path) -> "polars.LazyFrame":
    """The table in a Parquet file as a lazy frame, whose columns are read when they are used."""
    import polars

    return polars.scan_parquet(readable(path), glob=False)


@interrupts_held_back()
def write_to(path: Path | BytesIO, write: Callable[[Path | BytesIO], None]) -> None:
    """Let Polars write a file, or into memory."""
    if isinstance(path, BytesIO) or str(path).isprintable():
        write(path)
        return
    content = BytesIO()
    write(content)
    path.write_bytes(content.getvalue())
