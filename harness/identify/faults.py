"""Faults in the data of a log: spikes, frozen and clipped readings, rows that were lost while times went on.

Each function looks at readings (n, 6) of the legs at even times and returns what it found; none changes a reading. What
is normal is judged from the log itself: noise from the interpolation of each reading by its neighbours, motion from the
rows around. So an encoder that repeats its reading at rest is not frozen, and a leg that reverses is no spike.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.errors import LogError
from gough_stewart.harness.identify.log import Part
from gough_stewart.harness.identify.lowpass import edge, smoothed
from gough_stewart.model.vectors import FloatArray

Mask = NDArray[np.bool_]

# A reading is a spike if it is off by so many standard deviations of noise; fewer do no harm.
_SPIKE = 8.0
# Readings on either side of suspects that tell what they should have been, and the longest spike in rows.
_AROUND, _LONGEST_SPIKE = 8, 8
# Repeated readings from which on they may be frozen; a frozen one jumps by so many usual changes when it moves again.
_FROZEN, _JUMP = 5, 4.0
# Readings at the very limit from which on they may be clipped, and how many times as many as just below it.
_CLIPPED, _MORE_THAN_BELOW = 5, 5.0
# Readings on either side of a gap that tell how much time passed in it; when a jump is sure; and the share of the
# length below which it may be a sudden force.
_SIDE, _SURE, _SUDDEN = 6, 12.0, 1e-6
# Relative changes that are none, and that are motion.
_ROUNDING, _FAR = 1e-9, 1e-4
# Readings that change at least this often tell how long each is held, if this share of changes keeps the rhythm.
_CHANGES, _RHYTHM = 40, 0.995
_LONGEST_HOLD = 60  # rows
# Faster signals pass a low-pass before rows are left out: gain 1 up to half of it, 0 from the new Nyquist frequency on.
_CUTOFF = 2 / 3
# The cubic through four neighbours, and its effect on white noise together with the reading.
_NEIGHBOURS = np.array([-1.0, 4.0, 4.0, -1.0]) / 6
_GAIN = float(np.sqrt(1 + (_NEIGHBOURS**2).sum()))


def runs_of(mask: Mask) -> NDArray[np.intp]:
    """The first row of each run of marked rows, and the one after its last (k, 2)."""
    return np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]))).reshape(-1, 2)


def noise_of(values: FloatArray) -> FloatArray:
    """Standard deviation (6,) of white noise: each reading against the cubic through its four neighbours, robustly.

    Smaller by nothing than the step in which readings come.
    """
    spread = 1.4826 * np.median(np.abs(_against_neighbours(values)), axis=0) / _GAIN
    return np.asarray(np.maximum(spread, step_of(values) / np.sqrt(12)))


def step_of(values: FloatArray) -> FloatArray:
    """The smallest change of each leg's readings (6,): the resolution of its sensor, or next to nothing."""
    changes = np.abs(np.diff(values, axis=0))
    smallest = np.where(changes > 1e-12 * np.abs(values).max(), changes, np.inf).min(axis=0)
    return np.asarray(np.where(np.isfinite(smallest), smallest, 0.0))


def _against_neighbours(values: FloatArray) -> FloatArray:
    """Readings (n − 4, 6) less the cubic through two neighbours on either side."""
    sides = (values[:-4], values[1:-3], values[3:-1], values[4:])
    return np.asarray(values[2:-2] - np.tensordot(_NEIGHBOURS, np.stack(sides), 1))


