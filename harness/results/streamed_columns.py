"""Metrics of many runs, by path, from the values that an observer has accumulated."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.model.vectors import FloatArray

if TYPE_CHECKING:
    from gough_stewart.harness.loop.loop import Loop

# Rows of the arrays of sums and of peaks, members last: squares of the errors, of their norms, of the force F, the leg
# velocity v, F v at the start of a row and at the end of the previous one; lengths L and −L.
E, NORMS, F, V, FV, FV_BEFORE, LONG, SHORT = (
    slice(*ends) for ends in ((0, 12), (12, 14), (14, 20), (20, 26), (26, 32), (32, 38), (38, 44), (44, 50))
)
SIZE, SUMMED = 50, 20
BOUNDS = (
    ("leg_velocity_max", (V,)),
    ("actuator_force_max", (F,)),
    ("actuator_power_max", (FV_BEFORE, FV)),
)
_ERRORS = {"position": slice(0, 3), "orientation": slice(3, 6), "leg_length": slice(6, 12)}
_FLAGS = ("force_limited", "rate_limited")


def columns_of(
    state: Mapping[str, FloatArray], rows: NDArray[np.intp], loop: "Loop", platform: Mapping[str, Any]
) -> dict[str, FloatArray]:
    """Metrics (N,) of members with these numbers of rows; NaN where undefined."""
    present, total = state["present"], state["total"]
    time = loop.timing.times
    duration = time[np.maximum(rows - 1, 0)] - time[0]
    # the last row lasts for no time, but a single row counts
    held = np.maximum(rows - 1, 1)
    peak = np.sqrt(state["peak"][: LONG.start])
    found: dict[str, FloatArray] = {"rows": rows.astype(float), "duration": duration}
    if loop.reference is not None:
        rms = np.sqrt((total[:14] + present[:14]) / rows)
        for k, (name, part) in enumerate(_ERRORS.items()):
            found[f"tracking.{name}.rms"] = rms[part].max(axis=0)
            found[f"tracking.{name}.peak"] = peak[part].max(axis=0)
            if k < 2:
                found[f"tracking.{name}.norm_rms"], found[f"tracking.{name}.norm_peak"] = rms[12 + k], peak[12 + k]
    found["force.peak"] = peak[F].max(axis=0)
    found["force.rms"] = np.sqrt(np.where(rows > 1, total[F], present[F]) / held).max(axis=0)
    found["power.peak"] = np.maximum(peak[FV], peak[FV_BEFORE]).max(axis=0)
    net, absolute = state["net"], state["absolute"]
    found["power.mean"] = np.where(duration > 0, (net / duration).max(axis=0), np.nan)
    found["energy.net"], found["energy.absolute"] = net.max(axis=0), absolute.max(axis=0)
    found["energy.net_total"], found["energy.absolute_total"] = net.sum(axis=0), absolute.sum(axis=0)
    found |= _saturation(state, rows, held) | _stroke(state, rows, platform) | _limits(state, peak, time, platform)
    return {
        name: np.where((rows > 0) & np.isfinite(values), values, 0.0 if name == "rows" else np.nan)
        for name, values in found.items()
    }


def _saturation(
    state: Mapping[str, FloatArray], rows: NDArray[np.intp], held: NDArray[np.intp]
) -> dict[str, FloatArray]:
    found = {}
    for k, name in enumerate(_FLAGS):
        legs, last = state["limited"][6 * k : 6 * k + 6], state["flags"][6 * k : 6 * k + 6]
        found[f"saturation.{name}.legs"] = (np.where(rows > 1, legs, last) / held).max(axis=0)
        found[f"saturation.{name}.any"] = np.where(rows > 1, state["any_limited"][k], last.any(axis=0)) / held
    return found


def _stroke(
    state: Mapping[str, FloatArray], rows: NDArray[np.intp], platform: Mapping[str, Any]
) -> dict[str, FloatArray]:
    shortest, longest = -state["peak"][SHORT].max(axis=0), state["peak"][LONG].max(axis=0)
    margins = [shortest - platform["leg_length_min"]] if "leg_length_min" in platform else []
    margins += [platform["leg_length_max"] - longest] if "leg_length_max" in platform else []
    return {
        "stroke.shortest": shortest,
        "stroke.longest": longest,
        "stroke.margin": np.min(margins, axis=0) if margins else np.full(len(rows), np.nan),
        "stroke.exceeded.legs": (state["beyond"] / rows).max(axis=0),
        "stroke.exceeded.any": state["any_beyond"][0] / rows,
    }


def _limits(
    state: Mapping[str, FloatArray], peak: FloatArray, time: FloatArray, platform: Mapping[str, Any]
) -> dict[str, FloatArray]:
    found = {}
    for k, (name, parts) in enumerate(BOUNDS):
        if name in platform:
            limit, first = np.asarray(platform[name], dtype=float), state["first"][k]
            used = np.max([peak[part].max(axis=0) for part in parts], axis=0) / limit
            found[f"limits.{name}.limit"] = np.broadcast_to(limit, used.shape)
            found[f"limits.{name}.used"] = used
            row = np.where(np.isfinite(first), first, 0.0).astype(np.intp)
            found[f"limits.{name}.first_exceeded"] = np.where(np.isfinite(first), time[row], np.nan)
    return found
