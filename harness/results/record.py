"""Records of runs as tables: one row per time, SI units, interface variables under their FMI 2.0 names; their files."""

import base64
import html
import json
from dataclasses import dataclass, replace
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import polars
from pydantic import BaseModel, ConfigDict, ValidationError, WrapValidator

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.report.document import Cell, Column, Table, Value
from gough_stewart.harness.report.quantities import ANGLE, LENGTH, TIME, fine, fineness_of
from gough_stewart.harness.results.oscillation import oscillation, outcome_text
from gough_stewart.harness.results.record_data import RecordData
from gough_stewart.harness.section import readable_json
from gough_stewart.harness.table_file import read_parquet, readable, write_to
from gough_stewart.model import interface
from gough_stewart.model.platform import Platform

if TYPE_CHECKING:
    from gough_stewart.harness.report.document import Report
    from gough_stewart.harness.results.metrics import Metrics
    from gough_stewart.harness.results.run_report import Robustness

_METADATA_KEY = "gough_stewart"
# The first of these files that is there tells the kind.
_KINDS: tuple[tuple[str, str, str], ...] = (
    ("differences.parquet", "two ensembles compared by `ensemble --compare`", "`gough-stewart view` it"),
    ("plan.json", "an unfinished ensemble", "continue it with `gough-stewart ensemble … --resume`"),
    ("ensemble.json", "an ensemble", "`gough-stewart view` it, or worst/member-…"),
    ("tuning.json", "a tuning", "run tuned.toml, then view that run"),
    ("workspace.csv", "a workspace", "`gough-stewart view` it"),
    ("estimate.json", "an identification", "`gough-stewart view` it"),
    ("excitation.toml", "an excitation", "run excitation.toml, then view that run"),
    ("check.json", "a motion check", "`gough-stewart view` it"),
    ("margins.json", "margins", "`gough-stewart view` it"),
    ("frf.csv", "a frequency response", "`gough-stewart view` it, or its record"),
    ("open_loop.csv", "the paper's case", "open report.html, which `reproduce --report` writes, in a browser"),
    ("report.html", "a page", "open report.html in a browser"),
)
_ENDINGS = ((".fmu", "FMUs"), (".ssp", "an exported loop"), (".c", "an exported controller"), (".toml", "TOML files"))
# Names of files that are told at most.
_MOST = 5
# What metrics and picture in a notebook need.
_MEASURED = ("position", "orientation", "leg_length", "leg_velocity", "actuator_force")
_Table = dict[str, Any]
# Sizes of the vectors that figures and metrics use, to detect missing elements.
_SIZES = {
    **{variable.name: variable.size for variable in (*interface.INPUTS, *interface.RESULTS) if variable.shape},
    **{f"{prefix}.{v.name}": v.size for prefix in ("reference", "error") for v in interface.RESULTS if v.shape},
    **{f"flag.{name}": 6 for name in ("force_limited", "rate_limited", "stroke_exceeded")},
}


class _KnownKeys(BaseModel):
    """Types of known keys; other keys are allowed."""

    model_config = ConfigDict(extra="allow", strict=True, allow_inf_nan=False)


class _Outcome(_KnownKeys):
    status: str
    time: float
    cause: str | None = None


class _Experiment(_KnownKeys):
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


class _Metadata(_KnownKeys):
    title: str = ""
    plant: str | None = None
    rows: int | None = None
    outcome: _Outcome | None = None
    duration: float | None = None
    sample_time: float | None = None
    plant_step: float | None = None
    # one for all legs, or six
    force_limit: Annotated[
        float | None,
        WrapValidator(lambda value, number: list(map(number, value)) if isinstance(value, list) else number(value)),
    ] = None
    platform: _Table | None = None
    experiment: _Experiment | None = None
    versions: _Table = {}
    files: dict[str, str] = {}
    replaced: list[str] = []
    settings: dict[str, _Table] = {}


