"""Metrics of a run: tracking, step responses, forces, power and energy, saturation, stroke."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.results.limits import shares_of_limits
from gough_stewart.harness.results.outcome import outcome_of
from gough_stewart.harness.results.record import Record
from gough_stewart.harness.results.steps import AXES, BAND, HIGH, LOW, step_in, step_numbers
from gough_stewart.model.vectors import FloatArray

_USED = ("position", "orientation", "leg_length", "leg_velocity", "actuator_force")
_ERRORS = ("position", "orientation", "leg_length")


class Metrics(dict[str, Any]):
    """Metrics by name: a dict that is displayed as tables, in a terminal and in a notebook."""

    def __str__(self) -> str:
        """The tables that `gough-stewart run` prints."""
        from gough_stewart.harness.output.tables import text_of
        from gough_stewart.harness.results.tables import metrics_table

        return text_of(metrics_table(self))

    def _repr_html_(self) -> str:
        from html import escape

        from gough_stewart.harness.output.tables import to_html
        from gough_stewart.harness.results.outcome import is_sound, outcome_text
        from gough_stewart.harness.results.tables import metrics_sheets

        outcome = self["outcome"]
        remark = "" if is_sound(outcome) else f"<p><strong>{escape(outcome_text(outcome))}</strong></p>"
        return "".join([remark, *map(to_html, metrics_sheets(self))])


def metrics(record: Record) -> Metrics:
    """Compute metrics in SI units, as plain numbers, lists, and None where undefined; never NaN or infinite.

    Rows from the first one with values of the plant that are not finite are left out.

    - `outcome` from the metadata, with the `oscillation` or growth of a loop by itself, None if it comes to rest:
      `is_growing`, `leg`, `amplitude` and `earlier` [m], `frequency` [Hz], `since` [s].
    - `rows` and `duration` [s] that the metrics below cover.
    - `tracking`: `rms` and `peak` of the errors of `position` [m], `orientation` [rad] and `leg_length` [m] by axis or
      leg; for position and orientation also of the Euclidean `norm`.
    - `step_response`: for each axis whose reference goes from one value to another and stays there. The response
      (y − from)/(to − from) starts at time `at` [s]: the row of a jump, or else the last row at which the reference has
      its first value.
      `overshoot_percent`, `rise_time` from 10 to 90 % [s], `settling_time` to 2 % [s], `final_error` [m, rad];
      None if it did not rise or settle within the record. Times are those of rows, not interpolated.
    - `force`: `peak` and `rms` of F by leg [N]. `power`: `peak` of |F·L̇| by leg, with L̇ at both ends of each row,
      and `mean` [W].
    - `energy`, by leg and in total: `net` = ∑ F_k (L_{k+1} − L_k), which is ∫ F·L̇ dt, and `absolute` =
      ∑ |F_k (L_{k+1} − L_k)|, which is ∫ |F·L̇| dt unless a leg reverses within a row [J].
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
    n = kept.table.height
    time = kept["time"]
    # overflow becomes None
    with np.errstate(all="ignore"):
        return Metrics(
            {
                "outcome": outcome_of(record),
                "rows": n,
                "duration": float(time[-1] - time[0]) if n else None,
                "tracking": _tracking(kept) if n else None,
                "step_response": _step_responses(kept) if n else None,
                "force": _force(kept) if n else None,
                "power": _power(kept) if n else None,
                "energy": _energy(kept) if n else None,
                "saturation": _saturation(kept) if n else None,
                "stroke": _stroke(kept) if n else None,
                "limits": _limits(kept) if n else None,
            }
        )


