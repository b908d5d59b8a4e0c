"""Tables of numbers from CSV and Parquet files."""

import math
from importlib.resources.abc import Traversable
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gough_stewart.harness.errors import TableError
from gough_stewart.harness.polars_paths import read_parquet
from gough_stewart.harness.table_text import columns_of, text_of
from gough_stewart.model.vectors import FloatArray

if TYPE_CHECKING:
    import polars


def read_table(path: Path | Traversable, what: str) -> "polars.DataFrame":
    """The table of a file: of CSV as strings, of Parquet with its own types.

    Parameters
    ----------
    what
        The kind of file for messages: "reference", "log".

    Raises
    ------
    TableError
        The file cannot be read, or is neither CSV nor Parquet.
    """
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
    return columns_of(text_of(content))


def numbers_of(table: "polars.DataFrame", name: str, remedy: str = "") -> FloatArray:
    """A column as numbers (n,); `remedy` ends the message for non-numeric values.

    Raises
    ------
    TableError
        The column appears twice, or has values that are not finite numbers; names the first row, counted from 1.
    """
    import polars

    if f"{name}_duplicated_0" in table.columns:
        raise TableError(f"has the column {name} twice; expected every column once")
    column = table[name]
    if not (column.dtype.is_numeric() or column.dtype == polars.String):
        raise TableError(f"{name} has values of the type {column.dtype}; expected numbers")
    numbers = column.cast(polars.Float64, strict=False)
    bad = [k for k, value in enumerate(numbers) if value is None or not math.isfinite(value)]
    if bad:
        found = column[bad[0]]
        remedy = ", with a point, not a comma" if isinstance(found, str) and "," in found else remedy
        more = f", and {len(bad) - 1} more in this column" if len(bad) > 1 else ""
        raise TableError(f"{name} in row {bad[0] + 1} is {found!r}{more}; expected a finite number{remedy}")
    return np.array(numbers.to_numpy(), dtype=float)


def times_of(table: "polars.DataFrame", name: str) -> tuple[float, FloatArray]:
    """A column of times as its first number and the times (n,) since then.

    Integers are subtracted as integers: nanoseconds since 1970 have more digits than a floating-point number.

    Raises
    ------
    TableError
        As `numbers_of`.
    """
    import polars

    numbers = numbers_of(table, name)
    whole = table[name].cast(polars.Int64, strict=False)
    is_whole = not (whole.null_count() or table[name].dtype.is_float())
    since = (whole - whole[0]).to_numpy().astype(float) if is_whole and len(whole) else numbers - numbers[:1]
    return (float(numbers[0]) if len(numbers) else 0.0), since