@dataclass(frozen=True, repr=False)
class Record(RecordData):
    """The record of a run: its rows, and metadata on how they were produced.

    Columns are `time`, every input, output and local variable of the interface (`position[1]`, `actuator_force[6]`, …),
    and, with a prefix, signals from outside the plant:

    - `reference.` the reference pose, its rates, and the leg lengths and velocities that belong to it;
    - `error.` reference minus actual (`position`, `leg_length`), and the rotation vector from the actual `orientation`
      to the reference, about the world's axes;
    - `measured.` the controller's inputs at its last sample, and `controller.` its results: `force` before any limit,
      the `feedforward` part of it, `state`;
    - `flag.` booleans per leg: `force_limited`, `rate_limited`, `stroke_exceeded`; `manual`, while the controller is
      off; of faults, if there are any, `force_cut`, and per element of a signal `frozen_leg_length`, …

    Parameters of the machine that change have a column under their names.
    """

    def __repr__(self) -> str:
        """Title, run settings, size and peak errors, in a few lines."""
        table = _circumstances(self)
        rows = [table.texts(k) for k in range(len(table.rows))]
        width = max(len(name) for name, _ in rows)
        return "\n".join([table.title, *(f"  {name:{width}}  {text}" for name, text in rows)])

    def _repr_html_(self) -> str:
        """In a notebook: the same as a table; with metrics and the pose over time if it has the columns they need."""
        from gough_stewart.harness.report.figures import figures  # slow to import
        from gough_stewart.harness.report.page import table_to_html
        from gough_stewart.harness.results.metrics import metrics, metrics_tables

        parts = [table_to_html(_circumstances(self))]
        is_whole = {"outcome", "platform"} <= self.metadata.keys() and all(name in self for name in _MEASURED)
        if is_whole and self.table.height:
            parts += map(table_to_html, metrics_tables(metrics(self)))
            picture = base64.b64encode(figures(self.report(), ("png",), "pose").get("pose.png", b"")).decode()
            title = html.escape(str(self.metadata.get("title", "untitled")), quote=True)
            parts.append(f'<img alt="pose over time: {title}" width="800" src="data:image/png;base64,{picture}">')
        return f"<div>{''.join(parts)}</div>"

    def report(
        self, *, measured: "Metrics | None" = None, robustness: "Robustness | None" = None, charts: bool = True
    ) -> "Report":
        """Report whether the platform follows its reference, how much of the actuators it uses, and when it settles.

        Parameters
        ----------
        measured
            Its metrics, if already computed.
        robustness
            The disk margin of its linear loop, if it is known.
        charts
            Also the signals over time and the platform in motion.

        Returns
        -------
        Report
            Verdict, numbers by the paths of `metrics`, tables, and charts.
        """
        from gough_stewart.harness.results.run_report import report_of_run

        machine, believed = platform_of(self, "machine"), platform_of(self)
        return report_of_run(self, machine, believed, measured=measured, robustness=robustness, charts=charts)

    def to_csv(self) -> bytes:
        """CSV; numbers have the fewest digits that read back to the same value."""
        buffer = BytesIO()
        self.write_csv(buffer)
        return buffer.getvalue()

    def to_parquet(self) -> bytes:
        """Parquet, with the metadata in it."""
        buffer = BytesIO()
        self.write_parquet(buffer)
        return buffer.getvalue()

    def write_csv(self, file: Path | BytesIO) -> None:
        """Write CSV to a file without holding all of it in memory."""
        write_to(file, self.table.write_csv)

    def write_parquet(self, file: Path | BytesIO) -> None:
        """Write Parquet to a file without holding all of it in memory."""
        text = json.dumps(self.metadata, ensure_ascii=False, allow_nan=False)
        try:
            write_to(file, partial(self.table.write_parquet, metadata={_METADATA_KEY: text}))
        except polars.exceptions.PolarsError as error:  # raised by polars when the disk is full
            raise OSError(None, str(error)) from error

    def to_metadata(self) -> bytes:
        """The metadata as readable JSON."""
        return readable_json(self.metadata)


def read_record(path: Path | str) -> Record:
    """Read a record from `record.parquet`, from `record.csv` with `metadata.json` beside it, or from their folder.

    Parameters
    ----------
    path
        The file or folder.

    Returns
    -------
    Record
        The table and its metadata, as `run` returned them.

    Raises
    ------
    RecordError
        The file, or its `metadata.json`, is missing or is not from a record.

    See Also
    --------
    save_record, run, view

    Examples
    --------
    >>> files = gs.save_record(gs.run("heave_step", {"loop.duration": 0.1}), "results/heave")
    >>> gs.read_record("results/heave")["error.position"].shape
    """
    path = Path(path)
    expected = "expected record.parquet, or record.csv with metadata.json beside it, as `gough-stewart run` writes them"
    if path.is_dir():
        files = [path / name for name in ("record.parquet", "record.csv") if (path / name).is_file()]
        if not files:
            raise RecordError(f"{path}: the folder has no record; {contents(path)}; {expected}")
        path = files[0]
    if not path.is_file():
        raise RecordError(f"{path}: no such file; {expected}")
    try:
        # no globbing: * and [1] are parts of a name
        if path.suffix == ".parquet":
            # a table from elsewhere has none
            text = polars.read_parquet_metadata(readable(path)).get(_METADATA_KEY, "null")
            record = Record(read_parquet(path), json.loads(text))
        else:
            # the first rows of a float column may all be integers
            table = polars.read_csv(readable(path), infer_schema_length=None, glob=False)
            record = Record(table, json.loads(path.with_name("metadata.json").read_bytes()))
        _check(record)
    except RecordError as error:
        raise RecordError(f"{path}: {error}; {expected}") from None
    except OSError as error:
        raise RecordError(f"{error.filename or path}: {error.strerror or error}; {expected}") from error
    except (ValueError, RecursionError, polars.exceptions.PolarsError) as error:
        reason = str(error).splitlines()[0]
        raise RecordError(f"{path}: cannot be read as a record ({reason}); {expected}") from error
    return record