def spikes(values: FloatArray, known_bad: Mask, smallest: float) -> tuple[Mask, FloatArray]:
    """Single or few readings off what their neighbours on both sides agree on, by more than `smallest`; and the rest.

    Readings that are `known_bad` (n, 6) are not looked at.
    """
    is_spike, mended = np.zeros(values.shape, dtype=bool), values.copy()
    if len(values) < 4 * _AROUND:
        return is_spike, mended
    limit = np.maximum(_SPIKE * noise_of(values), smallest)
    suspect = np.zeros(values.shape, dtype=bool)
    suspect[2:-2] = (np.abs(_against_neighbours(values)) > limit * _GAIN) & ~known_bad[2:-2]
    for leg in range(values.shape[1]):
        rows = np.flatnonzero(suspect[:, leg])
        for group in np.split(rows, np.flatnonzero(np.diff(rows) > _AROUND) + 1) if rows.size else ():
            window = slice(max(0, group[0] - _AROUND), min(len(values), group[-1] + _AROUND + 1))
            outside, expected = _outliers(values[window, leg], float(limit[leg]))
            if outside.any() and not known_bad[window, leg].any():
                at = np.flatnonzero(outside) + window.start
                is_spike[at, leg], mended[at, leg] = True, expected[outside]
    return is_spike, mended


