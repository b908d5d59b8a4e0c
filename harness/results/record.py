"""Records of runs as tables: one row per time, SI units, interface variables under their FMI 2.0 names; their files."""

import json
from dataclasses import dataclass
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import polars

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.polars_paths import read_parquet, readable, write_to
from gough_stewart.harness.results.record_data import RecordData
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
_MOST = 5


@dataclass(frozen=True, repr=False)
class Record(RecordData):
    """The record of a run: its rows, and metadata on how it was made.

    Columns are `time`, every input, output and local variable of the interface (`position[1]`, `actuator_force[6]`, …),
    and, with a prefix, signals from outside the plant:

    - `reference.` the reference pose, its rates, and the leg lengths and velocities that belong to it;
    - `error.` reference minus actual (`position`, `leg_length`), and the rotation vector from the actual `orientation`
      to the reference, about the world's axes;
    - `measured.` the controller's inputs at its last sample, and `controller.` its results: `force` before any limit,
      the `feedforward` part of it, `state`;
    - `flag.` booleans per leg: `force_limited`, `rate_limited`, `stroke_exceeded`; of faults, if there are any,
      `force_cut`, and per element of a signal `frozen_leg_length`, `frozen_position`, …

    Parameters of the machine that change have a column under their names.
    """

    def __repr__(self) -> str:
        """Title, run settings, size and peak errors, in a few lines."""
        from gough_stewart.harness.results.display import record_text

        return record_text(self)

    def _repr_html_(self) -> str:
        """In a notebook: the same with metrics and the pose over time."""
        from gough_stewart.harness.results.display import record_html

        return record_html(self, self.report)

    def report(
        self, *, measured: "Metrics | None" = None, robustness: "Robustness | None" = None, charts: bool = True
    ) -> "Report":
        """What the run found: whether it follows its reference, what it uses of the drives, when it settles.

        Parameters
        ----------
        measured
            Its metrics, if they are known already.
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

        return report_of_run(
            self, machine_of(self), platform_of(self), measured=measured, robustness=robustness, charts=charts
        )

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
        if isinstance(file, Path):
            write_to(file, self.table.write_csv)
        else:
            self.table.write_csv(file)

    def write_parquet(self, file: Path | BytesIO) -> None:
        """Write Parquet to a file without holding all of it in memory."""
        try:
            write = partial(self.table.write_parquet, metadata={_METADATA_KEY: _json(self.metadata)})
            write_to(file, write) if isinstance(file, Path) else write(file)
        except polars.exceptions.PolarsError as error:  # raised by polars when the disk is full
            raise OSError(None, str(error)) from error

    def to_metadata(self) -> bytes:
        """The metadata as readable JSON."""
        return (_json(self.metadata, indent=2) + "\n").encode()


def read_record(path: Path | str) -> Record:
    """Read a record from `record.parquet`, from `record.csv` with `metadata.json` beside it, or from their folder.

    Returns
    -------
    Record
        The table and its metadata, as `run` returned them.

    Raises
    ------
    RecordError
        The file, or its `metadata.json`, is missing or is not from a record.

    Examples
    --------
    >>> files = gs.save_record(gs.run("heave_step", {"loop.duration": 0.1}), "results/heave")
    >>> gs.read_record("results/heave")["error.position"].shape
    """
    from gough_stewart.harness.results.record_checks import check_metadata, check_table

    path = Path(path)
    expected = "expected record.parquet, or record.csv with metadata.json beside it, as `gough-stewart run` writes them"
    if path.is_dir():
        found = [path / name for name in ("record.parquet", "record.csv") if (path / name).is_file()]
        if not found:
            raise RecordError(f"{path}: the folder has no record; {contents(path)}; {expected}")
        path = found[0]
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
        check_metadata(record.metadata)
        check_table(record.table, record.metadata.get("rows"))
    except RecordError as error:
        raise RecordError(f"{path}: {error}; {expected}") from None
    except OSError as error:
        raise RecordError(f"{error.filename or path}: {error.strerror or error}; {expected}") from error
    except (ValueError, RecursionError, polars.exceptions.PolarsError) as error:
        reason = str(error).splitlines()[0]
        raise RecordError(f"{path}: cannot be read as a record ({reason}); {expected}") from error
    return record


def columns(prefix: str, size: int) -> list[str]:
    """Names of a vector's columns, 1-based."""
    return [f"{prefix}[{k + 1}]" for k in range(size)]


def plain(platform: Platform) -> dict[str, Any]:
    """A platform in plain types, as stored in metadata."""
    return {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in platform.as_dict().items()}


def platform_of(record: Record) -> Platform:
    """The nominal platform of a run, which its controller was designed for, from the metadata.

    Raises
    ------
    RecordError
        The metadata have no platform.
    """
    return _platform_of(record, "platform")


def machine_of(record: Record) -> Platform:
    """The platform that was simulated, from the metadata of a run; the nominal one if they have only that.

    Raises
    ------
    RecordError
        The metadata have no platform.
    """
    return _platform_of(record, "machine" if "machine" in record.metadata else "platform")


def _platform_of(record: Record, key: str) -> Platform:
    try:
        return Platform(**record.metadata[key])
    except (KeyError, TypeError) as error:
        raise RecordError(
            f"the metadata have no platform ({error}); expected what `gough-stewart run` writes"
        ) from error


def _json(data: dict[str, Any], indent: int | None = None) -> str:
    return json.dumps(data, indent=indent, ensure_ascii=False, allow_nan=False)


def contents(folder: Path) -> str:
    """What a folder has, as far as it is known, and a remedy."""
    for name, what, remedy in _KINDS:
        if (folder / name).is_file():
            return f"it has {what}; {remedy}"
    names = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
    for ending, what in _ENDINGS:
        if any(name.endswith(ending) for name in names):
            return f"it has {what}: {_listed([name for name in names if name.endswith(ending)])}"
    inside = [path.parent.name for path in sorted(folder.glob("*/record.parquet"))]
    if inside:
        return f"it has folders of records: {_listed(inside)}; view one of them"
    return f"it has {_listed(names)}" if names else "it is empty"


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _MOST} more" if len(names) > _MOST else ""
    return ", ".join(names[:_MOST]) + more
