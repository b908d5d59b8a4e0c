"""The metrics of a run: each is declared here once, with the fold over rows that computes it.

The same folds give the metrics of a record, of a run, and of thousands of members.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.loop.folds import FORCES, MOTORS, Fold, State
from gough_stewart.harness.loop.loop import Loop, stroke_of
from gough_stewart.harness.loop.term_folds import First, Given, Largest, Reduction, Smallest, Sum, SumButLast, TermFold
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
from gough_stewart.harness.results.limits import DRIVE_LIMITS, DriveLimit
from gough_stewart.harness.results.metric import Metric
from gough_stewart.harness.results.step_fold import STEP_METRICS, steps_of
from gough_stewart.model.operations import greater, less, maximum
from gough_stewart.model.vectors import Array, FloatArray

STROKE_EXCEEDED = "flag.stroke_exceeded"
# Terms of flags, with their sizes.
_COUNTED = {"legs": 6, "any": 1}


class Rows(Fold):
    """How much of the run the metrics cover: rows count as long as what they need is finite."""

    needs = ("position", "orientation", "leg_length", "leg_velocity", FORCES)
    metrics = (
        Metric("rows", "rows", NUMBER, "number of rows that the metrics cover", None, False),
        Metric("duration", "duration", TIME, "time that the metrics cover", None, False),
    )

    def __init__(self, time: FloatArray) -> None:
        self._time = time

    def result(self, _state: State, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """`rows` and `duration`."""
        return _named(self.metrics, (rows.astype(float), _defined(rows > 0, _duration(self._time, rows))))


class Tracking(TermFold):
    """RMS and peak of an error, reference − actual, and of its Euclidean norm."""

    parameters: Mapping[str, Any] = {}

    def __init__(self, name: str, what: str, size: int, quantity: Quantity, has_norm: bool) -> None:
        self.needs, self._has_norm = (f"error.{name}",), has_norm
        self.kernel, self.sizes = "tracking_norm" if has_norm else "tracking", {"error": size}
        self.term_sizes = {"square": size, **({"norm": 1} if has_norm else {})}
        self.reductions = {f"{kind.__name__} {term}": kind(term) for term in self.term_sizes for kind in (Largest, Sum)}
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

    def terms(self, row: Given) -> Iterator[tuple[str, Array]]:
        """Squares, also of the norm."""
        error = row["error"]
        square = error * error
        yield "square", square
        if self._has_norm:
            x, y, z = (square[..., k : k + 1, :] for k in range(3))
            yield "norm", x + y + z

    def result(self, state: State, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """RMS = √(∑ e²/n), and the largest |e|."""
        found: list[FloatArray] = []
        for term in self.term_sizes:
            total, peak = state[f"Sum {term}"], state[f"Largest {term}"]
            found += [np.sqrt(total / rows), np.sqrt(peak)]
        if self._has_norm:
            found[2:] = [each[0] for each in found[2:]]
        return _named(self.metrics, [_defined(rows > 0, each) for each in found])


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


class Drives(TermFold):
    """Forces F, power F·ṡ and work F Δs of the drives, and how much of the platform's limits they use.

    Drives move the motors' side s of legs that give; of rigid legs that is their length.

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
        **{f"peak {term}": Largest(term) for term in ("velocity", "force", "power", "power at the end")},
        **{
            f"beyond {term}": First(term, greater, f"{limit} limit")
            for term, limit in (
                *(("velocity", "velocity"), ("force", "force")),
                *(("power", "power"), ("power at the end", "power")),
            )
        },
        "total": SumButLast("force"),
        "net": Sum("work"),
        "absolute": Sum("size of work"),
    }

    def __init__(self, time: FloatArray, limits: Mapping[str, Any]) -> None:
        self._time = time
        self._limits = {k: limits[each.name] for k, each in enumerate(DRIVE_LIMITS) if each.name in limits}
        of_limits = (metric for k in self._limits for metric in _of_limit(DRIVE_LIMITS[k]))
        self.metrics = (*self.without_limits, *of_limits)
        self.parameters = {
            f"{what} limit": np.square(self._limits.get(k, np.inf))
            for k, what in enumerate(("velocity", "force", "power"))
        }

    def terms(self, row: Given) -> Iterator[tuple[str, Array]]:
        """Squares of ṡ, F and F ṡ, with the force of the row and the one that ends at it, and the latter's work."""
        held, velocity = row.before("force"), row["velocity"] * row["velocity"]
        yield "velocity", velocity
        yield "power at the end", velocity * (held * held)
        force = row["force"] * row["force"]
        yield "force", force
        force = force * velocity
        yield "power", force
        del velocity, force
        work = (row["position"] - row.before("position")) * held
        yield "work", work
        yield "size of work", np.abs(work)

    def result(self, state: State, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """`force`, `power`, `energy`, `limits`."""
        some, duration = rows > 0, _duration(self._time, rows)
        mean_square = np.where(rows > 1, state["total"], state["total.last"]) / np.maximum(rows - 1, 1)
        peak = np.maximum(state["peak power"], state["peak power at the end"])
        velocity, force, power = (np.sqrt(each) for each in (state["peak velocity"], state["peak force"], peak))
        # the power at the end of a row is known at the next one
        of_power = np.minimum(state["beyond power"], np.maximum(state["beyond power at the end"] - 1, 0))
        beyond = (state["beyond velocity"], state["beyond force"], of_power)
        net, absolute = state["net"], state["absolute"]
        mean = np.where(duration > 0, net / duration, np.nan)
        totals = (absolute.sum(axis=0), net.sum(axis=0))
        found = [force, np.sqrt(mean_square), power, mean, net, absolute, *totals]
        for k, limit in self._limits.items():
            first = beyond[k]
            row = np.where(np.isfinite(first), first, 0.0).astype(np.intp)
            since = np.where(np.isfinite(first), self._time[row], np.nan)
            found += [np.broadcast_to(limit, rows.shape), (velocity, force, power)[k] / limit, since]
        return _named(self.metrics, [_defined(some, each) for each in found])


class Saturation(TermFold):
    """The share of time for which a limit of the actuators acts, by leg and for any leg."""

    kernel, sizes, term_sizes = "saturation", {"flag": 6}, _COUNTED
    reductions: Mapping[str, Reduction] = {term: SumButLast(term) for term in _COUNTED}
    parameters: Mapping[str, Any] = {}

    def __init__(self, name: str) -> None:
        self.needs, what, path = (f"flag.{name}",), name.replace("_", " "), f"saturation.{name}"
        share = "share of the rows but the last in which"
        self.metrics = (
            Metric(f"{path}.legs", f"{what}, a leg", SHARE, f"{share} a leg is {what}, by leg", "smaller", False),
            Metric(f"{path}.any", what, SHARE, f"{share} any leg is {what}", "smaller"),
        )

    def terms(self, row: Given) -> Iterator[tuple[str, Array]]:
        """Flags by leg, and of any leg."""
        yield from _counted(row["flag"])

    def result(self, state: State, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """Shares of the rows but the last, or of a single one."""
        legs, some = (
            _defined(rows > 0, np.where(rows > 1, state[term], state[f"{term}.last"]) / np.maximum(rows - 1, 1))
            for term in _COUNTED
        )
        return _named(self.metrics, (legs, some[0]))


class Stroke(TermFold):
    """Lengths of the legs, their distance from the ends of the stroke, and the rows in which they are beyond it.

    Flags of the rows count where there are any, as in a record; else what the limits say of the lengths.
    """

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

    def __init__(self, limits: Mapping[str, Any], has_flags: bool = False, knows_exceeded: bool = True) -> None:
        self._low, self._high = limits.get("leg_length_min"), limits.get("leg_length_max")
        self._has_flags, self._knows_exceeded = has_flags, knows_exceeded
        self.kernel = "stroke_of_flags" if has_flags else "stroke"
        self.needs = ("leg_length", *((STROKE_EXCEEDED,) if has_flags else ()))
        self.sizes = {"length": 6, **({"flag": 6} if has_flags else {})}
        self.term_sizes = {"length": 6, **_COUNTED}
        self.reductions = {
            "shortest": Smallest("length"),
            "longest": Largest("length"),
            **{term: Sum(term) for term in _COUNTED},
        }
        low, high = stroke_of(self._low, self._high)
        self.parameters = {} if has_flags else {"least": low, "most": high}

    def terms(self, row: Given) -> Iterator[tuple[str, Array]]:
        """Lengths, and which are beyond the stroke."""
        length = row["length"]
        yield "length", length
        if self._has_flags:
            yield from _counted(row["flag"])
        else:
            yield from _counted(maximum(less(length, row.of("least")), greater(length, row.of("most"))))

    def result(self, state: State, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """Ends, the least distance to a limit, and shares of the rows."""
        shortest, longest = state["shortest"], state["longest"]
        margins = [] if self._low is None else [shortest.min(axis=0) - self._low]
        margins += [] if self._high is None else [self._high - longest.max(axis=0)]
        margin = np.min(margins, axis=0) if margins else np.full(rows.shape, np.nan)
        every = (shortest, longest, margin, *(state[term] / rows for term in _COUNTED))
        known = self.metrics if self._knows_exceeded else self.metrics[:3]
        found = [_defined(rows > 0, each) for each in every[: len(known)]]
        return _named(known, [*found[:4], *(each[0] for each in found[4:])])


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


def _of_legs(time: FloatArray, limits: Mapping[str, Any], stroke: Stroke) -> list[Any]:
    return [Drives(time, limits), Saturation("force_limited"), Saturation("rate_limited"), stroke]


def _declared() -> tuple[Metric, ...]:
    none, limits = np.zeros(0), {limit.name: 1.0 for limit in DRIVE_LIMITS}
    of_legs = [metric for fold in _of_legs(none, limits, Stroke(limits)) for metric in _of(fold)]
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
    has_flags = known is not None and known(STROKE_EXCEEDED)
    stroke = Stroke(stated, has_flags, knows_exceeded=known is None or has_flags)
    steps: list[Any] = [] if reference is None else steps_of(time, reference)
    rows, *folds = [*_of_motion(time), *steps, *_of_legs(time, stated, stroke)]

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


def _counted(flags: Array) -> Iterator[tuple[str, Array]]:
    """Flags by leg, and whether any leg has one."""
    yield "legs", flags
    yield "any", reduce(maximum, (flags[..., leg : leg + 1, :] for leg in range(6)))


def _duration(time: FloatArray, rows: NDArray[np.intp]) -> FloatArray:
    return np.asarray(time[np.maximum(rows - 1, 0)] - time[0]) if len(time) else np.zeros(rows.shape)


def _named(metrics: Sequence[Metric], values: Sequence[FloatArray]) -> dict[str, FloatArray]:
    return {metric.path: each for metric, each in zip(metrics, values, strict=True)}


def _defined(where: NDArray[np.bool_], values: FloatArray) -> FloatArray:
    """Values where they are defined and finite, NaN elsewhere."""
    return np.where(where & np.isfinite(values), values, np.nan)
