"""Candidates of a search, run in parallel over the same members: a generation is one batch."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from gough_stewart.harness.ensemble.chunk import SIZE, Reduced, check_memory, margins_of, metrics_of, reduced
from gough_stewart.harness.ensemble.workers import cores
from gough_stewart.harness.errors import TuningError
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.overrides import Values
from gough_stewart.harness.experiment.preparation import Batch
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.sampling.variation import EnsembleChoice
from gough_stewart.harness.tuning.search import Evaluation, Goal, Point, SearchAxis
from gough_stewart.model.errors import GoughStewartError

RunsProgress = Callable[[int], None]


class Candidates:
    """Runs points of a search over the members of an experiment, the same for all points (common random numbers).

    Members that are impossible in the original experiment are left out; `TuningError` if none is possible.
    """

    def __init__(self, experiment: Experiment, members: int, seed: int | None = None, controller: Any = None) -> None:
        # without `[ensemble]` members differ only in noise and jitter
        choice = experiment.ensemble or EnsembleChoice.built().model_validate({})
        # search and test may need other numbers of members than the design allows
        sampling = "random" if choice.sampling in ("saltelli", "latin_hypercube") else choice.sampling
        update = {"members": members, "sampling": sampling, "seed": choice.seed if seed is None else seed}
        chosen = experiment.model_copy(update={"ensemble": choice.model_copy(update=update)})
        self.members = Members(chosen, controller)
        self._draws = self.members.draws(0, self.members.count).values
        self.integration_error = 0.0
        impossible = self._prepared([({}, k) for k in range(self.members.count)]).errors
        self.left_out = len(impossible)
        self._kept = [k for k in range(self.members.count) if k not in impossible]
        self.count = len(self._kept)  # of members that evaluate a candidate
        # whether other seeds give other members
        noise, jitter = self.members.nominal.sensors.noise, self.members.nominal.loop.jitter
        self.is_random = bool(self.members.inputs or any(noise.values()) or jitter)
        if not self._kept:
            raise TuningError(
                f"{self.members.nominal.where}: no member is possible; the first: {impossible[min(impossible)]}"
            )

    def metrics(self) -> list[str]:
        """The metrics of the runs."""
        return metrics_of(self._prepared([({}, self._kept[0])]))

    def evaluate(
        self,
        axes: Sequence[SearchAxis],
        points: Sequence[Point],
        goal: Goal,
        progress: RunsProgress | None = None,
        further: Sequence[str] = (),
    ) -> list[Evaluation]:
        """Evaluate all points over all members; `further` metrics are kept for each member."""
        names = [goal.metric, *(condition.metric for condition in goal.conditions), *further]
        numbers = np.full((len(points), self.members.count, len(names)), np.nan)
        completed = np.zeros((len(points), self.members.count), dtype=bool)
        reasons: dict[int, str] = {}
        settings = [{axis.place.path: value for axis, value in zip(axes, point, strict=True)} for point in points]

        def run(batch: Batch) -> Reduced:
            return reduced(batch, self.members.stepping, cores(), names=names)

        # runs, in batches of candidates with their members
        pairs = [(c, k) for c in range(len(points)) for k in self._kept]
        for first in range(0, len(pairs), SIZE):
            part = pairs[first : first + SIZE]
            batch = self._prepared([(settings[c], k) for c, k in part])
            for at in sorted(batch.errors):
                reasons.setdefault(part[at][0], str(batch.errors[at]))
            if not len(batch):
                continue
            outcomes, columns, _ = of_batch = run(batch)
            self.integration_error = max(self.integration_error, float(np.max(columns["integration_error"])))
            check_memory(batch, of_batch, run)
            unknown = np.full(len(outcomes), np.nan)  # margins are not part of runs
            rows = np.stack([columns.get(name, unknown) for name in names], axis=1)
            for at, row, outcome in zip(batch.numbers.tolist(), rows, outcomes, strict=True):
                c, k = part[at]
                numbers[c, k], completed[c, k] = row, outcome.status == "completed"
                if outcome.status != "completed":
                    reasons.setdefault(c, str(outcome.cause))
            if progress is not None:
                progress(len(batch))

        # margins of the linear loop of the nominal machine; not of every member, since each takes as long as many runs
        margins = [name for name in names if name.startswith("margins.")]
        for c, values in enumerate(settings if margins else ()):
            batch = self.members.preparation.members([values], [None])
            with suppress(GoughStewartError):
                judged = margins_of([batch.member(0)]) if len(batch) else {}
                for name in margins if judged else ():
                    numbers[c, :, [k for k, known in enumerate(names) if known == name]] = judged[name][0]
        numbers[~completed] = np.nan
        return [
            goal.evaluation(point, numbers[c][self._kept], completed[c][self._kept], reasons.get(c, ""), further)
            for c, point in enumerate(points)
        ]

    def _prepared(self, members: Sequence[tuple[Values, int]]) -> Batch:
        """Members by number, with other values than their own."""
        return self.members.preparation.members(
            [{**self._draws[k], **values} for values, k in members], [k for _, k in members]
        )
