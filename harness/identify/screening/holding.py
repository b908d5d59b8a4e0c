"""Readings that a log repeats because a sensor is slower than the log: recognised, and brought to the sensor's rows."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.errors import LogError
from gough_stewart.harness.identify.log import Log, sample_time_of
from gough_stewart.harness.identify.regression import edge, smoothed
from gough_stewart.model.vectors import FloatArray

# Readings that change at least this often tell how long each is held, if this share of changes keeps the rhythm.
_CHANGES, _RHYTHM = 40, 0.995
_LONGEST = 60  # rows
# Faster signals pass a low-pass before rows are left out: gain 1 up to half of it, 0 from the new Nyquist frequency on.
_CUTOFF = 2 / 3


class Hold(NamedTuple):
    """Readings change at rows `phase`, `phase` + `rows`, `phase` + 2 `rows` only."""

    rows: int
    phase: int


def hold_of(values: FloatArray) -> Hold:
    """How many rows each reading of a sensor (n,) is held; 1 if it may change at every row.

    An encoder that moves slowly repeats its readings too, but changes them at any row; a held reading changes them at
    every k-th row only.
    """
    changes = np.flatnonzero(np.diff(values)) + 1
    if len(changes) >= _CHANGES:
        for rows in range(_LONGEST, 1, -1):
            count = np.bincount(changes % rows, minlength=rows)
            if count.max() >= _RHYTHM * len(changes):
                return Hold(rows, int(count.argmax()))
    return Hold(1, 0)


def without_held_rows(log: Log) -> tuple[Log, list[str]]:
    """The log at the rows at which its slower signal was read, and notes on what was recognised.

    The faster signal, lengths or forces, passes a low-pass with zero phase before rows are left out.

    Raises
    ------
    LogError
        The legs' sensors are held unequally, so that their common rows are unknown.
    """
    h = sample_time_of(log)
    assert log.time is not None  # checked by sample_time_of
    signals = {"leg_length": log.leg_length, "actuator_force": log.actuator_force}
    holds = {name: _common(name, values, log.where) for name, values in signals.items() if values is not None}
    slow = max(holds, key=lambda name: holds[name].rows)
    rows = holds[slow].rows
    if rows == 1:
        return log, []
    notes = [
        f"{log.where}: {_TEXT[name]} change at every {hold.rows}. row only, so sensors are read every "
        f"{1e3 * hold.rows * h:.4g} ms"
        for name, hold in holds.items()
        if hold.rows > 1
    ]
    at = np.arange(holds[slow].phase, len(log), rows)
    values: dict[str, FloatArray] = {}
    first, last = 0, len(at)
    for name, each in signals.items():
        if each is None or name == slow or holds[name] == holds[slow]:
            continue
        values[name], begin, end = _resampled(each, holds[name], at, h, log.holds_force and name == "actuator_force")
        first, last = max(first, begin), min(last, end)
    if last - first < 2:
        raise LogError(f"{log.where}: {len(log)} rows are too few for readings that are held for {rows} of them")
    changed: dict[str, Any] = {name: each[first:last] for name, each in values.items()}
    # a force that was brought to other rows belongs to its row; one that is held as long as lengths are stays held
    changed["holds_force"] = log.holds_force and "actuator_force" not in values
    return replace(log.rows(at[first:last]), **changed), notes


_TEXT = {"leg_length": "leg lengths", "actuator_force": "forces"}


def _common(name: str, values: FloatArray, where: str) -> Hold:
    found = {hold_of(column) for column in values.T}
    # legs that hardly move have no rhythm of their own
    held = {hold for hold in found if hold.rows > 1}
    if len(held) > 1 and len({hold.rows for hold in held}) == 1:
        hold = next(iter(held))
        raise LogError(
            f"{where}: {_TEXT[name]} are held for {hold.rows} rows, but legs change at different rows "
            f"({', '.join(str(each.phase + 1) for each in sorted(held))}); expected sensors that are read at the same "
            "time: log each reading once, with its own time"
        )
    if not held:
        return Hold(1, 0)
    # a longer rhythm contains the shorter one of a leg that moves more
    return min(held)


def _resampled(
    values: FloatArray, hold: Hold, at: NDArray[np.intp], h: float, is_held_force: bool
) -> tuple[FloatArray, int, int]:
    """Values at rows `at`, NaN where the filter does not reach, and the first and the last (exclusive) that it does."""
    own = values[hold.phase :: hold.rows]
    step, target = hold.rows * h, int(at[1] - at[0])
    cutoff = _CUTOFF * 0.5 / (target * h)
    # the place of the first target between the signal's own rows
    offset = (at[0] - hold.phase) % hold.rows
    delay = offset * h - (step / 2 if is_held_force else 0.0)
    found = smoothed(own, step, cutoff, 1, 0, delay)
    index = (at - hold.phase - offset) // hold.rows - edge(step, cutoff)
    inside = np.flatnonzero((index >= 0) & (index < len(found)))
    result = np.full((len(at), values.shape[1]), np.nan)
    if inside.size:
        result[inside] = found[index[inside]]
    return result, int(inside[0]) if inside.size else 0, int(inside[-1]) + 1 if inside.size else 0
