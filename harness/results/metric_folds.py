"""The metrics of a run: each is declared here once, with the fold over rows that computes it.

The same folds give the metrics of a record, of a run, and of thousands of members.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.loop.folds import FORCES, Block, Fold, State, add_rows
from gough_stewart.harness.loop.loop import Limits, Loop, stroke_of
from gough_stewart.harness.report.quantities import (
    ANGLE,
    ENERGY,
    FORCE,
    LENGTH,
    NUMBER,
    POWER,
    SHARE,
    TIME,
    Quantity,
)
from gough_stewart.harness.results.limits import DRIVE_LIMITS, DriveLimit, limited_quantities
from gough_stewart.harness.results.metric import Metric, Shown
from gough_stewart.harness.results.step_fold import STEP_METRICS, Steps
from gough_stewart.model.vectors import FloatArray

STROKE_EXCEEDED = "flag.stroke_exceeded"


class Rows(Fold):
    """How much of the run the metrics cover: rows count as long as what they need is finite."""

    needs = ("position", "orientation", "leg_length", "leg_velocity", FORCES)
    metrics = (
        Metric("rows", "rows", NUMBER, "number of rows that the metrics cover", None, False),
        Metric("duration", "duration", TIME, "time that the metrics cover", None, False),
    )

    def __init__(self, time: FloatArray) -> None:
        self._time = time

    def rows(self, _state: State, _block: Block) -> None:
        """Nothing to add."""

    def result(self, _state: State, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """`rows` and `duration`."""
        return _named(self.metrics, (rows.astype(float), _defined(rows > 0, _duration(self._time, rows))))


class Tracking(Fold):
    """RMS and peak of an error, reference − actual, and of its Euclidean norm."""

    def __init__(self, name: str, what: str, size: int, quantity: Quantity, has_norm: bool) -> None:
        self.needs, self._size, self._has_norm = (f"error.{name}",), size, has_norm
        path, of, by = f"tracking.{name}", " of an axis" if has_norm else "", "axis" if has_norm else "leg"
        own = [
            Metric(f"{path}.rms", f"{what}, RMS{of}", quantity, f"√(∑ e²/n) of the {what}, by {by}", "smaller"),
            Metric(f"{path}.peak", f"{what}, peak{of}", quantity, f"largest |e| of the {what}, by {by}", "smaller"),
        ]
        if has_norm:
            own = [each._replace(is_compared=False) for each in own]
            own += [
                Metric(f"{path}.norm_rms", f"{what}, RMS", quantity, f"RMS of the {what}'s Euclidean norm", "smaller"),
                Metric(f"{path}.norm_peak", f"{what}, peak", quantity, f"largest norm of the {what}", "smaller"),
            ]
        self.metrics = tuple(own)

    def start(self, members: int) -> State:
        """Sums and peaks of squares; those of the norm come last."""
        size = (self._size + self._has_norm, members)
        return {"total": np.zeros(size), "peak": np.zeros(size)}

    def rows(self, state: State, block: Block) -> None:
        """Add squares."""
        n = self._size
        squares = block.scratch("first", block.rows, *state["total"].shape)
        error = block.of_rows(slice(None), self.needs[0], squares[:, :n])
        np.multiply(error, error, out=squares[:, :n])
        if self._has_norm:
            norm = squares[:, n]
            np.add(squares[:, 0], squares[:, 1], out=norm)
            norm += squares[:, 2]
        np.maximum(state["peak"], np.maximum.reduce(squares), out=state["peak"])
        add_rows(state["total"], squares)

    def result(self, state: State, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """RMS = √(∑ e²/n), and the largest |e|."""
        rms, peak, n, some = np.sqrt(state["total"] / rows), np.sqrt(state["peak"]), self._size, rows > 0
        found = (rms[:n], peak[:n], rms[n], peak[n]) if self._has_norm else (rms, peak)
        return _named(self.metrics, [_defined(some, each) for each in found])


def _of_limit(limit: DriveLimit) -> tuple[Metric, ...]:
    path, what = f"limits.{limit.name}", limit.text
    return (
        Metric(f"{path}.limit", f"limit of {what}", limit.quantity, f"the platform's limit of the {what}", None, False),
        Metric(f"{path}.used", f"{what}, of its limit", SHARE, "largest share of the limit, by leg", "smaller"),
        Metric(
            f"{path}.first_exceeded",
            f"{what}, first beyond",
            TIME,
            "when the limit was first exceeded, by leg",
            is_compared=False,
            is_least=True,
        ),
    )


class Drives(Fold):
    """Forces F, power F·L̇ and work F ΔL of the legs, and how much of the platform's limits they use.

    A force is held over its row. So the power is the larger of those at both ends of the row, with the velocity of the
    next row at its end; and the last row, which lasts for no time, does not count in the RMS and does no work.
    """

    needs = (FORCES, "leg_velocity", "leg_length")
    without_limits = (
        Metric("force.peak", "peak force", FORCE, "largest |F|, by leg", "smaller"),
        Metric("force.rms", "RMS force", FORCE, "RMS of F, by leg", "smaller"),
        Metric("power.peak", "peak power", POWER, "largest |F·L̇|, L̇ at both ends of each row, by leg", "smaller"),
        Metric("power.mean", "mean power", POWER, "`energy.net` over the duration, by leg"),
        Metric("energy.net", "work of a leg, net", ENERGY, "∑ F_k (L_{k+1} − L_k) = ∫ F·L̇ dt, by leg", None, False),
        Metric("energy.absolute", "work of a leg, absolute", ENERGY, "∑ |F_k (L_{k+1} − L_k)|, by leg", None, False),
        Metric("energy.absolute_total", "work, absolute", ENERGY, "`energy.absolute` of all legs", "smaller"),
        Metric("energy.net_total", "work, net", ENERGY, "`energy.net` of all legs"),
    )

    def __init__(self, time: FloatArray, limits: Mapping[str, Any]) -> None:
        self._time = time
        self._limits = {k: limits[each.name] for k, each in enumerate(DRIVE_LIMITS) if each.name in limits}
        of_limits = (metric for k in self._limits for metric in _of_limit(DRIVE_LIMITS[k]))
        self.metrics = (*self.without_limits, *of_limits)

    def start(self, members: int) -> State:
        """Sums, and F² of a single row; peaks of squares of velocity, force, power; rows at which they first exceed."""

        def zeros(*size: int) -> FloatArray:
            return np.zeros((*size, members))

        sums = {name: zeros(6) for name in ("total", "only", "net", "absolute")}
        return {**sums, "peak": zeros(3, 6), "first": np.full((3, 6, members), np.inf)}

    def rows(self, state: State, block: Block) -> None:
        """Add squares and work."""
        force, velocity, length = (block.linked(name) for name in self.needs)
        n, members = len(force), force.shape[2]
        of_force = np.multiply(force, force, out=block.scratch("first", n, 6, members))
        of_velocity = np.multiply(velocity, velocity, out=block.scratch("second", n, 6, members))
        squares = limited_quantities(of_velocity, of_force, block.scratch("third", n, 6, members))
        for k, each in enumerate(squares):
            peak = np.maximum.reduce(each)
            if k in self._limits and (peak > (bound := np.square(self._limits[k]))).any():
                beyond = each > bound
                begin = block.first + block.rows - n
                at = np.where(beyond.any(axis=0), begin + beyond.argmax(axis=0), np.inf)
                np.minimum(state["first"][k], at, out=state["first"][k])
            np.maximum(state["peak"][k], peak, out=state["peak"][k])
        if not block.first:
            state["only"][...] = of_force[0]
        add_rows(state["total"], of_force[:-1])
        work = np.subtract(length[1:], length[:-1], out=of_velocity[:-1])
        work *= force[:-1]
        size = np.abs(work, out=squares[2][:-1])
        add_rows(state["net"], work)
        add_rows(state["absolute"], size)

    def result(self, state: State, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """`force`, `power`, `energy`, `limits`."""
        some, duration = rows > 0, _duration(self._time, rows)
        mean_square = np.where(rows > 1, state["total"], state["only"]) / np.maximum(rows - 1, 1)
        velocity, force, power = np.sqrt(state["peak"])
        net, absolute = state["net"], state["absolute"]
        mean = np.where(duration > 0, net / duration, np.nan)
        totals = (absolute.sum(axis=0), net.sum(axis=0))
        found = [force, np.sqrt(mean_square), power, mean, net, absolute, *totals]
        for k, limit in self._limits.items():
            first = state["first"][k]
            row = np.where(np.isfinite(first), first, 0.0).astype(np.intp)
            since = np.where(np.isfinite(first), self._time[row], np.nan)
            found += [np.broadcast_to(limit, rows.shape), (velocity, force, power)[k] / limit, since]
        return _named(self.metrics, [_defined(some, each) for each in found])


class Saturation(Fold):
    """The share of time for which a limit of the actuators acts, by leg and for any leg."""

    def __init__(self, name: str) -> None:
        self.needs, what, path = (f"flag.{name}",), name.replace("_", " "), f"saturation.{name}"
        share = "share of the rows but the last in which"
        self.metrics = (
            Metric(f"{path}.legs", f"{what}, a leg", SHARE, f"{share} a leg is {what}, by leg", "smaller", False),
            Metric(f"{path}.any", what, SHARE, f"{share} any leg is {what}", "smaller"),
        )

    def start(self, members: int) -> State:
        """Counts of rows by leg and, last, for any leg: of all but the last, and of a single one."""
        return {"count": np.zeros((7, members)), "only": np.zeros((7, members))}

    def rows(self, state: State, block: Block) -> None:
        """Count the rows, each when it is no longer the last one."""
        flags = block.linked(self.needs[0])
        _count(state["count"], flags[:-1])
        if not block.first:
            _count(state["only"], flags[:1])

    def result(self, state: State, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """Shares of the rows but the last, or of a single one."""
        shares = _defined(rows > 0, np.where(rows > 1, state["count"], state["only"]) / np.maximum(rows - 1, 1))
        return _named(self.metrics, (shares[:6], shares[6]))


class Stroke(Fold):
    """Lengths of the legs, their distance from the ends of the stroke, and the rows in which they are beyond it.

    Flags of the rows count where there are any, as in a record; else what the limits say of the lengths.
    """

    needs = ("leg_length",)
    metrics = (
        Metric("stroke.shortest", "shortest leg", LENGTH, "shortest length, by leg", None, False, True),
        Metric("stroke.longest", "longest leg", LENGTH, "largest length, by leg", None, False),
        Metric("stroke.margin", "stroke margin", LENGTH, "to the nearest end of the stroke; < 0 beyond it", "larger"),
        Metric(
            "stroke.exceeded.legs",
            "beyond stroke, a leg",
            SHARE,
            "share of the rows beyond the stroke, by leg",
            "smaller",
            False,
        ),
        Metric("stroke.exceeded.any", "beyond stroke", SHARE, "share of the rows with any leg beyond it", "smaller"),
    )

    def __init__(self, limits: Mapping[str, Any], knows_exceeded: bool = True) -> None:
        self._low, self._high = limits.get("leg_length_min"), limits.get("leg_length_max")
        self._limits, self._knows_exceeded = Limits(stroke_of(self._low, self._high)), knows_exceeded

    def start(self, members: int) -> State:
        """Ends of the lengths, and counts of rows by leg and, last, for any leg."""
        ends = {"shortest": np.full((6, members), np.inf), "longest": np.full((6, members), -np.inf)}
        return {**ends, "count": np.zeros((7, members))}

    def rows(self, state: State, block: Block) -> None:
        """Widen the ends, count the rows."""
        length = block["leg_length"]
        shortest, longest = np.minimum.reduce(length), np.maximum.reduce(length)
        if STROKE_EXCEEDED in block:
            _count(state["count"], block[STROKE_EXCEEDED])
        elif self._beyond(shortest).any() or self._beyond(longest).any():
            _count(state["count"], self._beyond(length))
        np.minimum(state["shortest"], shortest, out=state["shortest"])
        np.maximum(state["longest"], longest, out=state["longest"])

    def result(self, state: State, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """Ends, the least distance to a limit, and shares of the rows."""
        shortest, longest = state["shortest"], state["longest"]
        margins = [] if self._low is None else [shortest.min(axis=0) - self._low]
        margins += [] if self._high is None else [self._high - longest.max(axis=0)]
        margin = np.min(margins, axis=0) if margins else np.full(rows.shape, np.nan)
        shares = state["count"] / rows
        every = (shortest, longest, margin, shares[:6], shares[6])
        known = self.metrics if self._knows_exceeded else self.metrics[:3]
        return _named(known, [_defined(rows > 0, each) for each in every[: len(known)]])

    def _beyond(self, lengths: FloatArray) -> NDArray[np.bool_]:
        """Which lengths (..., 6, N) are beyond the stroke."""
        return np.moveaxis(self._limits.beyond_stroke(np.moveaxis(lengths, -2, -1)), -1, -2)


_OF_MARGINS = (
    Metric("margins.disk", "disk margin", NUMBER, "disk margin of the linear loop", "larger", False),
    Metric("margins.stable", "stable", NUMBER, "whether the linear loop is stable: 1 or 0", "larger", False),
)


def _of_motion(time: FloatArray) -> list[Any]:
    return [
        Rows(time),
        Tracking("position", "position error", 3, LENGTH, has_norm=True),
        Tracking("orientation", "orientation error", 3, ANGLE, has_norm=True),
        Tracking("leg_length", "leg error", 6, LENGTH, has_norm=False),
    ]


def _of_legs(time: FloatArray, limits: Mapping[str, Any], knows_exceeded: bool = True) -> list[Any]:
    of_actuators = [Saturation("force_limited"), Saturation("rate_limited")]
    return [Drives(time, limits), *of_actuators, Stroke(limits, knows_exceeded)]


def _declared() -> tuple[Metric, ...]:
    none, limits = np.zeros(0), {limit.name: 1.0 for limit in DRIVE_LIMITS}
    of_legs = [metric for fold in _of_legs(none, limits) for metric in _of(fold)]
    return (
        *(metric for fold in _of_motion(none) for metric in _of(fold)),
        *STEP_METRICS,
        *sorted(of_legs, key=lambda metric: metric.path.startswith("limits.")),
        # the linear loop has no rows: whoever computes its margins gives these
        *_OF_MARGINS,
    )


def _of(fold: Any) -> list[Metric]:
    return [metric._replace(needs=fold.needs) for metric in fold.metrics]


METRICS = _declared()
_BY_PATH = {metric.path: metric for metric in METRICS}


def metric_folds(
    time: FloatArray,
    reference: FloatArray | None,
    limits: Mapping[str, Any],
    known: Callable[[str], bool] | None = None,
    wanted: Collection[str] | None = None,
) -> list[Fold]:
    """The folds that compute metrics of runs.

    Parameters
    ----------
    time
        Times of all rows (n,) [s].
    reference
        Reference poses, first of the reference signals, at all rows: (n, 6 or more), or (n, N, 6 or more) for members
        whose references differ; None without a reference.
    limits
        Limits of the nominal platform by name: a number, or one per member (N,); None or left out for no limit.
    known
        Whether the rows have a column; by default they have all, errors only with a reference.
    wanted
        Paths of metrics; others may be left out.
    """
    stated = {name: value for name, value in limits.items() if value is not None}
    knows_exceeded = known is None or known(STROKE_EXCEEDED)
    steps: list[Any] = [] if reference is None else [Steps(time, reference)]
    rows, *folds = [*_of_motion(time), *steps, *_of_legs(time, stated, knows_exceeded)]

    def has(column: str) -> bool:
        return known(column) if known is not None else reference is not None or not column.startswith("error.")

    def is_wanted(fold: Any) -> bool:
        return wanted is None or any(metric.path in wanted for metric in fold.metrics)

    return [rows, *(fold for fold in folds if all(map(has, fold.needs)) and is_wanted(fold))]


def folds_of_loop(loop: Loop, limits: Mapping[str, Any], wanted: Collection[str] | None = None) -> list[Fold]:
    """The metrics of the members of a loop, all or those that are wanted; limits as of `metric_folds`."""
    return metric_folds(loop.timing.times, loop.reference, limits, wanted=wanted)


def columns_of(results: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Metrics with one number per member (N,), from those by leg or axis: the largest, or the least."""

    def one(path: str, values: FloatArray) -> FloatArray:
        if values.ndim < 2:
            return values
        return np.asarray(np.fmin.reduce(values) if metric_of(path).is_least else values.max(axis=0))

    return {path: one(path, values) for path, values in results.items()}


