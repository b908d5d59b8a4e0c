"""CSV as instruments and spreadsheets write it: encodings, separators, decimal commas, comments, a row of units.

Everything becomes plain CSV columns of strings under one header; what could mean two things is refused.
"""

import re
from typing import TYPE_CHECKING

from gough_stewart.harness.errors import TableError
from gough_stewart.harness.heading import Heading
from gough_stewart.harness.quantities import UNITS

if TYPE_CHECKING:
    import polars

_SEPARATORS = (";", "\t", ",")
_COMMENT = "#"
_KNOWN_UNITS = {unit for units in UNITS.values() for unit in units} | {"-", ""}
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf)", re.IGNORECASE)


def text_of(content: bytes) -> str:
    """The text of a file: UTF-8, UTF-16 with its mark, or the code page 1252 of Windows.

    Raises
    ------
    TableError
        None of them.
    """
    try:
        if content.startswith((b"\xff\xfe", b"\xfe\xff")):
            return content.decode("utf-16")
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        pass
    try:
        return content.decode("cp1252")
    except UnicodeDecodeError as error:
        raise TableError(
            f"is not text: byte {error.start} is 0x{content[error.start]:02x}; expected CSV, best in UTF-8, or Parquet"
        ) from error


def columns_of(text: str) -> "polars.DataFrame":
    """The columns of CSV as strings, numbers with points; units of a second row are joined to the names, as "x [mm]".

    Blank rows, rows that begin with #, and blanks around names and values are left out. Columns are separated by
    semicolons or tabulators if the header has any, else by commas.

    Raises
    ------
    TableError
        Not CSV, or numbers with points and with commas.
    """
    import polars

    lines = [line for line in text.splitlines() if line.strip(" \t\r;,") and not line.lstrip().startswith(_COMMENT)]
    if not lines:
        raise TableError("has no rows; expected a header and rows of numbers")
    separator = next((mark for mark in _SEPARATORS if mark in lines[0]), ",")
    units = _row_of_units(lines, separator)
    if units is not None:
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
    if separator != ",":
        table = _with_points(table)
    if units is not None:
        table.columns = [_with_unit(name, unit) for name, unit in zip(names, units, strict=True)]
    return table


def _row_of_units(lines: list[str], separator: str) -> list[str] | None:
    """The units in the second row, without brackets; None if it is not one."""
    if len(lines) < 2:
        return None
    cells = [cell.strip().strip('"').strip("[]()").strip() for cell in lines[1].split(separator)]
    names = lines[0].split(separator)
    is_one = len(cells) == len(names) and any(cells) and all(cell in _KNOWN_UNITS for cell in cells)
    return [cell if cell != "-" else "" for cell in cells] if is_one else None


def _with_unit(name: str, unit: str) -> str:
    """A name with the unit of the second row."""
    own = Heading.of(name).unit
    if own is None or not unit:
        return f"{name} [{unit}]" if unit else name
    if own == unit:
        return name
    raise TableError(f"the column {name} has the unit {unit} in the second row; expected one of the two")


def _with_points(table: "polars.DataFrame") -> "polars.DataFrame":
    """Decimal commas as points, where commas do not separate columns."""
    import polars

    for name in table.columns:
        values = [value for value in table[name].to_list() if value and _NUMBER.fullmatch(value.replace(".", ""))]
        commas = next((value for value in values if _DECIMAL_COMMA.fullmatch(value)), None)
        points = next((value for value in values if "." in value), None)
        if commas is not None and points is not None:
            raise TableError(
                f"the column {name} has {commas} and {points}; expected one decimal mark, and no marks of thousands"
            )
        if commas is not None:
            table = table.with_columns(polars.col(name).str.replace(",", ".", literal=True))
    return table
