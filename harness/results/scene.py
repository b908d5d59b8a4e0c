"""The scene of a run: bodies of the platform, and their motion frame by frame."""

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.report.quantities import fineness_of
from gough_stewart.harness.report.scene import Flag, Scene
from gough_stewart.harness.results.limits import nearness_to_limits
from gough_stewart.harness.results.record_data import RecordData
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.vectors import FloatArray

# Frames of all records of a page together; for 10 s at 1 kHz, 200 frames per second.
FRAMES = 2001
FLAGS = ("force_limited", "rate_limited", "stroke_exceeded")
# Shares by which the two parts of a leg overlap at its longest, and keep clear of the other's joint at its shortest.
_OVERLAP, _SHORTEST = 0.06, 0.97


def frame_rows(rows: int, frames: int) -> NDArray[np.int64]:
    """Rows that become frames: every s-th and the last, with the smallest s that keeps to this number of frames."""
    stride = max(1, math.ceil((rows - 1) / max(frames - 1, 1)))
    frames_at = np.arange(0, rows, stride)
    return frames_at if frames_at[-1] == rows - 1 else np.append(frames_at, rows - 1)


def scene_of(record: RecordData, platform: Platform, name: str, frames: int = FRAMES, run: int | None = None) -> Scene:
    """Geometry and frames of a record whose rows are finite.

    Frames have the values of their rows: time, pose, leg lengths, forces, reference, neither interpolated nor rounded.
    Flags cover the time from each frame to the next, and are set if they are set in any row of it.
    """
    rows = frame_rows(record.table.height, frames)
    few = RecordData(record.table[rows], record.metadata)
    lower, upper = leg_parts(record["leg_length"], platform)
    nearness, flags = nearness_to_limits(few, platform), list[Flag]()
    for flag in FLAGS:
        if f"flag.{flag}" in record:
            is_set = np.asarray(record[f"flag.{flag}"].astype(bool).any(axis=1))
            flags.append(Flag(flag, "".join("01"[int(is_set[a:b].any())] for a, b in pairwise(rows))))
    return Scene(
        name,
        platform.base_points,
        platform.platform_points,
        lower,
        upper,
        few["time"],
        _poses(few["position"], few["orientation"]),
        few["leg_length"],
        home=_poses(platform.home_position, platform.home_orientation),
        orientation=few["orientation"],
        reference=_poses(few["reference.position"], few["reference.orientation"])
        if "reference.position" in few
        else None,
        actuator_force=few["actuator_force"],
        external_force=few["external_force"] if few["external_force"].any() else None,
        nearness=np.max(list(nearness.values()), axis=0) if nearness else None,
        nearness_of=tuple(nearness),
        flags=tuple(flags),
        rows=record.table.height,
        run=run,
        decimals=max(4, 3 + round(-math.log10(fineness_of(platform)))),
    )


def leg_parts(length: FloatArray, platform: Platform) -> tuple[float, float]:
    """Drawn lengths of the lower and upper part [m], which overlap at all leg lengths that occur or are allowed.

    No parameter sets the shape of the parts, only their centres of mass.
    """
    low = min(float(length.min()), platform.leg_length_min or math.inf)
    high = max(float(length.max()), platform.leg_length_max or 0.0)
    longest = _SHORTEST * low
    lower = min(longest, (0.5 + _OVERLAP / 2) * high)
    return lower, min(longest, high - lower + _OVERLAP * high)


def _poses(position: FloatArray, orientation: FloatArray) -> FloatArray:
    """Position and quaternion (x, y, z, w) of platforms (…, 7)."""
    from scipy.spatial.transform import Rotation  # needed only for pages, and slow to import (0.2 s)

    rotation = matrix_from_orientation(orientation)
    return np.concatenate([position, Rotation.from_matrix(rotation).as_quat()], axis=-1)
