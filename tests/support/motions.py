"""Motions as experiments name them, logs that they read, and their derivatives by differences."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.records import plain

# This project's names of a log's columns, in SI units.
COLUMNS = ("time", *(f"{name}[{k}]" for name in ("position", "orientation") for k in (1, 2, 3)))


def experiment(platform: gs.Platform, reference: dict[str, Any], folder: Path = Path(), **tables: Any) -> gs.Experiment:
    """An experiment on a platform with a motion; 1 s in steps of 10 ms unless `loop` says otherwise."""
    parameters = {name: value for name, value in plain(platform).items() if name not in ("name", "source")}
    values: dict[str, Any] = {
        "title": "motion",
        "platform": {"preset": "liu2000", "parameters": parameters},
        "reference": reference,
        "controller": {"type": "pd", "bandwidth": 1.5},
        "loop": {"duration": 1.0, "sample_time": 0.01},
    }
    return gs.Experiment(**(values | tables)).from_file("motion.toml", folder)


def motion_of(platform: gs.Platform, folder: Path = Path(), **reference: Any) -> Any:
    """The motion of `[reference]` with these keys; called with times (n,), it gives the motion there."""
    choice = experiment(platform, reference).reference
    assert choice is not None
    return choice.about(platform, folder)


def write_table(path: Path, columns: Mapping[str, Any]) -> Path:
    """A CSV or Parquet file with these columns."""
    table = polars.DataFrame({name: np.asarray(values).tolist() for name, values in columns.items()}, strict=False)
    getattr(table, "write_parquet" if path.suffix == ".parquet" else "write_csv")(path)
    return path


def write_log(path: Path, time: ArrayLike, pose: FloatArray) -> Path:
    """A log of poses (n, 6) under this project's names."""
    return write_table(path, dict(zip(COLUMNS, np.column_stack([time, pose]).T, strict=True)))


def by_differences(motion: Any, time: FloatArray, h: float = 1e-5) -> list[FloatArray]:
    """Velocity, ω, acceleration and ω̇ (n, 3): central differences of places, rotations, velocities and ω."""
    before, after = motion(time - h), motion(time + h)
    turn = Rotation.from_euler("xyz", after.orientation) * Rotation.from_euler("xyz", before.orientation).inv()
    return [
        (after.position - before.position) / (2 * h),
        turn.as_rotvec() / (2 * h),
        (after.velocity - before.velocity) / (2 * h),
        (after.angular_velocity - before.angular_velocity) / (2 * h),
    ]
