"""Metrics of a record written a second time, from the docstring of `gs.metrics` and docs/ensembles.md alone."""

import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

import gough_stewart as gs

FloatArray = NDArray[np.float64]


def _rms(values: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt((values**2).sum(axis=0) / len(values)))


def _power_peak(record: gs.Record) -> float:
    F, v = record["actuator_force"], record["leg_velocity"]
    return float(max(np.abs(F * v).max(), np.abs(F[:-1] * v[1:]).max()))


def _work(record: gs.Record) -> FloatArray:
    return np.asarray(record["actuator_force"][:-1] * np.diff(record["leg_length"], axis=0))


def _stroke_margin(record: gs.Record) -> float:
    low, high = (record.metadata["platform"][f"leg_length_{end}"] for end in ("min", "max"))
    return float(min((record["leg_length"] - low).min(), (high - record["leg_length"]).min()))


def _response(record: gs.Record, axis: int) -> tuple[FloatArray, FloatArray]:
    """Time since the last row with the first value of the reference, and the response from 0 to 1."""
    wanted, got = record["reference.position"][:, axis], record["position"][:, axis]
    start = int(np.flatnonzero(wanted == wanted[0])[-1])
    time = record["time"]
    return time[start:] - time[start], (got[start:] - wanted[0]) / (wanted[-1] - wanted[0])


def _overshoot(record: gs.Record, axis: int) -> float:
    return float(max(0.0, 100 * (_response(record, axis)[1].max() - 1)))


def _rise_time(record: gs.Record, axis: int) -> float:
    time, y = _response(record, axis)
    if not (y >= 0.9).any():
        return float("nan")
    return float(time[np.flatnonzero(y >= 0.9)[0]] - time[np.flatnonzero(y >= 0.1)[0]])


METRICS: Mapping[str, Callable[[gs.Record], float]] = {
    "tracking.position.norm_rms": lambda r: float(np.sqrt((r["error.position"] ** 2).sum() / len(r["time"]))),
    "tracking.orientation.norm_peak": lambda r: float(np.sqrt((r["error.orientation"] ** 2).sum(axis=1)).max()),
    "tracking.position.norm_final": lambda r: float(
        np.linalg.norm(r["error.position"][-math.ceil(len(r["time"]) / 10) :], axis=1).max()
    ),
    "tracking.leg_length.rms": lambda r: float(_rms(r["error.leg_length"]).max()),
    "force.peak": lambda r: float(np.abs(r["actuator_force"]).max()),
    "force.rms": lambda r: float(_rms(r["actuator_force"][:-1]).max()),
    "power.peak": _power_peak,
    "energy.absolute_total": lambda r: float(np.abs(_work(r)).sum()),
    "energy.net_total": lambda r: float(_work(r).sum()),
    "stroke.margin": _stroke_margin,
    "limits.actuator_force_max.used": lambda r: float(
        np.abs(r["actuator_force"]).max() / r.metadata["platform"]["actuator_force_max"]
    ),
    "saturation.force_limited.any": lambda r: float(r["flag.force_limited"][:-1].any(axis=1).mean()),
    "step_response.x.overshoot_percent": lambda r: _overshoot(r, 0),
    "step_response.y.overshoot_percent": lambda r: _overshoot(r, 1),
    "step_response.z.overshoot_percent": lambda r: _overshoot(r, 2),
    "step_response.y.rise_time": lambda r: _rise_time(r, 1),
    "step_response.z.rise_time": lambda r: _rise_time(r, 2),
}
