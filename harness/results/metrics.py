"""Metrics of a run: tracking, step responses, forces, power and energy, saturation, stroke."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.loop.folding import Folding
from gough_stewart.harness.loop.folds import ERRORS, Block, Fold
from gough_stewart.harness.results.limits import column_of_drives
from gough_stewart.harness.results.metric_folds import METRICS, STROKE_EXCEEDED, Rows, metric_folds, metric_of
from gough_stewart.harness.results.outcome import outcome_of
from gough_stewart.harness.results.record_data import RecordData
from gough_stewart.model.vectors import FloatArray

# Rows of a record in a block.
_ROWS = 8192


class Metrics(dict[str, Any]):
    """Metrics by name: a dict that is displayed as tables, in a terminal and in a notebook."""

    def __str__(self) -> str:
        """The tables that `gough-stewart run` prints."""
        from gough_stewart.harness.report.terminal import tables_text
        from gough_stewart.harness.results.tables import metrics_tables

        return "\n".join([*self._remarks(), tables_text(metrics_tables(self))])

    def _repr_html_(self) -> str:
        from html import escape

        from gough_stewart.harness.report.notebook import table_to_html
        from gough_stewart.harness.results.tables import metrics_tables

        remarks = (f"<p><strong>{escape(each)}</strong></p>" for each in self._remarks())
        return "".join([*remarks, *map(table_to_html, metrics_tables(self))])

    def _remarks(self) -> list[str]:
        """The outcome, if the run did not complete, or its loop oscillates or grows."""
        from gough_stewart.harness.results.outcome import is_sound, outcome_text

        return [] if is_sound(self["outcome"]) else [outcome_text(self["outcome"])]


def metrics(record: RecordData) -> Metrics:
    """Compute metrics in SI units, as plain numbers, lists, and None where undefined; never NaN or infinite.

    Rows from the first one with values of the plant that are not finite are left out.

    - `outcome` from the metadata, with the `oscillation` or growth of a loop by itself, None if it comes to rest:
      `is_growing`, `leg`, `amplitude` and `earlier` [m], `frequency` [Hz], `since` [s].
    - `rows` and `duration` [s] that the metrics below cover.
    - `tracking`: `rms` and `peak` of the errors of `position` [m], `orientation` [rad] and `leg_length` [m] by axis or
      leg; for position and orientation also of the Euclidean `norm`, of orientation the angle of the rotation.
    - `step_response`: for each axis whose reference goes from one value to another and stays there. The response
      (y − from)/(to − from) starts at time `at` [s]: the row of a jump, or else the last row at which the reference has
      its first value.
      `overshoot_percent`, `rise_time` from 10 to 90 % [s], `settling_time` to 2 % [s], `final_error` [m, rad];
      None if it did not rise or settle within the record. Times are those of rows, not interpolated.
    - `force`: `peak` and `rms` of F by leg [N]. `power`: `peak` of |F·ṡ| by leg, with ṡ at both ends of each row,
      and `mean` [W]; s is the leg's length, of legs that give `motor_position`.
    - `energy`, by leg and in total: `net` = ∑ F_k (s_{k+1} − s_k), which is ∫ F·ṡ dt, and `absolute` =
      ∑ |F_k (s_{k+1} − s_k)|, which is ∫ |F·ṡ| dt unless a leg reverses within a row [J].
    - `saturation`: shares of the rows with `force_limited` and `rate_limited`, by leg and for `any` leg. The last row
      does not count here or in the RMS of the force: its force acts for no time.
    - `stroke`, by leg: the `shortest` and `longest` length [m]; the `margin` to the nearest limit of the platform [m],
      negative beyond it; `exceeded`, the share of the rows beyond.
    - `limits`: for `leg_velocity_max`, `actuator_force_max` and `actuator_power_max`, if the platform states them: the
      `limit`, the largest share `used` of it by leg [1], and when it was `first_exceeded` [s], None if never.

    A part is None if the record lacks its columns.

    Returns
    -------
    Metrics
        A dict of numbers, lists and dicts, ready for JSON, that displays itself as tables.

    Examples
    --------
    >>> found = gs.metrics(gs.run("heave_step", {"loop.duration": 1}))
    >>> print(found)
    >>> found["tracking"]["position"]["norm_peak"], found["step_response"][0]["rise_time"]
    """
    kept = finite_part(record)
    found: dict[str, Any] = {"outcome": outcome_of(record)}
    n = kept.table.height
    parts = dict[str, Any](_parts(kept) if n else {})
    steps = parts.pop("step_response", {})
    knows_steps = bool(n) and _reference(kept) is not None
    names = ("tracking", "step_response", "force", "power", "energy", "saturation", "stroke", "limits")
    found |= {"rows": n, "duration": parts.get("duration"), **{name: parts.get(name) for name in names}}
    found["step_response"] = [{"axis": axis, **part} for axis, part in steps.items()] if knows_steps else None
    if found["stroke"]:
        found["stroke"].setdefault("exceeded", None)
    return Metrics(found)


def _parts(record: RecordData) -> dict[str, Any]:
    """Metrics of a record of at least one row, nested by the parts of their paths."""
    limits, knows = record.metadata["platform"], lambda name: column_of_drives(record, name) in record
    folds = metric_folds(record["time"], _reference(record), limits, knows)
    results = _folded(record, folds)
    found = dict[str, Any]()
    for metric in METRICS:
        if metric.path not in results:
            continue
        *above, name = metric.path.split(".")
        part = found
        for each in above:
            part = part.setdefault(each, {})
        values = results[metric.path][..., 0]
        part[name] = [_number(value) for value in values] if values.ndim else _number(values)
    return found


def _folded(record: RecordData, folds: Sequence[Fold]) -> dict[str, FloatArray]:
    """Results of folds over the rows of a record, as over those of a run."""
    names = dict.fromkeys([*(name for fold in folds for name in fold.needs), STROKE_EXCEEDED])
    own = {name: column_of_drives(record, name) for name in names}
    columns = {name: _column(record, column) for name, column in own.items() if column in record}
    folding, n = Folding(folds, 1), record.table.height
    for first in range(0, n, _ROWS):
        last = min(first + _ROWS, n)
        # in the first block, any row stands for the one before
        before = slice(first - 1, last) if first else np.r_[0, :last]
        part = {name: values[before] for name, values in columns.items()}
        folding.add(Block(first, last - first, part, folding.running))
    return folding.results()


def _column(record: RecordData, name: str) -> NDArray[Any]:
    """A column (n, size, 1)."""
    values = record[name][:, :, None]
    return values.astype(bool) if name.startswith("flag.") else values


def _reference(record: RecordData) -> FloatArray | None:
    """The reference poses (n, 6), if the record has them."""
    names = ("reference.position", "reference.orientation")
    return np.hstack([record[name] for name in names]) if all(name in record for name in names) else None


def metrics_json(metrics: dict[str, Any]) -> bytes:
    """Readable JSON."""
    return (json.dumps(metrics, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()


def finite_part(record: RecordData) -> RecordData:
    """The rows before the first one with values of the plant that are not finite."""
    fine: NDArray[np.bool_] = np.ones(record.table.height, dtype=bool)
    for name in (*Rows.needs, *ERRORS, "reference.position", "reference.orientation"):
        if name in record:
            fine &= np.isfinite(record[name]).all(axis=1)
    rows = len(fine) if fine.all() else int(fine.argmin())
    return RecordData(record.table.head(rows), record.metadata)


def _number(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None


def flattened(metrics: Mapping[str, Any]) -> dict[str, float | None]:
    """Metrics by path, one number each: "tracking.position.norm_rms", "step_response.z.rise_time".

    A list by leg or axis is reduced to its largest value; `stroke.shortest` and `limits.….first_exceeded` to the least.
    Undefined metrics are None, also lists with an undefined element, except `first_exceeded`. The outcome is left out.
    """
    found: dict[str, float | None] = {}

    def add(path: str, value: Any) -> None:
        if isinstance(value, dict):
            for name, part in value.items():
                add(f"{path}.{name}" if path else name, part)
        elif isinstance(value, list):
            found[path] = _of_list(path, value)
        elif value is not None or "." in path:
            found[path] = value

    steps = {step["axis"]: {k: v for k, v in step.items() if k != "axis"} for step in metrics["step_response"] or ()}
    add("", {k: v for k, v in metrics.items() if k not in ("outcome", "step_response")})
    for axis, step in steps.items():
        for name, value in step.items():
            found[f"step_response.{axis}.{name}"] = value
    return found


def _of_list(path: str, values: list[float | None]) -> float | None:
    finite = [value for value in values if value is not None]
    if not finite or (len(finite) < len(values) and not path.endswith(".first_exceeded")):
        return None
    return min(finite) if metric_of(path).is_least else max(finite)
