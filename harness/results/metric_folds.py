"""The metrics of a run: each is declared here once, with the fold over rows that computes it.

The same folds, in machine code, give the metrics of a record, of a run, and of thousands of members.
"""

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, reduce
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.fmu_build.libraries import folds_sources, machine_code, vector_library
from gough_stewart.fmu_build.toolchain import Library
from gough_stewart.harness.loop.folds import (
    FORCES,
    MOTORS,
    Fold,
    Kind,
    Reduction,
    State,
    TermFold,
    TermRow,
)
from gough_stewart.harness.loop.rows import FoldKernels
from gough_stewart.harness.plants.signals import of_legs
from gough_stewart.harness.report.quantities import (
    ANGLE,
    ENERGY,
    FORCE,
    LENGTH,
    NUMBER,
    PERCENT,
    POWER,
    SHARE,
    TIME,
    Quantity,
)
from gough_stewart.harness.results.record_data import DRIVE_LIMITS
from gough_stewart.model.vectors import Array, FloatArray, greater, less, maximum, reached, where

STROKE_EXCEEDED = "flag.stroke_exceeded"
# Terms of flags, with their sizes.
_COUNTED = {"legs": 6, "any": 1}
_OF_SQUARES: tuple[Kind, ...] = ("largest", "sum")
# Axes of the pose: name, signal, and place in it.
AXES = (
    *((name, "position", place) for place, name in enumerate(("x", "y", "z"))),
    *((name, "orientation", place) for place, name in enumerate(("roll", "pitch", "yaw"))),
)
# The rise is from `LOW` to `HIGH`; a response has settled when it stays within `BAND` of its final value.
LOW, HIGH, BAND = 0.1, 0.9, 0.02
# References closer than this [m, rad], or this share of the largest, count as equal. That of a step has to be constant
# over this share of the rows at the end.
_ROUNDING, _REST = 1e-9, 0.1
# Sources of the machine code, besides those of the plant's.
_SOURCES = (("gough_stewart.harness.loop", "folds.py"), (str(__package__), "metric_folds.py"))


class Metric(NamedTuple):
    """A number of a run, or one for each leg or axis."""

    path: str
    text: str  # in tables, of one number for all legs or axes
    quantity: Quantity
    sentence: str
    better: Literal["smaller", "larger"] | None = None
    is_compared: bool = True  # whether it is shown beside that of other runs
    is_least: bool = False  # of several legs or axes, the least stands for all; of other metrics, the largest


