"""Candidates of a search, run in parallel over the same members: a generation is one batch."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.harness.ensemble.chunk import SIZE, Reduced, check_memory, limits_of_members, margins_of, reduced
from gough_stewart.harness.ensemble.data import INTEGRATION_ERROR, MARGINS
from gough_stewart.harness.ensemble.workers import cores
from gough_stewart.harness.errors import TuningError
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.overrides import Values
from gough_stewart.harness.experiment.preparation import Batch, PreparedMembers
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.loop.folding import FoldsOfRows
from gough_stewart.harness.results.metric_folds import columns_of, folds_of_loop
from gough_stewart.harness.sampling.choice import EnsembleChoice
from gough_stewart.harness.tuning.conditions import Condition
from gough_stewart.harness.tuning.space import Axis
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.vectors import FloatArray

Point = tuple[float | int, ...]
RunsProgress = Callable[[int], None]


class Evaluation(NamedTuple):
    """The evaluation of a candidate."""

    point: Point
    value: float  # of the metric; infinite if too many members failed
    conditions: tuple[float, ...]  # the metric of each
    failed: int  # number of members that did not complete
    reason: str  # cause of the first failure
    metrics: Mapping[str, FloatArray] = {}  # further metrics of its members (members,), NaN of those that failed


@dataclass(frozen=True)
class Goal:
    """The objective of the search."""

    metric: str  # to be minimised
    conditions: tuple[Condition, ...]
    quantile: float  # over the members, of the metric and of metrics with an upper bound

    def violation(self, found: Evaluation) -> float:
        """The violation of all conditions, 0 if they hold; failed members count as the worst."""
        total = sum(c.violation(value) for c, value in zip(self.conditions, found.conditions, strict=True))
        return total + (1e6 * (1 + found.failed) if not np.isfinite(found.value) else 0.0)


class Candidates:
    """Runs points of a search over the members of an experiment, the same for all points (common random numbers)."""

    def __init__(self, experiment: Experiment, members: int, seed: int | None = None, controller: Any = None) -> None:
        self.members = members_for(experiment, members, seed, controller)
        self._own = self.members.draws(0, self.members.count).values
        self._left_out = frozenset[int]()
        self.integration_error = 0.0

    @property
    def count(self) -> int:
        """Number of members that evaluate a candidate."""
        return self.members.count - len(self._left_out)

    @property
    def is_random(self) -> bool:
        """Whether other seeds give other members."""
        sensors, clocks = self.members.nominal.sensors, self.members.nominal.loop
        return bool(self.members.inputs or any(sensors.noise.values()) or clocks.jitter)

    def metrics(self) -> tuple[str, ...]:
        """The metrics of the runs.

        Raises
        ------
        TuningError
            None of the members can run.
        """
        found = self._prepared([({}, k) for k in self._kept])
        if not len(found.batch):
            self.leave_out_impossible()
            raise TuningError(f"{self.members.nominal.where}: no member can run")
        loop = found.batch.member(0).loop
        return tuple(columns_of(FoldsOfRows(loop, folds_of_loop(loop, limits_of_members(found.batch, 1))).results()))

    def leave_out_impossible(self) -> tuple[int, str]:
        """Remove the members that are impossible in the original experiment; their number, and the first reason."""
        impossible = self._prepared([({}, k) for k in range(self.members.count)]).errors
        self._left_out = frozenset(impossible)
        first = str(impossible[min(impossible)]) if impossible else ""
        if len(impossible) == self.members.count:
            raise TuningError(f"{self.members.nominal.where}: no member is possible; the first: {first}")
        return len(impossible), first

    def evaluate(
        self,
        axes: Sequence[Axis],
        points: Sequence[Point],
        goal: Goal,
        progress: RunsProgress | None = None,
        further: Sequence[str] = (),
    ) -> list[Evaluation]:
        """Evaluate all points over all members; `further` metrics are kept for each member.

        Raises
        ------
        TuningError
            A metric that the runs do not have.
        SharedMemoryError
            As `check_memory`.
        """
        names = [goal.metric, *(condition.metric for condition in goal.conditions), *further]
        numbers = np.full((len(points), self.members.count, len(names)), np.nan)
        completed = np.zeros((len(points), self.members.count), dtype=bool)
        reasons: dict[int, str] = {}
        kept, paths = self._kept, [axis.place.path for axis in axes]
        others = [dict(zip(paths, point, strict=True)) for point in points]
        every = [(c, k) for c in range(len(points)) for k in kept]
        for first in range(0, len(every), SIZE):
            part = every[first : first + SIZE]
            found = self._prepared([(others[c], k) for c, k in part])
            for at in sorted(found.errors):
                reasons.setdefault(part[at][0], str(found.errors[at]))
            if not len(found.batch):
                continue
            outcomes, columns, _ = run = self._run(found.batch, names)
            check_memory(found.batch, run, lambda one: self._run(one, names))
            unknown = np.full(len(outcomes), np.nan)  # margins are not part of runs
            rows = np.stack([columns.get(name, unknown) for name in names], axis=1)
            for at, row, outcome in zip(found.numbers.tolist(), rows, outcomes, strict=True):
                c, k = part[at]
                numbers[c, k], completed[c, k] = row, outcome.status == "completed"
                if outcome.status != "completed":
                    reasons.setdefault(c, str(outcome.cause))
            if progress is not None:
                progress(len(found.batch))
        for at in [at for at, name in enumerate(names) if name.startswith(MARGINS)]:
            numbers[:, :, at] = [[margin] for margin in self._margins(axes, points, names[at])]
        numbers[~completed] = np.nan
        return [
            _evaluation(point, numbers[c][kept], completed[c][kept], goal, reasons.get(c, ""))._replace(
                metrics=dict(zip(further, numbers[c][kept].T[len(names) - len(further) :], strict=True))
            )
            for c, point in enumerate(points)
        ]

    @property
    def _kept(self) -> list[int]:
        """The members that evaluate a candidate."""
        return [k for k in range(self.members.count) if k not in self._left_out]

    def _prepared(self, members: Sequence[tuple[Values, int]]) -> PreparedMembers:
        """Members by number, with other values than their own."""
        return self.members.prepared_with(
            [{**self._own[k], **values} for values, k in members], [k for _, k in members]
        )

    def _margins(self, axes: Sequence[Axis], points: Sequence[Point], name: str) -> list[float]:
        """Margins of the linear loop of the nominal machine; not of every member, since each takes a second."""
        found = []
        for point in points:
            values = {axis.place.path: value for axis, value in zip(axes, point, strict=True)}
            batch = self.members.prepared_with([values], [None]).batch
            try:
                margins = margins_of([batch.member(k) for k in range(len(batch))])
                found.append(float(margins[name][0]) if len(batch) else np.nan)
            except GoughStewartError:
                found.append(np.nan)
        return found

    def _run(self, batch: Batch, names: Sequence[str]) -> Reduced:
        """Outcomes and metrics of members."""
        run = reduced(batch, self.members.stepping, cores(), names=names)
        self.integration_error = max(self.integration_error, float(np.max(run.columns[INTEGRATION_ERROR])))
        return run


def members_for(experiment: Experiment, members: int, seed: int | None, controller: Any = None) -> Members:
    """A number of members of an experiment; without `[ensemble]` they differ only in noise and jitter."""
    choice = experiment.ensemble
    if choice is None:
        choice = EnsembleChoice.built().model_validate({})
    # search and test may need other numbers of members than the design allows
    sampling = "random" if choice.sampling in ("saltelli", "latin_hypercube") else choice.sampling
    update = {"members": members, "sampling": sampling, "seed": choice.seed if seed is None else seed}
    return Members(experiment.model_copy(update={"ensemble": choice.model_copy(update=update)}), controller)


def _evaluation(
    point: Point, numbers: FloatArray, completed: np.ndarray[Any, np.dtype[np.bool_]], goal: Goal, reason: str
) -> Evaluation:
    """Quantiles over the members; a member that failed, or has no value, counts as the worst."""
    failed = int((~completed).sum())

    def quantile(column: int, is_upper: bool) -> float:
        worst = np.inf if is_upper else -np.inf
        values = np.sort(np.where(completed & np.isfinite(numbers[:, column]), numbers[:, column], worst))
        # the value that this share of the members reaches, without interpolation, which could involve infinity
        rank = math.ceil(goal.quantile * len(values) - 1e-9)
        return float(values[rank - 1] if is_upper else values[-rank])

    conditions = tuple(quantile(1 + k, condition.is_upper) for k, condition in enumerate(goal.conditions))
    return Evaluation(point, quantile(0, True), conditions, failed, reason)
