"""Metrics of a run as numbers and as tables: tracking, step responses, forces, power, energy, saturation, stroke."""

from collections.abc import Mapping
from contextlib import suppress
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.fmu_build.cache import BuildError
from gough_stewart.harness.loop.folds import ERRORS
from gough_stewart.harness.loop.rows import Folding
from gough_stewart.harness.report.document import Cell, Column, Table, Value
from gough_stewart.harness.report.quantities import ANGLE, ENERGY, LENGTH, PERCENT, POSITION, SHARE, TIME, Quantity
from gough_stewart.harness.results.metric_folds import METRICS, CoveredRows, metric_folds, metric_kernels, metric_of
from gough_stewart.harness.results.oscillation import is_sound, oscillation, outcome_text
from gough_stewart.harness.results.record_data import RecordData, column_of_drives

_POSE = (("position", ("x", "y", "z"), LENGTH), ("orientation", ("roll", "pitch", "yaw"), ANGLE))


class Metrics(dict[str, Any]):
    """Metrics by name: a dict that is displayed as tables, in a terminal and in a notebook."""

    def __str__(self) -> str:
        """The tables that `gough-stewart run` prints."""
        from gough_stewart.harness.report.terminal import text_of

        return "\n".join([*self._remarks(), text_of(metrics_tables(self))])

    def _repr_html_(self) -> str:
        from gough_stewart.harness.report.page import table_to_html

        remarks = (f"<p><strong>{escape(text)}</strong></p>" for text in self._remarks())
        return "".join([*remarks, *map(table_to_html, metrics_tables(self))])

    def _remarks(self) -> list[str]:
        """The outcome, if the run did not complete, or its loop oscillates or grows."""
        return [] if is_sound(self["outcome"]) else [outcome_text(self["outcome"])]


