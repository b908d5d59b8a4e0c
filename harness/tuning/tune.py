"""Tune an experiment: search values that minimise a metric, and test the result on new members."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import Bounds, differential_evolution
from scipy.stats import qmc

from gough_stewart.harness.ensemble.chunk import SIZE, margins_of, metrics_of, reduced
from gough_stewart.harness.ensemble.workers import cores
from gough_stewart.harness.errors import NoCandidateError, SearchError, TuningError
from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.overrides import Settings, Values, experiment_with
from gough_stewart.harness.experiment.preparation import Batch, too_late
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.sampling.variation import EnsembleChoice
from gough_stewart.harness.tuning.search import (
    Evaluation,
    Goal,
    Point,
    Search,
    SearchAxis,
    axes_of,
    check_metric,
    condition_of,
)
from gough_stewart.harness.tuning.tuning import Tuning
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.vectors import FloatArray

# Members that evaluate a candidate, if the experiment has more, and fresh members that the search does not use.
MEMBERS, FRESH = 64, 500
GENERATIONS, POPULATION = 25, 16
QUANTILE = 0.95
# Every candidate that meets the conditions is better than any that does not.
_INFEASIBLE = 1e30
_TOLERANCE = 1e-3
RunsProgress = Callable[[int], None]


def tune(  # noqa: PLR0912, PLR0915 - one road, in sections
    experiment: Experiment | Path | str,
    vary: Sequence[str],
    minimise: str,
    settings: Settings = (),
    *,
    controller: Any = None,
    subject_to: Sequence[str] = (),
    quantile: float = QUANTILE,
    members: int | None = None,
    fresh: int | None = None,
    generations: int = GENERATIONS,
    population: int | None = None,
    seed: int = 0,
    progress: RunsProgress | None = None,
    status: Callable[[Search], None] | None = None,
) -> Tuning:
    """Search values of an experiment that minimise a metric, by differential evolution.

    Over an `[ensemble]` a candidate's value is a quantile over its members, the same members for all candidates; the
    result is evaluated again on fresh members that the search did not use. Otherwise it is the value of a single run.

    Parameters
    ----------
    experiment
        A TOML file, the name of a shipped experiment, or an `Experiment`.
    vary
        Keys with their bounds: "controller.bandwidth=1..6Hz"; append ",log" for a logarithmic scale.
    minimise
        A metric by its path, such as "tracking.position.norm_rms".
    settings
        Keys of the experiment to change, as in `load_experiment`.
    controller
        Replaces the experiment's, as in `run`; each member of each candidate gets a fresh one.
    subject_to
        Conditions on metrics and margins: "margins.disk > 0.5", "stroke.margin >= 10 mm"; numbers without a unit are in
        that of the metric, SI units or percent.
    quantile
        The share of the members that do not exceed a candidate's value, and that meet each condition.
    members, fresh
        How many members evaluate candidates, and how many fresh ones test the result; 64 and 500 by default, or as many
        as the experiment has, if fewer. Members that would all be equal (no `[ensemble]`,
        noise or jitter) are an error.
    generations, population
        Of the search; by default 25 generations of 16 candidates for each key.
    seed
        Seed of the search itself.
    progress
        Called with the number of finished runs.
    status
        Called with the search after every generation.

    Returns
    -------
    Tuning
        The `experiment` with the `values` found, their evaluations, and all `candidates`.

    Raises
    ------
    TuningError
        An impossible search, or no candidate that meets the conditions; names the condition that most of them break.
    ExperimentError, ReachError
        As `run`.

    See Also
    --------
    ensemble, run, margins

    Examples
    --------
    >>> result = gs.tune("heave_step", ["controller.damping_ratio=0.4..1.2"], "tracking.position.norm_rms",
    ...                  {"loop.duration": 0.3}, generations=2, population=5)
    >>> result.values, result.seen.value
    """
    chosen = load_experiment(experiment, settings)
    if not 0 < quantile <= 1:
        raise TuningError(f"quantile is {quantile:g}; expected a share above 0, up to 1")
    for name, number in (("members", members), ("fresh", fresh), ("generations", generations)):
        if number is not None and number < 1:
            raise TuningError(f"{name} is {number}; expected at least 1")
    for hint in too_late(chosen):
        raise TuningError(hint)
    stated = None if chosen.ensemble is None else chosen.ensemble.members
    most = MEMBERS if chosen.ensemble is not None else 1
    candidates = Candidates(chosen, members or min(stated or most, most), controller=controller)
    for name, number in (("members", members), ("fresh", fresh)):
        if number is not None and number > 1 and not candidates.is_random:
            raise SearchError(
                f"{name} is {number}, and all members would be the same: the search has no [ensemble], no noise and no "
                "jitter; leave it out, or give the experiment one (on the command line also --over-ensemble)"
            )
    axes = axes_of(vary, candidates.members)
    size = POPULATION * len(axes) if population is None else population
    if size < 5:
        raise TuningError(f"population is {size}; expected at least 5 candidates in a generation")
    known = candidates.metrics()
    conditions = tuple(condition_of(text, known) for text in subject_to)
    goal = Goal(check_metric(minimise, known, "--minimise"), conditions, quantile)

    # evenly spread candidates, and the original values if they are within the bounds
    axis_values = tuple(axis.now for axis in axes if axis.now is not None)
    original = axis_values if len(axis_values) == len(axes) else None
    first: FloatArray = qmc.LatinHypercube(len(axes), rng=np.random.default_rng([seed, 1])).random(size)
    if original is not None and all(axis.low <= value <= axis.high for axis, value in zip(axes, original, strict=True)):
        first[0] = [axis.share(value) for axis, value in zip(axes, original, strict=True)]
    history = Search(axes, goal)

    def energies(x: FloatArray, /) -> Any:
        """Of a generation (axes, candidates): every candidate that meets the conditions is better than any other.

        Of two that do not, it is the one with the smaller violation (Deb, Comput. Methods Appl. Mech. Eng. 186 (2000)
        311). Since differential evolution only compares candidates, this suffices; SciPy's own constraints would be
        evaluated separately, although metric and conditions come from the same runs.
        """
        points = [tuple(axis.value(float(u)) for axis, u in zip(axes, row, strict=True)) for row in np.atleast_2d(x.T)]
        evaluations = candidates.evaluate(axes, points, goal, progress)
        number = history.generation[-1] + 1 if history.generation else 0
        history.tried += evaluations
        history.generation += [number] * len(evaluations)
        if status is not None:
            status(history)
        violations = [goal.violation(evaluation) for evaluation in evaluations]
        pairs = zip(violations, evaluations, strict=True)
        return np.array([_INFEASIBLE * (1 + v) if v else evaluation.value for v, evaluation in pairs])

    options: dict[str, Any] = {"polish": False, "vectorized": True, "updating": "deferred", "tol": _TOLERANCE}
    bounds, rng = Bounds(np.zeros(len(axes)), np.ones(len(axes))), np.random.default_rng(seed)
    try:
        result = differential_evolution(energies, bounds, init=first, maxiter=generations - 1, rng=rng, **options)
        after = f"after {generations} generation{'s' * (generations > 1)}"
        history.ending = "the candidates have converged" if result.success else after
    except KeyboardInterrupt:  # what was tried is kept
        history.ending, history.is_interrupted = "stopped by the user", True
    except RuntimeError as error:
        # SciPy takes a ValueError of the candidates, which many errors here are, for one of its own call
        if isinstance(error.__cause__, GoughStewartError):
            raise error.__cause__ from None
        raise

    # the best, and the original experiment, on the same members and on fresh ones
    best = history.best
    if best is None and history.is_interrupted:
        raise KeyboardInterrupt  # there is nothing to keep
    if best is None:
        raise NoCandidateError(f"no candidate meets the conditions ({history.ending}): {history.broken_most()}")
    judges = [candidates]
    if candidates.is_random and not history.is_interrupted:
        count = fresh or min(stated or FRESH, FRESH)
        judges.append(Candidates(chosen, count, candidates.members.seed + 1, controller))
    seen, *unseen = (judge.evaluate(axes, [best.point], goal, further=(*known, "margins.disk"))[0] for judge in judges)
    before, *before_unseen = (
        None if original is None else judge.evaluate(axes, [original], goal)[0] for judge in judges
    )
    path_values = {axis.place.path: value for axis, value in zip(axes, best.point, strict=True)}
    tuned = experiment_with(candidates.members.nominal, path_values).model_copy(update={"ensemble": chosen.ensemble})
    return Tuning(
        tuned,
        dict(zip([axis.key for axis in axes], best.point, strict=True)),
        seen,
        unseen[0] if unseen else None,
        before,
        before_unseen[0] if before_unseen else None,
        history,
        candidates.count,
        judges[1].count if judges[1:] else 0,
        candidates.left_out,
        max(judge.integration_error for judge in judges),
    )


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

        # runs, in batches of candidates with their members
        pairs = [(c, k) for c in range(len(points)) for k in self._kept]
        for first in range(0, len(pairs), SIZE):
            part = pairs[first : first + SIZE]
            batch = self._prepared([(settings[c], k) for c, k in part])
            for at in sorted(batch.errors):
                reasons.setdefault(part[at][0], str(batch.errors[at]))
            if not len(batch):
                continue
            outcomes, columns, _ = reduced(batch, self.members.stepping, cores(), names=names)
            self.integration_error = max(self.integration_error, float(np.max(columns["integration_error"])))
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