def metrics_json(metrics: dict[str, Any]) -> bytes:
    """Readable JSON."""
    return (json.dumps(metrics, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()


def finite_part(record: Record) -> Record:
    """The rows before the first one with values of the plant that are not finite."""
    fine: NDArray[np.bool_] = np.ones(record.table.height, dtype=bool)
    for name in (*_USED, *(f"error.{e}" for e in _ERRORS), "reference.position", "reference.orientation"):
        if name in record:
            fine &= np.isfinite(record[name]).all(axis=1)
    rows = len(fine) if fine.all() else int(fine.argmin())
    return Record(record.table.head(rows), record.metadata)


def _tracking(record: Record) -> dict[str, Any] | None:
    found: dict[str, Any] = {}
    for name in _ERRORS:
        if f"error.{name}" not in record:
            continue
        error = record[f"error.{name}"]
        found[name] = {"rms": _list(_rms(error)), "peak": _list(np.abs(error).max(axis=0))}
        if name != "leg_length":
            norm = np.linalg.norm(error, axis=1)
            found[name] |= {"norm_rms": _number(_rms(norm)), "norm_peak": _number(norm.max())}
    return found or None


def _step_responses(record: Record) -> list[dict[str, Any]] | None:
    if "reference.position" not in record or "reference.orientation" not in record:
        return None
    responses = (
        _step_response(axis, record["time"], record[f"reference.{name}"][:, k], record[name][:, k])
        for axis, name, k in AXES
    )
    return [response for response in responses if response is not None]


def _step_response(axis: str, time: FloatArray, reference: FloatArray, actual: FloatArray) -> dict[str, Any] | None:
    step = step_in(reference)
    if not step.exists:
        return None
    start, first, last = int(step.start), step.first, step.last
    response = (actual[start:] - first) / (last - first)
    outside = np.flatnonzero(np.abs(response - 1) >= BAND)
    low, high = (np.asarray((response >= level).argmax()) for level in (LOW, HIGH))
    settled = np.asarray(outside[-1] + 1 if outside.size else 0)
    numbers = step_numbers(time, step.start, response.max(), start + low, start + high, start + settled)
    return {
        "axis": axis,
        "from": _number(first),
        "to": _number(last),
        "at": _number(time[start]),
        **{name: _number(value) for name, value in numbers._asdict().items()},
        "final_error": _number(last - actual[-1]),
    }


def _force(record: Record) -> dict[str, Any]:
    force = record["actuator_force"]
    return {"peak": _list(np.abs(force).max(axis=0)), "rms": _list(_rms(_held(force)))}


def _power(record: Record) -> dict[str, Any]:
    force, velocity, time = record["actuator_force"], record["leg_velocity"], record["time"]
    ends = np.concatenate([force * velocity, force[:-1] * velocity[1:]])
    duration = time[-1] - time[0]
    mean = _list(_work(record).sum(axis=0) / duration) if duration > 0 else [None] * 6
    return {"peak": _list(np.abs(ends).max(axis=0)), "mean": mean}


def _energy(record: Record) -> dict[str, Any]:
    net, absolute = _work(record).sum(axis=0), np.abs(_work(record)).sum(axis=0)
    return {
        "net": _list(net),
        "absolute": _list(absolute),
        "net_total": _number(net.sum()),
        "absolute_total": _number(absolute.sum()),
    }


def _work(record: Record) -> FloatArray:
    """Work F_k (L_{k+1} − L_k) over each row (n − 1, 6) [J]."""
    work: FloatArray = record["actuator_force"][:-1] * np.diff(record["leg_length"], axis=0)
    return work


def _saturation(record: Record) -> dict[str, Any] | None:
    names = [name for name in ("force_limited", "rate_limited") if f"flag.{name}" in record]
    return {name: _shares(_held(record[f"flag.{name}"])) for name in names} or None


def _stroke(record: Record) -> dict[str, Any]:
    length, platform = record["leg_length"], record.metadata["platform"]
    low, high = platform.get("leg_length_min"), platform.get("leg_length_max")
    margins = [length.min() - low] if low is not None else []
    margins += [high - length.max()] if high is not None else []
    return {
        "shortest": _list(length.min(axis=0)),
        "longest": _list(length.max(axis=0)),
        "margin": _number(min(margins)) if margins else None,
        "exceeded": _shares(record["flag.stroke_exceeded"]) if "flag.stroke_exceeded" in record else None,
    }


def _limits(record: Record) -> dict[str, Any] | None:
    time, platform = record["time"], record.metadata["platform"]
    found = {}
    for name, share in shares_of_limits(record, platform).items():
        beyond = share > 1
        firsts = [float(time[leg.argmax()]) if leg.any() else None for leg in beyond.T]
        found[name] = {"limit": platform[name], "used": _list(share.max(axis=0)), "first_exceeded": firsts}
    return found or None


def _shares(flags: NDArray[Any]) -> dict[str, Any]:
    flags = flags.astype(bool)
    return {"legs": _list(flags.mean(axis=0)), "any": _number(flags.any(axis=1).mean())}


def _held(rows: NDArray[Any]) -> NDArray[Any]:
    """All rows but the last, which lasts for no time; a single row is kept."""
    return rows[:-1] if len(rows) > 1 else rows


def _rms(values: FloatArray) -> FloatArray:
    root: FloatArray = np.sqrt(np.mean(values**2, axis=0))
    return root


def _number(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None


def _list(values: FloatArray) -> list[float | None]:
    return [_number(value) for value in values]


# How a list by leg or axis becomes one number; all others become their largest value.
_LEAST = ("shortest", "first_exceeded")


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
            found[path] = _of_list(path.rpartition(".")[2], value)
        elif value is not None or "." in path:
            found[path] = value

    steps = {step["axis"]: {k: v for k, v in step.items() if k != "axis"} for step in metrics["step_response"] or ()}
    add("", {k: v for k, v in metrics.items() if k not in ("outcome", "step_response")})
    for axis, step in steps.items():
        for name, value in step.items():
            found[f"step_response.{axis}.{name}"] = value
    return found


def _of_list(name: str, values: list[float | None]) -> float | None:
    finite = [value for value in values if value is not None]
    if not finite or (len(finite) < len(values) and name != "first_exceeded"):
        return None
    return min(finite) if name in _LEAST else max(finite)
