"""Tune an experiment: search values that minimise a metric, and test the result on new members."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import Bounds, differential_evolution
from scipy.stats import qmc

from gough_stewart.harness.errors import NoCandidateError, SearchError, TuningError
from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.experiment.overrides import Settings, experiment_with
from gough_stewart.harness.experiment.preparation import too_late
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.tuning.candidates import Candidates, RunsProgress
from gough_stewart.harness.tuning.search import Goal, Search, axes_of, check_metric, condition_of
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