def metrics(record: RecordData) -> Metrics:
    """Compute metrics in SI units, as plain numbers, lists, and None where undefined; never NaN or infinite.

    Rows from the first one with values of the plant that are not finite are left out.

    - `outcome` from the metadata, with the `oscillation` or growth of a loop without input, None if it comes to rest:
      `is_growing`, `leg`, `amplitude` and `earlier` [m], `frequency` [Hz], `since` [s].
    - `rows` and `duration` [s] that the metrics below cover.
    - `tracking`: `rms` and `peak` of the errors of `position` [m], `orientation` [rad] and `leg_length` [m] by axis or
      leg; for position and orientation also of the Euclidean `norm`, of orientation the angle of the rotation, and
      `norm_final`, its largest value in the last tenth of the run: what is left when a step has settled; None if the
      run ended early.
    - `step_response`: for each axis whose reference goes from one value to another and stays there. The response
      (y − from)/(to − from) starts at time `at` [s]: the row of a jump, or else the last row at which the reference has
      its first value.
      `overshoot_percent`, `rise_time` from 10 to 90 % [s], `settling_time` to 2 % [s], `final_error` [m, rad];
      None if it did not rise or settle within the record. Times are those of rows, not interpolated.
    - `force`: `peak` and `rms` of F by leg [N]. `power`: `peak` of |F·ṡ| by leg, with ṡ at both ends of each row,
      and `mean` [W]; s is the leg's length, of elastic legs `motor_position`.
    - `energy`, by leg and in total: `net` = ∑ F_k (s_{k+1} − s_k), which is ∫ F·ṡ dt, and `absolute` =
      ∑ |F_k (s_{k+1} − s_k)|, which is ∫ |F·ṡ| dt unless a leg reverses within a row [J].
    - `saturation`: shares of the rows with `force_limited` and `rate_limited`, by leg and for `any` leg. The last row
      does not count here or in the RMS of the force: its force acts for no time.
    - `stroke`, by leg: the `shortest` and `longest` length [m]; the `margin` to the nearest limit of the platform [m],
      negative beyond it; `exceeded`, the share of the rows beyond.
    - `limits`: for `leg_velocity_max`, `actuator_force_max` and `actuator_power_max`, if the platform states them: the
      `limit`, the largest share `used` of it by leg [1], and when it was `first_exceeded` [s], None if never.

    A part is None if the record lacks its columns.

    Parameters
    ----------
    record
        A `Record`, or the folder or file of one.

    Returns
    -------
    Metrics
        A dict of numbers, lists and dicts, ready for JSON, that displays itself as tables.

    Raises
    ------
    RecordError
        The record cannot be read.

    See Also
    --------
    run, check, view

    Examples
    --------
    >>> metrics = gs.metrics(gs.run("heave_step", {"loop.duration": 1}))
    >>> print(metrics)
    >>> metrics["tracking"]["position"]["norm_peak"], metrics["step_response"][0]["rise_time"]
    """
    finite = finite_part(record)
    n, poses = finite.table.height, ("reference.position", "reference.orientation")
    reference = np.hstack([finite[name] for name in poses]) if all(name in finite for name in poses) else None
    parts = dict[str, Any]()
    if n:
        time, planned = record["time"], record.metadata.get("duration") or 0.0
        folds = metric_folds(
            finite["time"],
            reference,
            finite.metadata["platform"],
            lambda name: column_of_drives(finite, name) in finite,
            is_whole=n == record.table.height and bool(time[-1] - time[0] >= planned * (1 - 1e-9)),
        )
        columns = dict[str, NDArray[Any]]()
        for name in dict.fromkeys(name for fold in folds for name in fold.needs):
            rows = finite[column_of_drives(finite, name)][:, :, None]
            rows = rows.astype(bool) if name.startswith("flag.") else rows
            columns[name] = np.concatenate([rows[:1], rows])  # any row stands for the one before the first
        kernels = None
        with suppress(BuildError, OSError):  # of a processor without machine code: NumPy computes the same, row by row
            kernels = metric_kernels()
        folding = Folding(folds, 1, kernels)
        folding.add(0, columns)
        results = folding.results()
        # nested by the parts of their paths
        for path in (metric.path for metric in METRICS if metric.path in results):
            *above, name = path.split(".")
            part = parts
            for key in above:
                part = part.setdefault(key, {})
            values = results[path][..., 0]
            part[name] = np.where(np.isfinite(values), values.astype(object), np.array(None)).tolist()
    steps = parts.pop("step_response", {})
    if n and reference is not None:
        parts["step_response"] = [{"axis": axis, **part} for axis, part in steps.items()]
    if "stroke" in parts:
        parts["stroke"].setdefault("exceeded", None)
    names = ("duration", "tracking", "step_response", "force", "power", "energy", "saturation", "stroke", "limits")
    motion = oscillation(record)
    outcome = {**record.metadata["outcome"], "oscillation": None if motion is None else motion._asdict()}
    return Metrics(outcome=outcome, rows=n, **{name: parts.get(name) for name in names})


def finite_part(record: RecordData) -> RecordData:
    """The rows before the first one with values of the plant that are not finite."""
    fine: NDArray[np.bool_] = np.ones(record.table.height, dtype=bool)
    for name in (*CoveredRows.needs, *ERRORS, "reference.position", "reference.orientation"):
        if name in record:
            fine &= np.isfinite(record[name]).all(axis=1)
    rows = len(fine) if fine.all() else int(fine.argmin())
    return RecordData(record.table.head(rows), record.metadata)


def flattened(metrics: Mapping[str, Any]) -> dict[str, float | None]:
    """Metrics by path, one number each: "tracking.position.norm_rms", "step_response.z.rise_time".

    A list by leg or axis is reduced to its largest value; `stroke.shortest` and `limits.….first_exceeded` to the least.
    Undefined metrics are None, also lists with an undefined element, except `first_exceeded`. The outcome is left out.
    """
    parts = [(name, part) for name, part in metrics.items() if name not in ("outcome", "step_response")]
    for step in metrics["step_response"] or ():
        parts += [(f"step_response.{step['axis']}.{name}", value) for name, value in step.items() if name != "axis"]
    flat = dict[str, float | None]()
    while parts:
        path, value = parts.pop(0)
        if isinstance(value, dict):
            parts[:0] = [(f"{path}.{name}", part) for name, part in value.items()]
        elif isinstance(value, list):
            numbers = [number for number in value if number is not None]
            is_defined = numbers and (len(numbers) == len(value) or path.endswith(".first_exceeded"))
            flat[path] = (min if metric_of(path).is_least else max)(numbers) if is_defined else None
        elif value is not None or "." in path:
            flat[path] = value
    return flat


