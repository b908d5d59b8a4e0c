"""Checks that a log matches the platform: even sampling, forces, plausible units."""

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.errors import LogError
from gough_stewart.harness.identify.log import Log
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# Tolerance of a row's time, in samples.
_JITTER = 0.1
_SLOWEST_SAMPLES = 0.1  # [s]
# Factor between lengths or forces and those at home beyond which another unit is likely.
_LENGTH_FACTOR = 3.0
_FORCE_FACTOR = 50.0
_OVER_LIMIT = 3.0


def sample_time_of(log: Log) -> float:
    """The constant sample time of the rows [s].

    Raises
    ------
    LogError
        No time, times that do not increase, gaps, or rows too slow for a motion.
    """
    number, h = rows_apart(log)
    assert log.time is not None  # checked by rows_apart
    gaps = np.flatnonzero(number > 1)
    if gaps.size:
        k = int(gaps[0])
        raise LogError(
            f"{log.where}: a gap of {log.time[k + 1] - log.time[k]:.6g} s after row {k + 1} (time {log.time[k]:.6g} "
            f"s), where rows are {h:.6g} s apart, and {gaps.size - 1} more; expected even times: use the longest part "
            "without a gap, or record again"
        )
    return h


def rows_apart(log: Log) -> tuple[NDArray[np.intp], float]:
    """How many sample times each row is after the one before it (n − 1,), 1 without gaps; and the sample time [s].

    Raises
    ------
    LogError
        No time, times that do not increase or are uneven, or rows too slow for a motion.
    """
    if log.time is None:
        raise LogError(f"{log.where}: no column time; expected one, since the motion between rows is needed")
    if len(log) < 2:
        raise LogError(f"{log.where}: {len(log)} rows; expected a log of some seconds")
    steps = np.diff(log.time)
    h = float(np.median(steps))
    back = np.flatnonzero(steps <= 0)
    if back.size:
        k = int(back[0])
        raise LogError(
            f"{log.where}: time goes from {log.time[k]:.9g} to {log.time[k + 1]:.9g} s in row {k + 2}; expected "
            "increasing times"
        )
    resolution = float(np.spacing(np.float32(np.abs(log.time).max())))
    if resolution > _JITTER * h and (log.time.astype(np.float32) == log.time).all():
        raise LogError(
            f"{log.where}: times are numbers of 32 bits, {resolution:.2g} s apart at {np.abs(log.time).max():.6g} s, "
            f"where rows are {h:.2g} s apart; expected even times: write 64 bits, or count from the first row"
        )
    number = np.rint(steps / h)
    uneven = np.flatnonzero(np.abs(steps - number * h) > _JITTER * h)
    # of a long gap, the clock's own error adds up
    uneven = uneven[np.abs(steps - number * h)[uneven] > 1e-3 * steps[uneven]]
    if uneven.size:
        k = int(uneven[0])
        raise LogError(
            f"{log.where}: a step of {steps[k]:.6g} s after row {k + 1} (time {log.time[k]:.6g} s), where rows are "
            f"{h:.6g} s apart, and {uneven.size - 1} more; expected even times, or gaps of whole rows: record "
            "again, or interpolate to even times"
        )
    if h > _SLOWEST_SAMPLES:
        raise LogError(
            f"{log.where}: rows are {h:g} s apart; expected at most {_SLOWEST_SAMPLES:g} s for a motion. If time is "
            "in ms, name the column 'time [ms]'"
        )
    number = np.maximum(number, 1)
    return number.astype(np.intp), float(log.time[-1] - log.time[0]) / float(number.sum())


def force_of(log: Log) -> FloatArray:
    """The actuator forces (n, 6) [N].

    Raises
    ------
    LogError
        There are none.
    """
    if log.actuator_force is None:
        raise LogError(
            f"{log.where}: no forces; expected columns actuator_force[1..6], or motor_current[1..6] with "
            "force_per_current"
        )
    return log.actuator_force


def check_lengths(log: Log, platform: Platform) -> None:
    """Refuse leg lengths in another unit, or of another platform.

    Raises
    ------
    LogError
        Names the leg, its length, and what was expected.
    """
    home = np.asarray(leg_geometry(platform, platform.home_position, platform.home_orientation).length)
    found = np.median(log.leg_length, axis=0)
    ratio = found / home
    k = int(np.argmax(np.abs(np.log(np.maximum(ratio, 1e-9)))))
    if not 1 / _LENGTH_FACTOR < ratio[k] < _LENGTH_FACTOR:
        unit = _unit_for(ratio[k], {"m": 1.0, "cm": 1e2, "mm": 1e3, "um": 1e6})
        raise LogError(
            f"{log.where}: leg {k + 1} has a median length of {found[k]:.6g} m, but {home[k]:.6g} m at home; expected "
            f"similar lengths. {unit}If encoders count from home, add the length at home"
        )


def check_forces(log: Log, platform: Platform) -> None:
    """Refuse forces in another unit, or beyond the actuators' limit.

    Raises
    ------
    LogError
        Names the forces, and what was expected.
    """
    force = force_of(log)
    weight = float(np.linalg.norm(static_leg_forces(platform, platform.home_position, platform.home_orientation)))
    found = float(np.median(np.linalg.norm(force, axis=1)))
    limit = platform.actuator_force_max
    strongest = float(np.abs(force).max())
    ratio = found / weight if weight > 0 else 1.0
    if not 1 / _FORCE_FACTOR < ratio < _FORCE_FACTOR:
        unit = _unit_for(ratio, {"N": 1.0, "kN": 1e-3, "mN": 1e3})
        raise LogError(
            f"{log.where}: the six forces have a median norm of {found:.4g} N, but those that hold the platform at "
            f"home have {weight:.4g} N; expected similar forces. {unit}Otherwise check force_per_current"
        )
    if limit is not None and strongest > _OVER_LIMIT * limit:
        raise LogError(
            f"{log.where}: a force of {strongest:.6g} N exceeds actuator_force_max, {limit:g} N; check the unit, "
            "force_per_current, and the platform's limit"
        )


def _unit_for(ratio: float, units: dict[str, float]) -> str:
    """A sentence with the unit that would explain a ratio."""
    for unit, factor in units.items():
        if unit not in ("m", "N") and 1 / _LENGTH_FACTOR < ratio / factor < _LENGTH_FACTOR:
            return f"They look like {unit}: write the unit into the column names, such as 'name[1] [{unit}]'. "
    return ""
