"""Checks that a table and metadata read from files can be the record of a run."""

from typing import Any

import polars
from pydantic import BaseModel, ConfigDict, ValidationError

from gough_stewart.harness.errors import RecordError
from gough_stewart.model import interface

_Table = dict[str, Any]
# Sizes of the vectors that figures and metrics use, to detect missing elements.
_SIZES = {
    **{variable.name: variable.size for variable in (*interface.INPUTS, *interface.RESULTS) if variable.shape},
    **{f"{prefix}.{v.name}": v.size for prefix in ("reference", "error") for v in interface.RESULTS if v.shape},
    **{f"flag.{name}": 6 for name in ("force_limited", "rate_limited", "stroke_exceeded")},
}


class _Part(BaseModel):
    """Types of known keys; other keys are allowed."""

    model_config = ConfigDict(extra="allow", strict=True, allow_inf_nan=False)


class _Outcome(_Part):
    status: str
    time: float
    cause: str | None = None


class _Experiment(_Part):
    description: str = ""
    reference: _Table | None = None
    controller: _Table | None = None
    loop: _Table | None = None
    sensors: _Table | None = None
    actuators: _Table | None = None
    limits: _Table | None = None
    start: _Table | None = None
    change: list[_Table] | None = None
    disturbance: list[_Table] | None = None


class _Metadata(_Part):
    title: str = ""
    plant: str | None = None
    rows: int | None = None
    outcome: _Outcome | None = None
    duration: float | None = None
    sample_time: float | None = None
    plant_step: float | None = None
    force_limit: float | None = None
    platform: _Table | None = None
    experiment: _Experiment | None = None
    versions: _Table = {}
    files: dict[str, str] = {}
    replaced: list[str] = []
    settings: dict[str, _Table] = {}


def check_metadata(metadata: Any) -> None:
    """Refuse metadata with a value of another type than `gough-stewart run` writes.

    Raises
    ------
    RecordError
        Names the key and the expected type.
    """
    if not isinstance(metadata, dict):
        raise RecordError("has no metadata of a run")
    try:
        _Metadata.model_validate(metadata)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(step) for step in first["loc"])
        raise RecordError(
            f"metadata: {where} is {first['input']!r:.60}; {first['msg'][:1].lower()}{first['msg'][1:]}"
        ) from None


def check_table(table: polars.DataFrame, rows: int | None) -> None:
    """Refuse a table that cannot be a whole run with this number of rows (None: unknown).

    Raises
    ------
    RecordError
        A column or row is missing or wrong; the message names it.
    """
    if "time" not in table.columns:
        raise RecordError("has no column 'time'; expected one with the times of the rows")
    if not table.height:
        raise RecordError("has no rows; expected at least one")
    for name, kind in table.schema.items():
        column = table[name]
        if kind == polars.String:
            row = int(column.cast(polars.Float64, strict=False).is_null().arg_max() or 0)
            raise RecordError(f"{name} in row {row + 1} is {column[row]!r}; expected a number")
        if not (kind.is_numeric() or kind == polars.Boolean):
            raise RecordError(f"{name} has type {kind}; expected numbers")
        if column.null_count():
            raise RecordError(f"{name} in row {int(column.is_null().arg_max() or 0) + 1} is empty; expected a number")
    for name, size in _SIZES.items():
        found = sum(column.startswith(f"{name}[") for column in table.columns)
        if found not in (0, size):
            raise RecordError(f"has {found} columns of {name}; expected {size}")
    if rows is not None and table.height != rows:
        raise RecordError(
            f"has {table.height} rows, but the run had {rows}; the file is incomplete or from another run"
        )
    time = table["time"].cast(polars.Float64)
    wrong = ~(time.is_finite() & (time.diff().fill_null(1.0) > 0))
    if wrong.any():
        row = int(wrong.arg_max() or 0)
        raise RecordError(f"time in row {row + 1} is {time[row]}; expected finite, increasing times")