def metrics_tables(metrics: Mapping[str, Any]) -> list[Table]:  # noqa: PLR0912 - a section for each table
    """Tables of tracking, step response and legs, where the record has their columns."""
    tables, tracking, rows = list[Table](), metrics["tracking"] or {}, list[tuple[Cell, ...]]()
    ends = []
    for name, axes, quantity in _POSE:
        if name not in tracking:
            continue
        part = tracking[name]
        for title, *values in zip(axes, part["rms"], part["peak"], strict=True):
            rows.append((title, *(Value(value, quantity) for value in values), ""))
        norms = (part[f"norm_{kind}"] for kind in ("rms", "peak", "final"))
        rows.append((f"|{name}|", *(Value(value, quantity) for value in norms)))
        ends.append(len(rows) - 1)
    if tracking:
        heads = (Column(""), Column("RMS"), Column("peak"), Column("at the end", None, "largest in the last tenth"))
        tables.append(Table("Tracking error", heads, tuple(rows), group_ends=tuple(ends[:-1])))
    rows = []
    for step in metrics["step_response"] or ():
        pose, error = (POSITION, LENGTH) if step["axis"] in "xyz" else (ANGLE, ANGLE)
        times = (step[key] for key in ("at", "overshoot_percent", "rise_time", "settling_time"))
        from_to = Value(step["from"], pose), Value(step["to"], pose)
        rows.append((step["axis"], *from_to, *times, Value(step["final_error"], error)))
    if rows:
        columns = (
            *(Column(""), Column("from"), Column("to"), Column("at", TIME), Column("overshoot", PERCENT)),
            Column("rise", TIME, "from 10 to 90 % of the step"),
            Column("settling", TIME, "until it stays within 2 % of the step"),
            Column("final error", None, "at the last row"),
        )
        note = (
            "The final error is that of the last row; errors at the end are the largest of the last tenth of the run."
        )
        tables.append(Table("Step response", columns, tuple(rows), note=note))
    if not metrics["force"]:
        return tables
    # by leg, and what stands under "all", if anything
    energy, stroke = metrics["energy"], metrics["stroke"] or {}
    by_leg = list[tuple[str, Quantity, list[float | None], Cell]]()
    for kind, title in (("rms", "RMS error"), ("peak", "peak error")) if "leg_length" in tracking else ():
        by_leg.append((title, LENGTH, tracking["leg_length"][kind], ""))
    by_leg += [(title, POSITION, stroke[title], "") for title in ("shortest", "longest") if stroke]
    for path in ("force.peak", "force.rms", "power.peak", "power.mean"):
        metric, (group, name) = metric_of(path), path.split(".")
        by_leg.append((metric.text, metric.quantity, metrics[group][name], ""))
    for name, title in (("net", "net work"), ("absolute", "work, absolute")):
        by_leg.append((title, ENERGY, energy[name], Value(energy[f"{name}_total"], ENERGY)))
    for name, part in (metrics["limits"] or {}).items():
        for number in ("used", "first_exceeded"):
            if number == "used" or any(time is not None for time in part[number]):
                metric = metric_of(f"limits.{name}.{number}")
                by_leg.append((metric.text, metric.quantity, part[number], ""))
    for name, share in {**(metrics["saturation"] or {}), "stroke_exceeded": stroke.get("exceeded")}.items():
        if share and share["any"]:  # rows of zeros say nothing
            by_leg.append((name.replace("_", " "), SHARE, share["legs"], Value(share["any"], SHARE)))
    rows = [(title, *(Value(value, quantity) for value in values), total) for title, quantity, values, total in by_leg]
    names = ("", *(f"{leg}" for leg in range(1, 7)), "all")
    return [*tables, Table("Legs", tuple(map(Column, names)), tuple(rows))]
