"""Refuses recorded motions whose times are taken in a wrong unit: a thousand times too slow or too fast.

A speed is compared with that of a free fall over the motion's own range D: r = √(g D)/v. For a sine, r² is 2 g over
the largest acceleration: motions of platforms have r from 1 (2 g) to 1000 (positioning at 1 mm/s over 0.1 m). Beyond,
a motion is refused if another unit makes it one that platforms have, in speed, in the rate of its rows and in duration.
"""

from typing import NamedTuple

import numpy as np

from gough_stewart.harness.errors import MotionError
from gough_stewart.harness.motion.recorded.table import FromTable
from gough_stewart.model.units import UNITS
from gough_stewart.model.vectors import FloatArray

_GRAVITY = 9.81
# r below and above which no platform moves: accelerations of 200 g, and of 2e-6 g.
_TOO_FAST, _TOO_SLOW = 0.1, 1000.0
# r, steps between rows [s] and durations [s] that are plausible in the unit that is guessed
_PLAUSIBLE, _STEPS, _SHORTEST = (1.0, 1000.0), (0.9e-4, 1.1), 0.1
# The middle of plausible r: of several units, the guess is the nearest to it.
_USUAL = 10.0
# Smaller ranges, as a share of the platform's size, are a hold with noise, the same at any speed.
_STILL = 1e-3
# Of the speeds between rows, the quantile that is too fast: a few spikes are not a wrong unit.
_MOST_ROWS = 0.9
_NAMES = {"ns": "nanoseconds", "us": "microseconds", "ms": "milliseconds", "s": "seconds"}


class _Guess(NamedTuple):
    """A unit in which the times would be plausible."""

    unit: str
    factor: float  # times are so many times as long


def check_speed(table: FromTable, unit: float, size: float, time_scale: float = 1.0) -> None:
    """Refuse a motion whose times look as if they were in another unit.

    Parameters
    ----------
    unit
        The unit in which the times were read [s].
    size
        The platform's characteristic length [m].
    time_scale
        The motion is played so many times as long.

    Raises
    ------
    MotionError
        Says how slow or fast the motion is, and in which unit it would be plausible.
    """
    pose = np.hstack([table.position, size * table.orientation])
    step = time_scale * np.diff(table.time)
    reach = float(np.linalg.norm(np.ptp(pose, axis=0)))
    if reach < _STILL * size:
        return
    speed = np.linalg.norm(np.diff(pose, axis=0), axis=1) / step
    free_fall = np.sqrt(_GRAVITY * reach)
    largest, usual = float(speed.max()), float(np.quantile(speed, _MOST_ROWS))
    if free_fall > _TOO_SLOW * largest:
        guess, what = _guessed(free_fall / largest, step, unit), "never faster than"
    elif free_fall < _TOO_FAST * usual:
        guess, what, largest = _guessed(free_fall / usual, step, unit), "mostly as fast as", usual
    else:
        return
    if guess is not None:
        now = float(step.sum())
        raise MotionError(
            f"times look like {_NAMES[guess.unit]}: over a range of {reach:.3g} m, with angles times {size:.3g} m, the "
            f"motion is {what} {largest:.3g} m/s and takes {now:.6g} s; in {guess.unit} it would take "
            f"{now * guess.factor:.6g} s; write the unit in the header, 'time [{guess.unit}]', or, if this speed "
            "is meant, unusual_speed = true in the reference"
        )


def _guessed(ratio: float, step: FloatArray, unit: float) -> _Guess | None:
    """The unit whose times make a motion that platforms have, with r nearest to the usual one; or None."""
    guesses = (_Guess(name, UNITS["s"][name] / unit) for name in _NAMES)
    plausible = [
        guess
        for guess in guesses
        if _PLAUSIBLE[0] <= ratio * guess.factor <= _PLAUSIBLE[1]
        and _STEPS[0] <= float(np.median(step)) * guess.factor <= _STEPS[1]
        and float(step.sum()) * guess.factor >= _SHORTEST
    ]
    return min(plausible, key=lambda guess: abs(np.log(ratio * guess.factor / _USUAL)), default=None)