def platform_of(record: RecordData, key: Literal["platform", "machine"] = "platform") -> Platform:
    """The nominal platform of a run, which its controller was designed for; or the machine, if it is another one."""
    try:
        return Platform(**record.metadata[key if key in record.metadata else "platform"])
    except (KeyError, TypeError) as error:
        missing = f"the metadata have no platform ({error})"
        raise RecordError(f"{missing}; expected what `gough-stewart run` writes") from error


def contents(folder: Path) -> str:
    """What a folder has, as far as it is known, and a remedy."""

    def some(names: list[str]) -> str:
        return ", ".join(names[:_MOST]) + (f" and {len(names) - _MOST} more" if len(names) > _MOST else "")

    for name, kind, remedy in _KINDS:
        if (folder / name).is_file():
            return f"it has {kind}; {remedy}"
    names = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
    for ending, kind in _ENDINGS:
        if any(name.endswith(ending) for name in names):
            return f"it has {kind}: {some([name for name in names if name.endswith(ending)])}"
    inside = [path.parent.name for path in sorted(folder.glob("*/record.parquet"))]
    if inside:
        return f"it has folders of records: {some(inside)}; view one of them"
    return f"it has {some(names)}" if names else "it is empty"


def _check(record: Record) -> None:
    """Refuse metadata with a value of another type than a run's, and a table that cannot be a whole run."""
    if not isinstance(record.metadata, dict):
        raise RecordError("has no metadata of a run")
    try:
        _Metadata.model_validate(record.metadata)
    except ValidationError as error:
        first = error.errors()[0]
        where, message = ".".join(map(str, first["loc"])), first["msg"]
        raise RecordError(f"metadata: {where} is {first['input']!r:.60}; {message[:1].lower()}{message[1:]}") from None
    table, rows = record.table, record.metadata.get("rows")
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
        count = sum(column.startswith(f"{name}[") for column in table.columns)
        if count not in (0, size):
            raise RecordError(f"has {count} columns of {name}; expected {size}")
    if rows is not None and table.height != rows:
        raise RecordError(
            f"has {table.height} rows, but the run had {rows}; the file is incomplete or from another run"
        )
    time = table["time"].cast(polars.Float64)
    wrong = ~(time.is_finite() & (time.diff().fill_null(1.0) > 0))
    if wrong.any():
        row = int(wrong.arg_max() or 0)
        raise RecordError(f"time in row {row + 1} is {time[row]}; expected finite, increasing times")


def _circumstances(record: Record) -> Table:
    """How the run was made, and its peak errors."""
    metadata = record.metadata
    # of a whole platform; a record from elsewhere may have a part of one
    machine = metadata.get("machine") or metadata.get("platform") or {}
    fineness = fineness_of(Platform(**machine)) if "base_points" in machine else 1.0
    rows: list[tuple[Cell, ...]] = []
    if "platform" in metadata:
        rows.append(("platform", str(metadata["platform"].get("name", "unnamed"))))
    if metadata.get("plant"):
        rows.append(("plant", str(metadata["plant"])))
    if "outcome" in metadata:
        motion = oscillation(record) if "platform" in metadata else None
        rows.append(("outcome", outcome_text(metadata["outcome"]) + (f"; {motion.text()}" if motion else "")))
    height, width = record.table.shape
    rows.append(("table", f"{height} rows, {width} columns"))
    if height and "time" in record:
        first, last = (replace(TIME, digits=6).text(float(record["time"][k]), unit=k < 0) for k in (0, -1))
        rows.append(("time", f"{first} to {last}"))
    for name, quantity in (("position", LENGTH), ("orientation", ANGLE), ("leg_length", LENGTH)):
        error = np.abs(record[f"error.{name}"]) if f"error.{name}" in record else np.zeros(0)
        finite = error[np.isfinite(error)]
        if finite.size:
            peak = Value(float(finite.max()), fine(quantity, fineness))
            rows.append((f"peak error of {name.replace('_', ' ')}", peak))
    return Table(f"Record: {metadata.get('title', 'untitled')}", (Column(""), Column("")), tuple(rows))