def metric_of(path: str) -> Metric:
    """The metric of a path; of one that is not declared, with the path as its text."""
    return _BY_PATH.get(path) or Metric(path, path, NUMBER, "", is_compared=False)


def shown_metric(path: str) -> Shown:
    """Words, unit and scale of a metric, by its path."""
    metric = metric_of(path)
    return Shown(metric.text, metric.quantity.unit, metric.quantity.factor)


def _count(counts: FloatArray, flags: NDArray[np.bool_]) -> None:
    """Add the rows of flags (rows, 6, N) by leg and, last, those with any leg."""
    if flags.any():
        counts[:6] += np.count_nonzero(flags, axis=0)
        counts[6] += np.count_nonzero(flags.any(axis=1), axis=0)


def _duration(time: FloatArray, rows: NDArray[np.intp]) -> FloatArray:
    return np.asarray(time[np.maximum(rows - 1, 0)] - time[0]) if len(time) else np.zeros(rows.shape)


def _named(metrics: Sequence[Metric], values: Sequence[FloatArray]) -> dict[str, FloatArray]:
    return {metric.path: each for metric, each in zip(metrics, values, strict=True)}


def _defined(where: NDArray[np.bool_], values: FloatArray) -> FloatArray:
    """Values where they are defined and finite, NaN elsewhere."""
    return np.where(where & np.isfinite(values), values, np.nan)
