"""Candidates of a search, run in parallel over the same members: a generation is one batch."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.harness.ensemble.chunk import SIZE, limits_of_members, margins_of
from gough_stewart.harness.ensemble.columns import MARGINS
from gough_stewart.harness.errors import TuningError
from gough_stewart.harness.experiment.batch import batch_of
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.pilot import substeps_of
from gough_stewart.harness.experiment.preparation import Prepared
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.loop.folds import FoldsOfRows
from gough_stewart.harness.loop.observe import observe_all
from gough_stewart.harness.results.metric_folds import columns_of, folds_of_loop
from gough_stewart.harness.sampling.choice import EnsembleChoice
from gough_stewart.harness.tuning.conditions import Condition
from gough_stewart.harness.tuning.space import Axis
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.vectors import FloatArray

Point = tuple[float | int, ...]
RunsProgress = Callable[[int], None]
# These determine the machine and its start.
_OF_MACHINES = ("platform", "plant", "start", "reference")


class Evaluation(NamedTuple):
    """The evaluation of a candidate."""

    point: Point
    value: float  # of the metric; infinite if too many members failed
    conditions: tuple[float, ...]  # the metric of each
    failed: int  # number of members that did not complete
    reason: str  # cause of the first failure


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
        self._own = self.members.draws(0, self.members.count)
        self._machines: dict[int, Any] = {}
        self._left_out = frozenset[int]()
        self.substeps = substeps_of(self.members)
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
        some = next((each for _, each in self._prepared((), ()) if not isinstance(each, str)), None)
        if some is None:
            self.leave_out_impossible()
            raise TuningError(f"{self.members.nominal.where}: no member can run")
        folds = folds_of_loop(some.loop, limits_of_members([some], 1))
        return tuple(columns_of(FoldsOfRows(some.loop, folds).results()))

    def leave_out_impossible(self) -> tuple[int, str]:
        """Remove the members that are impossible in the original experiment; their number, and the first reason."""
        prepared = dict(self._prepared((), ()))
        impossible = {k: each for k, each in prepared.items() if isinstance(each, str)}
        self._left_out = frozenset(k for _, k in impossible)
        if len(impossible) == self.members.count:
            reason = next(iter(impossible.values()))
            raise TuningError(f"{self.members.nominal.where}: no member is possible; the first: {reason}")
        return len(impossible), next(iter(impossible.values()), "")

    def evaluate(
        self, axes: Sequence[Axis], points: Sequence[Point], goal: Goal, progress: RunsProgress | None = None
    ) -> list[Evaluation]:
        """Evaluate all points over all members.

        Raises
        ------
        TuningError
            A metric that the runs do not have.
        """
        names = [goal.metric, *(condition.metric for condition in goal.conditions)]
        numbers = np.full((len(points), self.members.count, len(names)), np.nan)
        completed = np.zeros((len(points), self.members.count), dtype=bool)
        reasons: dict[int, str] = {}
        waiting: list[tuple[tuple[int, int], Prepared]] = []

        def run_waiting() -> None:
            values, ended = self._run([each for _, each in waiting], names)
            for ((c, k), _), row, (status, cause) in zip(waiting, values, ended, strict=True):
                numbers[c, k], completed[c, k] = row, status == "completed"
                if status != "completed":
                    reasons.setdefault(c, cause)
            if progress is not None:
                progress(len(waiting))
            waiting.clear()

        for (c, k), each in self._prepared(axes, points):
            if isinstance(each, str):
                reasons.setdefault(c, each)
                continue
            waiting.append(((c, k), each))
            if len(waiting) == SIZE:
                run_waiting()
        if waiting:
            run_waiting()
        for at in [at for at, name in enumerate(names) if name.startswith(MARGINS)]:
            numbers[:, :, at] = [[margin] for margin in self._margins(axes, points, names[at])]
        kept = [k for k in range(self.members.count) if k not in self._left_out]
        return [
            _evaluation(point, numbers[c][kept], completed[c][kept], goal, reasons.get(c, ""))
            for c, point in enumerate(points)
        ]

    def _prepared(
        self, axes: Sequence[Axis], points: Sequence[Point]
    ) -> Iterator[tuple[tuple[int, int], Prepared | str]]:
        """Every point and member, prepared; a string is the reason for an impossible one."""
        members, paths = self.members, [axis.place.path for axis in axes]
        keeps_machines = not any(path[0] in _OF_MACHINES for path in paths)
        for c, point in enumerate(points or [()]):
            for k, own in enumerate(self._own.values):
                if k in self._left_out:
                    continue
                try:
                    experiment = members.experiment({**own, **dict(zip(paths, point, strict=True))})
                    known = self._machines.get(k) if keeps_machines else None
                    machine, held = known or (None, None)
                    stages = members.preparation.stages(experiment, members.controller, machine)
                    prepared = members.prepared(experiment, seed=members.seed_of(k), stages=stages, held=held)
                    if keeps_machines and known is None and prepared.controller is not None:
                        self._machines[k] = (prepared.machine, _held(prepared))
                except GoughStewartError as error:
                    yield (c, k), str(error)
                    continue
                yield (c, k), prepared

    def _margins(self, axes: Sequence[Axis], points: Sequence[Point], name: str) -> list[float]:
        """Margins of the linear loop of the nominal model; not of every member, since each takes a second."""
        found = []
        for point in points:
            values = {axis.place.path: value for axis, value in zip(axes, point, strict=True)}
            try:
                prepared = self.members.prepared(self.members.experiment(values))
                margins = margins_of([replace(prepared, machine=prepared.platform)])
                found.append(float(margins[name][0]))
            except GoughStewartError:
                found.append(np.nan)
        return found

    def _run(self, prepared: Sequence[Prepared], names: Sequence[str]) -> tuple[FloatArray, list[tuple[str, str]]]:
        """Metrics (n, names) and outcomes."""
        n = len(prepared)
        batch = batch_of(prepared, self.substeps)
        folds = folds_of_loop(batch.loop, limits_of_members(prepared, batch.size), names)
        rows = FoldsOfRows(batch.loop, folds, batch.size)
        with batch.plant:
            outcomes = observe_all(batch.plant, batch.law_from, batch.loop, rows)
            self.integration_error = max(self.integration_error, float(np.max(batch.plant.integration_error[:n])))
        assert not hasattr(outcomes, "status")
        columns = columns_of(rows.results())
        unknown = np.full(n, np.nan)  # margins are not part of runs
        return np.stack([columns.get(name, unknown)[:n] for name in names], axis=1), [
            (outcome.status, str(outcome.cause)) for outcome in outcomes[:n]
        ]


def members_for(experiment: Experiment, members: int, seed: int | None, controller: Any = None) -> Members:
    """A number of members of an experiment; without `[ensemble]` they differ only in noise and jitter."""
    choice = experiment.ensemble
    if choice is None:
        choice = EnsembleChoice.built().model_validate({})
    # search and test may need other numbers of members than the design allows
    sampling = "random" if choice.sampling in ("saltelli", "latin_hypercube") else choice.sampling
    update = {"members": members, "sampling": sampling, "seed": choice.seed if seed is None else seed}
    return Members(experiment.model_copy(update={"ensemble": choice.model_copy(update=update)}), controller)


def _held(prepared: Prepared) -> FloatArray | None:
    """Forces that hold the machine in its start pose, if no limit has clipped them."""
    limit = prepared.loop.actuators.force_limit
    force = prepared.loop.start_force
    return force if limit is None or (np.abs(force) < limit).all() else None


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