@dataclass(frozen=True, eq=False)
class CoveredRows(Fold):
    """How much of the run the metrics cover: rows count as long as what they need is finite."""

    time: FloatArray
    needs: Sequence[str] = ("position", "orientation", "leg_length", "leg_velocity", FORCES)
    metrics = (
        Metric("rows", "rows", NUMBER, "number of rows that the metrics cover", None, False),
        Metric("duration", "duration", TIME, "time that the metrics cover", None, False),
    )

    def result(self, _state: State, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """`rows` and `duration`."""
        duration = np.where(rows > 0, self.time[rows - 1] - self.time[0], np.nan)
        return _named(self.metrics, (rows.astype(float), duration))


class Tracking(TermFold):
    """RMS and peak of an error, reference − actual, and of its Euclidean norm, and what is left of that at the end.

    The end is the last tenth of the rows, in which a reference that steps is at rest; `rows` are those of a run that
    comes to its end, None of one that has ended early.
    """

    def __init__(self, name: str, text: str, size: int, quantity: Quantity, has_norm: bool, rows: int | None) -> None:
        self.needs, self._has_norm, self._rows = (f"error.{name}",), has_norm, rows
        self.kernel, self.sizes = "tracking_norm" if has_norm else "tracking", {"error": size}
        self.term_sizes = {"square": size, **({"norm": 1, "end": 1} if has_norm else {})}
        squares = [term for term in self.term_sizes if term != "end"]
        self.reductions = {f"{kind} {term}": Reduction(kind, term) for term in squares for kind in _OF_SQUARES}
        self.parameters: Mapping[str, Any] = {}
        if has_norm:
            self.reductions["final"] = Reduction("largest", "end")
            self.parameters = {"end": 0.0 if rows is None else float(rows - max(2, math.ceil(_REST * rows)))}
        path, element = f"tracking.{name}", "axis" if has_norm else "leg"
        of_one = " of an axis" if has_norm else ""
        declared = [
            ("rms", f"{text}, RMS{of_one}", f"√(∑ e²/n) of the {text}, by {element}", not has_norm),
            ("peak", f"{text}, peak{of_one}", f"largest |e| of the {text}, by {element}", not has_norm),
            ("norm_rms", f"{text}, RMS", f"RMS of the {text}'s Euclidean norm", True),
            ("norm_peak", f"{text}, peak", f"largest norm of the {text}", True),
            ("norm_final", f"{text}, at the end", f"largest norm of the {text} in the last tenth of the run", True),
        ]
        self.metrics = tuple(
            Metric(f"{path}.{kind}", title, quantity, sentence, "smaller", is_compared)
            for kind, title, sentence, is_compared in declared[: 5 if has_norm else 2]
        )

    def terms(self, row: TermRow) -> Iterator[tuple[str, Array]]:
        """Squares, also of the norm."""
        error = row["error"]
        square = error * error
        yield "square", square
        if self._has_norm:
            x, y, z = (square[..., k : k + 1, :] for k in range(3))
            norm = x + y + z
            yield "norm", norm
            yield "end", where(less(row.index, row.parameters["end"]), 0.0, norm)

    def result(self, state: State, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """RMS = √(∑ e²/n), and the largest |e|; of the norm also at the end, which a run that ended early has not."""
        values = [np.sqrt(state["sum square"] / rows), np.sqrt(state["largest square"])]
        if self._has_norm:
            total, peak, final = (state[name][0] for name in ("sum norm", "largest norm", "final"))
            values += [np.sqrt(total / rows), np.sqrt(peak), np.where(rows == self._rows, np.sqrt(final), np.nan)]
        return _named(self.metrics, values, rows > 0)


class DriveLoads(TermFold):
    """Forces F, power F·ṡ and work F Δs of the drives, and how much of the platform's limits they use.

    Drives move the motors' side s of elastic legs; of rigid legs that is their length.

    A force is held over its row. So the power is the larger of those at both ends of the row, with the velocity of the
    next row at its end; and the last row, which lasts for no time, does not count in the RMS and does no work.
    """

    needs = (FORCES, *reversed(MOTORS))
    without_limits = (
        Metric("force.peak", "peak force", FORCE, "largest |F|, by leg", "smaller"),
        Metric("force.rms", "RMS force", FORCE, "RMS of F, by leg", "smaller"),
        Metric("power.peak", "peak power", POWER, "largest |F·ṡ|, ṡ at both ends of each row, by leg", "smaller"),
        Metric("power.mean", "mean power", POWER, "`energy.net` over the duration, by leg"),
        Metric("energy.net", "work of a leg, net", ENERGY, "∑ F_k (s_{k+1} − s_k) = ∫ F·ṡ dt, by leg", None, False),
        Metric("energy.absolute", "work of a leg, absolute", ENERGY, "∑ |F_k (s_{k+1} − s_k)|, by leg", None, False),
        Metric("energy.absolute_total", "work, absolute", ENERGY, "`energy.absolute` of all legs", "smaller"),
        Metric("energy.net_total", "work, net", ENERGY, "`energy.net` of all legs"),
    )

    kernel, sizes = "drives", {"force": 6, "velocity": 6, "position": 6}
    term_sizes: Mapping[str, int] = dict.fromkeys(
        ("velocity", "force", "power", "power at the end", "work", "size of work"), 6
    )
    reductions: Mapping[str, Reduction] = {
        **{f"peak {term}": Reduction("largest", term) for term in ("velocity", "force", "power", "power at the end")},
        **{
            f"beyond {term}": Reduction("first", term, greater, f"{term} limit")
            for term in ("velocity", "force", "power")
        },
        "beyond power at the end": Reduction("first", "power at the end", greater, "power limit"),
        "total": Reduction("sum but last", "force"),
        "net": Reduction("sum", "work"),
        "absolute": Reduction("sum", "size of work"),
    }

    def __init__(self, time: FloatArray, limits: Mapping[str, Any]) -> None:
        self._time = time
        self._limits = {k: limits[limit.name] for k, limit in enumerate(DRIVE_LIMITS) if limit.name in limits}
        metrics = [*self.without_limits]
        for name, text, quantity in (DRIVE_LIMITS[k] for k in self._limits):
            path, limit = f"limits.{name}", f"the platform's limit of the {text}, by leg where they differ"
            used, first = "largest share of the limit, by leg", "when the limit was first exceeded, by leg"
            metrics += [
                Metric(f"{path}.limit", f"limit of {text}", quantity, limit, None, False, is_least=True),
                Metric(f"{path}.used", f"{text}, of its limit", SHARE, used, "smaller"),
                Metric(f"{path}.first_exceeded", f"{text}, first beyond", TIME, first, None, False, is_least=True),
            ]
        self.metrics = tuple(metrics)
        self.parameters = {
            f"{quantity} limit": of_legs(np.square(self._limits.get(k, np.inf)))
            for k, quantity in enumerate(("velocity", "force", "power"))
        }

    def terms(self, row: TermRow) -> Iterator[tuple[str, Array]]:
        """Squares of ṡ, F and F ṡ, with the force of the row and the one that ends at it, and the latter's work."""
        held, velocity = row.before["force"], row["velocity"] * row["velocity"]
        yield "velocity", velocity
        yield "power at the end", velocity * (held * held)
        force = row["force"] * row["force"]
        yield "force", force
        force = force * velocity
        yield "power", force
        work = (row["position"] - row.before["position"]) * held
        yield "work", work
        yield "size of work", np.abs(work)

    def result(self, state: State, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """`force`, `power`, `energy`, `limits`."""
        duration = self._time[rows - 1] - self._time[0]
        mean_square = np.where(rows > 1, state["total"], state["total.last"]) / np.maximum(rows - 1, 1)
        peak = np.maximum(state["peak power"], state["peak power at the end"])
        velocity, force, power = (np.sqrt(square) for square in (state["peak velocity"], state["peak force"], peak))
        # the power at the end of a row is known at the next one
        of_power = np.minimum(state["beyond power"], np.maximum(state["beyond power at the end"] - 1, 0))
        beyond = (state["beyond velocity"], state["beyond force"], of_power)
        net, absolute = state["net"], state["absolute"]
        mean = np.where(duration > 0, net / duration, np.nan)
        totals = (absolute.sum(axis=0), net.sum(axis=0))
        values = [force, np.sqrt(mean_square), power, mean, net, absolute, *totals]
        for k, limit in self._limits.items():
            first = beyond[k]
            row = np.where(np.isfinite(first), first, 0.0).astype(np.intp)
            since = np.where(np.isfinite(first), self._time[row], np.nan)
            limits = of_legs(limit)
            stated = np.broadcast_to(limit if np.ndim(limit) < 2 else limits, (*np.shape(limit)[1:], *rows.shape))
            values += [stated, (velocity, force, power)[k] / limits, since]
        return _named(self.metrics, values, rows > 0)


class Saturation(TermFold):
    """The share of time for which a limit of the actuators acts, by leg and for any leg."""

    kernel, sizes, term_sizes = "saturation", {"flag": 6}, _COUNTED
    reductions: Mapping[str, Reduction] = {term: Reduction("sum but last", term) for term in _COUNTED}
    parameters: Mapping[str, Any] = {}

    def __init__(self, name: str) -> None:
        self.needs, text, path = (f"flag.{name}",), name.replace("_", " "), f"saturation.{name}"
        share = "share of the rows but the last in which"
        self.metrics = (
            Metric(f"{path}.legs", f"{text}, a leg", SHARE, f"{share} a leg is {text}, by leg", "smaller", False),
            Metric(f"{path}.any", text, SHARE, f"{share} any leg is {text}", "smaller"),
        )

    def terms(self, row: TermRow) -> Iterator[tuple[str, Array]]:
        """Flags by leg, and of any leg."""
        yield from _counted(row["flag"])

    def result(self, state: State, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """Shares of the rows but the last, or of a single one."""
        legs, any_leg = (
            np.where(rows > 1, state[term], state[f"{term}.last"]) / np.maximum(rows - 1, 1) for term in _COUNTED
        )
        return _named(self.metrics, (legs, any_leg[0]), rows > 0)


class StrokeUse(TermFold):
    """Lengths of the legs, their distance from the ends of the stroke, and the rows in which they are beyond it.

    Flags of the rows count where there are any, as in a record; else what the limits say of the lengths.
    """

    metrics = (
        Metric("stroke.shortest", "shortest leg", LENGTH, "shortest length, by leg", None, False, True),
        Metric("stroke.longest", "longest leg", LENGTH, "largest length, by leg", None, False),
        Metric("stroke.margin", "stroke margin", LENGTH, "to the nearest end of the stroke; < 0 beyond it", "larger"),
        Metric("stroke.exceeded.legs", "beyond stroke, a leg", SHARE, "share of rows beyond, by leg", "smaller", False),
        Metric("stroke.exceeded.any", "beyond stroke", SHARE, "share of the rows with any leg beyond it", "smaller"),
    )

    def __init__(self, limits: Mapping[str, Any], has_flags: bool = False, knows_exceeded: bool = True) -> None:
        self._low, self._high = limits.get("leg_length_min"), limits.get("leg_length_max")
        self._has_flags, self._knows_exceeded = has_flags, knows_exceeded
        self.kernel = "stroke_of_flags" if has_flags else "stroke"
        self.needs = ("leg_length", *((STROKE_EXCEEDED,) if has_flags else ()))
        self.sizes = {"length": 6, **({"flag": 6} if has_flags else {})}
        self.term_sizes = {"length": 6, **_COUNTED}
        self.reductions = {"shortest": Reduction("smallest", "length"), "longest": Reduction("largest", "length")}
        self.reductions |= {term: Reduction("sum", term) for term in _COUNTED}
        low, high = (of_legs(none if end is None else end) for end, none in ((self._low, 0.0), (self._high, np.inf)))
        self.parameters = {} if has_flags else {"least": low, "most": high}

    def terms(self, row: TermRow) -> Iterator[tuple[str, Array]]:
        """Lengths, and which are beyond the stroke."""
        length = row["length"]
        yield "length", length
        if self._has_flags:
            yield from _counted(row["flag"])
        else:
            yield from _counted(maximum(less(length, row.parameters["least"]), greater(length, row.parameters["most"])))

    def result(self, state: State, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """Ends, the least distance to a limit, and shares of the rows."""
        shortest, longest = state["shortest"], state["longest"]
        margins = [] if self._low is None else [(shortest - of_legs(self._low)).min(axis=0)]
        margins += [] if self._high is None else [(of_legs(self._high) - longest).min(axis=0)]
        margin = np.min(margins, axis=0) if margins else np.full(rows.shape, np.nan)
        values = [shortest, longest, margin]
        if self._knows_exceeded:
            values += [state["legs"] / rows, state["any"][0] / rows]
        return _named(self.metrics[: len(values)], values, rows > 0)


class ReferenceStep(NamedTuple):
    """The step of each reference (...)."""

    exists: NDArray[np.bool_]
    first: FloatArray
    last: FloatArray
    start: NDArray[np.intp]  # the row at which the response starts


def step_in(reference: FloatArray) -> ReferenceStep:
    """The step in each reference (n, ...), from its first value to its last, at which it stays.

    It starts at the row of a jump, or else at the last row at which the reference has its first value.
    """
    n = len(reference)
    first, last = reference[0], reference[-1]
    rounding = _ROUNDING * np.maximum(1.0, np.abs(reference).max(axis=0))
    rest = max(2, math.ceil(_REST * n))
    exists = (np.abs(last - first) > rounding) & ~(np.abs(reference[-rest:] - last).max(axis=0) > rounding)
    start = n - 1 - (np.abs(reference - first) <= rounding)[::-1].argmax(axis=0)
    following = np.take_along_axis(reference, np.minimum(start + 1, n - 1)[None], axis=0)[0]
    # a jump is at the first row with the new value
    return ReferenceStep(exists, first, last, start + (exists & (np.abs(following - last) <= rounding)))


class StepResponse(TermFold):
    """The response (y − from)/(to − from) of an axis to the step of its reference, as in python-control's `step_info`.

    A member that ended early has one if its reference steps in its part of the run as in the whole. An axis is given by
    its place in `AXES`, with times of all rows (n,) [s], its reference at them (n, N) or (n, 1), and its steps.
    """

    kernel, sizes = "step_response", {"pose": 1}
    term_sizes: Mapping[str, int] = {"pose": 1, "response": 1, "distance": 1}
    reductions: Mapping[str, Reduction] = {
        "pose": Reduction("last", "pose"),
        "highest": Reduction("largest", "response"),
        "low": Reduction("first", "response", reached, LOW),
        "high": Reduction("first", "response", reached, HIGH),
        "settled": Reduction("after last", "distance", reached, BAND),
    }

    def __init__(self, axis: int, time: FloatArray, reference: FloatArray, step: ReferenceStep) -> None:
        name, signal, place = AXES[axis]
        self.needs, self.begins = (signal,), {"pose": place}
        path, pose = f"step_response.{name}", LENGTH if signal == "position" else ANGLE
        settled = "until it stays within 2 % of the step"
        overshoot = "overshoot in percent of the step; 0 if it did not rise"
        self.metrics = (
            Metric(f"{path}.from", f"{name}: from", pose, "the reference before the step", None, False),
            Metric(f"{path}.to", f"{name}: to", pose, "the reference after the step", None, False),
            Metric(f"{path}.at", f"{name}: step at", TIME, "start of the response", None, False),
            Metric(f"{path}.overshoot_percent", f"{name}: overshoot", PERCENT, overshoot, "smaller"),
            Metric(f"{path}.rise_time", f"{name}: rise time", TIME, "from 10 to 90 % of the step"),
            Metric(f"{path}.settling_time", f"{name}: settling time", TIME, settled, "smaller"),
            Metric(f"{path}.final_error", f"{name}: final error", pose, "reference − actual at the end", "smaller"),
        )
        self._time, self._reference, self._step = time, reference, step
        self.parameters = {
            "from": step.first,
            # without a step, any value but 0 to avoid a division by zero
            "span": np.where(step.exists, step.last - step.first, 1.0),
            "start": step.start.astype(float),
        }

    def terms(self, row: TermRow) -> Iterator[tuple[str, Array]]:
        """The response (y − from)/(to − from), none before the start, and its distance from the end."""
        pose, is_before = row["pose"], less(row.index, row.parameters["start"])
        response = where(is_before, -np.inf, (pose - row.parameters["from"]) / row.parameters["span"])
        yield "pose", pose
        yield "response", response
        yield "distance", np.abs(response - 1.0)

    def result(self, state: State, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """Metrics of the step; NaN without one."""
        pose, highest, low, high, settled = (state[name][0] for name in self.reductions)
        first, last, start = (np.broadcast_to(values, rows.shape) for values in self._step[1:])
        exists = self._step.exists & (rows > 0)
        for n in np.unique(rows[(rows > 0) & (rows < len(self._time))]).tolist():
            members = rows == n
            part = step_in(self._reference[:n] if self._reference.shape[1] == 1 else self._reference[:n, members])
            # a constant reference has values that are equal only up to rounding
            is_near = np.abs(part.last - last[members]) <= 1e-9 * np.maximum(1.0, np.abs(last[members]))
            exists[members] &= part.exists & (part.start == start[members]) & is_near
        began, rose = self._time[np.minimum(start, rows - 1)], highest >= HIGH
        # in a part of the run without a step, rows may be beyond its end; of a level that was not reached, infinite
        places = [np.minimum(row, rows - 1).astype(np.intp) for row in (low, high, settled)]
        to_low, to_high, to_rest = (self._time[row] - began for row in places)
        numbers: tuple[Any, ...] = (
            first,
            last,
            began,
            100 * np.maximum(highest - 1, 0.0),
            np.where(rose, to_high - to_low, np.nan),
            np.where(rose & (settled < rows), to_rest, np.nan),
            last - pose,
        )
        return _named(self.metrics, numbers, exists)


def metric_folds(
    time: FloatArray,
    reference: FloatArray | None,
    limits: Mapping[str, Any],
    known: Callable[[str], bool] | None = None,
    wanted: Collection[str] | None = None,
    is_whole: bool = True,
) -> list[Fold]:
    """The folds that compute metrics of runs whose rows have these times (n,) [s].

    Reference poses, first of the reference signals, are (n, 6 or more), or (n, N, 6 or more) for members whose
    references differ. A limit of the nominal platform is a number, one per member (N,), or None; of legs that differ a
    list of six numbers, or an array (N, 6). `known` says whether the rows have a column; by default they have all,
    errors only with a reference. Metrics that are not `wanted` may be left out. Unless the rows are whole, the run has
    ended before the last time that was planned.
    """
    rows = len(time) if is_whole else None
    stated = {name: np.array([v]) if isinstance(v, list) else v for name, v in limits.items() if v is not None}
    has_flags = known is not None and known(STROKE_EXCEEDED)
    steps: list[Any] = []
    if reference is not None:
        for axis in range(len(AXES)):
            # (n, N), or (n, 1) if common to all members
            pose = np.atleast_2d(reference[..., axis].T).T
            if (step := step_in(pose)).exists.any():
                steps.append(StepResponse(axis, time, pose, step))
    folds = [
        Tracking("position", "position error", 3, LENGTH, has_norm=True, rows=rows),
        Tracking("orientation", "orientation error", 3, ANGLE, has_norm=True, rows=rows),
        Tracking("leg_length", "leg error", 6, LENGTH, has_norm=False, rows=rows),
        *steps,
        DriveLoads(time, stated),
        Saturation("force_limited"),
        Saturation("rate_limited"),
        StrokeUse(stated, has_flags, knows_exceeded=known is None or has_flags),
    ]
    has_column = known or (lambda column: reference is not None or not column.startswith("error."))
    if wanted is not None:
        folds = [fold for fold in folds if any(metric.path in wanted for metric in fold.metrics)]
    covered = CoveredRows(time, tuple(filter(has_column, CoveredRows.needs)))
    return [covered, *(fold for fold in folds if all(map(has_column, fold.needs)))]


# Of a run that has all metrics: its reference steps on all axes, and the platform states all limits.
_OF_ANY_RUN: list[Any] = metric_folds(
    np.arange(40.0), np.repeat([[0.0] * 6, [1.0] * 6], 20, axis=0), {limit.name: 1.0 for limit in DRIVE_LIMITS}
)
METRICS = (
    *sorted((m for fold in _OF_ANY_RUN for m in fold.metrics), key=lambda metric: metric.path.startswith("limits.")),
    # the linear loop has no rows: whoever computes its margins gives these
    Metric("margins.disk", "disk margin", NUMBER, "disk margin of the linear loop", "larger", False),
    Metric("margins.stable", "stable", NUMBER, "whether the linear loop is stable: 1 or 0", "larger", False),
)
_BY_PATH = {metric.path: metric for metric in METRICS}


def metric_of(path: str) -> Metric:
    """The metric of a path; of one that is not declared, with the path as its text."""
    return _BY_PATH.get(path) or Metric(path, path, NUMBER, "", is_compared=False)


def _counted(flags: Array) -> Iterator[tuple[str, Array]]:
    """Flags by leg, and whether any leg has one."""
    yield "legs", flags
    yield "any", reduce(maximum, (flags[..., leg : leg + 1, :] for leg in range(6)))


def _named(
    metrics: Sequence[Metric], results: Sequence[FloatArray], is_defined: NDArray[np.bool_] | bool = True
) -> dict[str, FloatArray]:
    """Results by path where they are defined and finite, NaN elsewhere."""
    return {
        metric.path: np.where(is_defined & np.isfinite(values), values, np.nan)
        for metric, values in zip(metrics, results, strict=True)
    }


@cache
def metric_kernels() -> FoldKernels:
    """The machine code of all metrics for this processor; a BuildError or OSError if it cannot be built."""
    return FoldKernels(machine_code(folds_code()).path)


def folds_code() -> Library:
    """Name, sources and their state."""

    def sources() -> Any:
        # of a run, and of a record, which has flags of the stroke
        all_folds = [*_OF_ANY_RUN, StrokeUse({}, has_flags=True)]
        folds = {fold.kernel: fold for fold in all_folds if isinstance(fold, TermFold)}
        return folds_sources([fold.traced() for fold in folds.values()])

    return vector_library("folds", sources, files=_SOURCES)