def _outliers(y: FloatArray, limit: float) -> tuple[Mask, FloatArray]:
    """Readings off a cubic through the others by more than `limit`, and the cubic; none if the others disagree too."""
    basis = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, len(y)), 3)
    weights = np.ones(len(y))
    for _ in range(20):
        # least absolute deviations: the majority decides
        expected = basis @ np.linalg.lstsq(basis * weights[:, None], y * weights, rcond=None)[0]
        weights = 1 / np.sqrt(np.maximum(np.abs(y - expected), 1e-3 * limit))
    off = np.abs(y - expected) > limit
    for _ in range(3):
        if off.sum() > min(_LONGEST_SPIKE, len(y) // 3) or off[:3].any() or off[-3:].any():
            return np.zeros(len(y), dtype=bool), y
        expected = basis @ np.linalg.lstsq(basis[~off], y[~off], rcond=None)[0]
        error = y - expected
        # a step or a kink of the signal leaves as much beside the suspects
        off = np.abs(error) > max(limit, _SPIKE * float(np.sqrt((error[~off] ** 2).mean())))
    return off, expected


def frozen(values: FloatArray, is_continuous: bool, not_looked_at: Mask) -> Mask:
    """Readings that stay at a value while the leg moves on.

    Where noise should change a reading it does not, or, of a signal that cannot jump, it jumps to where the leg has
    moved meanwhile. A signal that `is_continuous` cannot jump: lengths cannot, forces can.
    """
    is_frozen = np.zeros(values.shape, dtype=bool)
    size = float(np.abs(values).max())
    changes = np.abs(np.diff(values, axis=0))
    changes[changes < _ROUNDING * size] = 0.0
    steps = step_of(values)
    for leg in range(values.shape[1]):
        moved = np.flatnonzero(changes[:, leg]) + 1
        for begin, end in zip(np.append(0, moved), np.append(moved, len(values)), strict=True):
            if end - begin < _FROZEN or not_looked_at[begin, leg]:
                continue
            before, after = changes[max(0, begin - 12) : begin, leg], changes[end : end + 11, leg]
            around = np.concatenate([before, after])
            usual = max(float(around.max(initial=0.0)), float(steps[leg]), _ROUNDING * size)
            jumps = is_continuous and end < len(values) and changes[end - 1, leg] > _JUMP * usual
            is_noisy = len(around) >= 10 and (around == 0).mean() < 0.1 and _alternates(values[:, leg], begin, end)
            silent = is_noisy and end - begin >= 2 * _FROZEN
            # up to the end of the log only the others tell that it should have moved
            stops = is_continuous and end == len(values) and end - begin >= 4 * _FROZEN
            if stops:
                others = np.delete(np.ptp(values[begin:], axis=0) > np.maximum(20 * steps, _FAR * size), leg)
                stops = others.sum() >= 4 and (before > 0).mean() > 0.5
            if jumps or silent or stops:
                is_frozen[begin + 1 : end, leg] = True
    return is_frozen


def _alternates(values: FloatArray, begin: int, end: int) -> bool:
    """Whether readings around a run are noisy: second differences of noise change sign, those of motion do not."""
    for side in (values[max(0, begin - 30) : begin + 1], values[end : end + 31]):
        bends = np.diff(side, 2)
        if len(bends) >= 10 and (bends[1:] * bends[:-1]).sum() > -0.3 * (bends**2).sum():
            return False
    return True


def clipped(force: FloatArray, actuator_limit: FloatArray) -> Mask:
    """Forces (n, 6) at the end of their sensor's range, and those next to them.

    Many readings equal the largest or the smallest one, which they reach at speed, and hardly any is just below it. A
    force at the actuator's own limit is one that the actuator has.
    """
    is_clipped = np.zeros(force.shape, dtype=bool)
    spread = noise_of(force)
    for leg in range(force.shape[1]):
        for sign in (1.0, -1.0):
            y = sign * force[:, leg]
            top, count = np.unique(y, return_counts=True)
            level = float(top[-1])
            if abs(level) >= (1 - 1e-6) * actuator_limit[leg]:
                continue
            if len(top) < 4 or count[-1] < _CLIPPED or count[-1] <= _MORE_THAN_BELOW * count[-4:-1].max(initial=1):
                continue
            at = y == level
            entries = np.abs(np.diff(y))[at[1:] != at[:-1]]
            if not len(entries) or np.median(entries) < 0.2 * np.median(np.abs(np.diff(y))):
                continue  # a force that comes to rest at its largest value
            # noise takes some readings below the limit while the force is beyond it
            mean = np.convolve(np.pad(y, 10, mode="edge"), np.full(21, 1 / 21), mode="valid")
            for begin, end in runs_of(at | (mean > level - 3 * spread[leg])):
                is_clipped[begin:end, leg] |= at[begin:end].any()
    return is_clipped


class MissingRows(NamedTuple):
    """Rows that are missing before row `row`, though times go on."""

    row: int
    number: float  # of rows; negative if rows are repeated
    legs: tuple[int, ...]  # all, or one


def lost_rows(length: FloatArray, known_bad: Mask) -> list[MissingRows]:
    """Where lengths (n, 6) go on as if rows were missing: legs jump by their velocity times whole samples.

    Quadratics through the rows on either side, extrapolated to the middle, differ by L̇ τ if a time τ is missing; their
    slopes agree. All legs jump alike, or one alone. Rows near `known_bad` readings (n, 6) are not looked at.
    """
    if len(length) < 6 * _SIDE:
        return []
    t = np.arange(_SIDE) + 0.5
    inverse = np.linalg.pinv(np.stack([np.ones(_SIDE), t, t**2], axis=1))
    windows = np.lib.stride_tricks.sliding_window_view(length, _SIDE, axis=0)
    # at the middle between rows k + _SIDE − 1 and k + _SIDE, from either side
    right = windows[_SIDE:] @ inverse[:2].T
    left = windows[: len(right)][..., ::-1] @ inverse[:2].T
    jump, velocity = right[..., 0] - left[..., 0], (right[..., 1] - left[..., 1]) / 2
    bend = right[..., 1] + left[..., 1]
    usual = 1.4826 * float(np.median(np.abs(jump)))
    spread = max(usual, 2 * float(noise_of(length).max()), _SUDDEN * float(np.abs(length).max()))
    bad = np.lib.stride_tricks.sliding_window_view(np.asarray(known_bad.any(axis=1)), 2 * _SIDE)
    is_near_bad = np.asarray(bad.any(axis=1))[: len(right)]
    others = np.sqrt(np.maximum((jump**2).sum(axis=1, keepdims=True) - jump**2, 0.0))
    places: list[MissingRows] = []
    for legs in (tuple(range(6)), *((leg,) for leg in range(6))):
        v = velocity[:, legs]
        speed = np.maximum(np.linalg.norm(v, axis=1), 1e-300)
        along = (jump[:, legs] * v).sum(axis=1) / speed
        number, size = along / speed, np.abs(along)
        from_whole = np.abs(number - np.rint(number))
        rest = np.linalg.norm(jump[:, legs] - number[:, None] * v, axis=1)
        # times that jitter make every row look a little early or late
        jitter = 1.4826 * float(np.median(np.abs(number[speed >= np.median(speed)])))
        sure = (size > _SURE * spread) & (np.abs(number) > max(0.5, _SURE * jitter))
        sure &= (np.linalg.norm(bend[:, legs], axis=1) < 0.3 * speed) & (rest < 0.3 * size + 6 * spread) & ~is_near_bad
        sure &= from_whole < 0.15 + 4 * spread / speed
        if len(legs) == 1:
            sure &= (others[:, legs[0]] < 6 * spread) & (from_whole < 0.1)
        for k in np.flatnonzero(sure):
            if size[k] == size[max(0, k - _SIDE) : k + _SIDE + 1].max():
                places.append(MissingRows(int(k) + _SIDE, float(number[k]), legs))
    return places


def hold_of(values: FloatArray) -> tuple[int, int]:
    """How many rows each reading of a sensor (n,) is held, and the first row at which it changes; 1 if at every row.

    An encoder that moves slowly repeats its readings too, but changes them at any row; a held reading changes them at
    every k-th row only.
    """
    changes = np.flatnonzero(np.diff(values)) + 1
    for rows in range(_LONGEST_HOLD, 1, -1) if len(changes) >= _CHANGES else ():
        count = np.bincount(changes % rows, minlength=rows)
        if count.max() >= _RHYTHM * len(changes):
            return rows, int(count.argmax())
    return 1, 0


def without_held_rows(part: Part) -> tuple[Part, list[str]]:
    """The rows at which the slower signal was read, and notes on what was recognised.

    The faster signal, lengths or forces, passes a low-pass with zero phase before rows are left out.
    """
    signals = {"length": part.length, "force": part.force}
    words = {"length": "leg lengths", "force": "forces"}
    holds: dict[str, tuple[int, int]] = {}
    for name, values in signals.items():
        # legs that hardly move have no rhythm of their own; a longer rhythm contains the shorter one of others
        held = sorted({hold for hold in map(hold_of, values.T) if hold[0] > 1})
        if len(held) > 1 and held[0][0] == held[-1][0]:
            raise LogError(
                f"{part.where}: {words[name]} are held for {held[0][0]} rows, but legs change at different rows "
                f"({', '.join(str(phase + 1) for _, phase in held)}); expected sensors that are read at the same "
                "time: log each reading once, with its own time"
            )
        holds[name] = held[0] if held else (1, 0)
    slow = max(holds, key=lambda name: holds[name][0])
    every, phase = holds[slow]
    if every == 1:
        return part, []
    h, n = part.step, len(part.time)
    notes = [
        f"{part.where}: {words[name]} change at every {rows}. row only, so sensors are read every {1e3 * rows * h:.4g} "
        "ms"
        for name, (rows, _) in holds.items()
        if rows > 1
    ]
    at = np.arange(phase, n, every)
    changed: dict[str, Any] = {}
    first, last = 0, len(at)
    for name, (rows, start) in holds.items():
        if (rows, start) == (every, phase):
            continue
        # the place of the first target between the signal's own rows
        offset = (phase - start) % rows
        is_held_force = part.holds_force and name == "force"
        delay = offset * h - (rows * h / 2 if is_held_force else 0.0)
        cutoff = _CUTOFF * 0.5 / (every * h)
        filtered = smoothed(signals[name][start::rows], rows * h, cutoff, 1, 0, delay)
        index = (at - start - offset) // rows - edge(rows * h, cutoff)
        inside = np.flatnonzero((index >= 0) & (index < len(filtered)))
        values = np.full((len(at), 6), np.nan)
        values[inside] = filtered[index[inside]]
        changed[name] = values
        first = max(first, int(inside[0]) if inside.size else 0)
        last = min(last, int(inside[-1]) + 1 if inside.size else 0)
    if last - first < 2:
        raise LogError(f"{part.where}: {n} rows are too few for readings that are held for {every} of them")
    kept = slice(phase + first * every, phase + (last - 1) * every + 1, every)
    # a force that was brought to other rows belongs to its row; one that is held as long as lengths are stays held
    changed = {name: values[first:last] for name, values in changed.items()}
    return replace(part.rows(kept), holds_force=part.holds_force and "force" not in changed, **changed), notes
