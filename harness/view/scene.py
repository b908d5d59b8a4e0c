"""Data of a record for the 3-D view of a page: bodies, and their motion frame by frame."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.output.pages import packed
from gough_stewart.harness.results.limits import shares_of_limits
from gough_stewart.harness.results.record import Record
from gough_stewart.model.kinematics import joint_angles
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.vectors import FloatArray

# Frames of all records of a page together; for 10 s at 1 kHz, 200 frames per second.
FRAMES = 2001
FLAGS = ("force_limited", "rate_limited", "stroke_exceeded")
# Colours of nearness to a limit, from 0 in the middle to 1 at the limit, and beyond it. Lightness and the contrast of
# blue and yellow tell them apart without red and green (simulated as by Machado et al., IEEE Trans. Vis.
# Comput. Graph. 15 (2009), 1291-1298).
NEARNESS: dict[str, Any] = {
    "stops": [(0.0, "#6baed6"), (0.5, "#b8d0dc"), (0.8, "#f5b722"), (1.0, "#a50f15")],
    "beyond": "#5c1a7e",
}
# Shares by which the two parts of a leg overlap at its longest, and keep clear of the other's joint at its shortest.
_OVERLAP, _SHORTEST = 0.06, 0.97


def frame_rows(rows: int, frames: int) -> NDArray[np.int64]:
    """Rows that become frames: every s-th and the last, with the smallest s that keeps to this number of frames."""
    stride = max(1, math.ceil((rows - 1) / max(frames - 1, 1)))
    kept = np.arange(0, rows, stride)
    return kept if kept[-1] == rows - 1 else np.append(kept, rows - 1)


def scene_of(record: Record, platform: Platform, name: str, frames: int = FRAMES) -> dict[str, Any]:
    """Geometry and frames of a record whose rows are finite.

    Frames have the values of their rows: time, pose, leg lengths, forces, reference, neither interpolated nor rounded.
    `flags` cover the time from each frame to the next, and are set if they are set in any row of it.
    """
    rows = frame_rows(record.table.height, frames)
    few = Record(record.table[rows], record.metadata)
    lower, upper = leg_parts(record["leg_length"], platform)
    each = nearness_to_limits(few, platform)
    return {
        "name": name,
        "base": platform.base_points.tolist(),
        "platform": platform.platform_points.tolist(),
        "lower": lower,
        "upper": upper,
        "home": _poses(platform.home_position, platform.home_orientation).tolist(),
        "rows": record.table.height,
        "time": packed(few["time"]),
        "pose": packed(_poses(few["position"], few["orientation"])),
        "reference": packed(_poses(few["reference.position"], few["reference.orientation"]))
        if "reference.position" in few
        else None,
        "orientation": packed(few["orientation"]),
        "length": packed(few["leg_length"]),
        "force": packed(few["actuator_force"]),
        "nearness": {"of": list(each), "values": packed(np.max(list(each.values()), axis=0))} if each else None,
        "external_force": packed(few["external_force"]) if few["external_force"].any() else None,
        "flags": {name: _any_until_next(record, rows, name) for name in FLAGS if f"flag.{name}" in record},
    }


def leg_parts(length: FloatArray, platform: Platform) -> tuple[float, float]:
    """Drawn lengths of the lower and upper part [m], which overlap at all leg lengths that occur or are allowed.

    No parameter sets the shape of the parts, only their centres of mass.
    """
    low = min(float(length.min()), platform.leg_length_min or math.inf)
    high = max(float(length.max()), platform.leg_length_max or 0.0)
    longest = _SHORTEST * low
    lower = min(longest, (0.5 + _OVERLAP / 2) * high)
    return lower, min(longest, high - lower + _OVERLAP * high)


def nearness_to_limits(record: Record, platform: Platform) -> dict[str, FloatArray]:
    """Nearness of each leg to each limit of the platform or its actuators (n, 6) [1]; 1 is at the limit.

    - `stroke`: |L − middle| over half the stroke;
    - `force`: |F| over the limit of the actuators in the loop;
    - `velocity`, `power`: |L̇| and |F L̇| over the platform's limits;
    - `joint angle`: the larger angle of the leg's two joints from home over the largest allowed.
    """
    found: dict[str, FloatArray] = {}
    low, high = platform.leg_length_min, platform.leg_length_max
    if low is not None and high is not None:
        found["stroke"] = np.abs(record["leg_length"] - (low + high) / 2) / ((high - low) / 2)
    if record.metadata.get("force_limit"):
        found["force"] = np.abs(record["actuator_force"]) / record.metadata["force_limit"]
    shares = shares_of_limits(record, platform.as_dict())
    names = {"velocity": "leg_velocity_max", "power": "actuator_power_max"}
    found |= {what: shares[name] for what, name in names.items() if name in shares}
    if platform.joint_angle_max is not None:
        pose = (record["position"], record["orientation"])
        angles = joint_angles(platform, *pose, platform.home_position, platform.home_orientation)
        found["joint angle"] = np.maximum(*angles) / platform.joint_angle_max
    return found


def _poses(position: FloatArray, orientation: FloatArray) -> FloatArray:
    """Position and quaternion (x, y, z, w) of platforms (…, 7)."""
    from scipy.spatial.transform import Rotation  # needed only for pages, and slow to import (0.2 s)

    rotation = matrix_from_orientation(orientation)
    return np.concatenate([position, Rotation.from_matrix(rotation).as_quat()], axis=-1)


def _any_until_next(record: Record, rows: NDArray[np.int64], name: str) -> str:
    """One character per frame except the last: the values of a row hold until the next one."""
    up = np.asarray(record[f"flag.{name}"].astype(bool).any(axis=1))
    return "".join("01"[int(up[a:b].any())] for a, b in pairwise(rows))
