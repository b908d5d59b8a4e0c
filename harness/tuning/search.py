"""The search: differential evolution with one batch per generation; the original values are in the first one."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import Bounds, differential_evolution
from scipy.stats import qmc

from gough_stewart.harness.report.words import exactly
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.harness.tuning.candidates import Candidates, RunsProgress
from gough_stewart.harness.tuning.goal import Evaluation, Goal, Point
from gough_stewart.harness.tuning.space import SearchAxis
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.vectors import FloatArray

# Every candidate that meets the conditions is better than any that does not.
_INFEASIBLE = 1e30
_TOLERANCE = 1e-3


@dataclass
class Search:
    """All candidates tried, in order."""

    axes: tuple[SearchAxis, ...]
    goal: Goal
    tried: list[Evaluation] = field(default_factory=list)
    generation: list[int] = field(default_factory=list)  # of each candidate
    ending: str = ""
    is_interrupted: bool = False

    @property
    def best(self) -> Evaluation | None:
        """The best candidate that meets all conditions."""
        kept = [
            evaluation
            for evaluation in self.tried
            if self.goal.violation(evaluation) == 0 and np.isfinite(evaluation.value)
        ]
        return min(kept, key=lambda evaluation: evaluation.value, default=None)

    def broken_most(self) -> str:
        """The condition that most candidates break, as text."""
        if not self.tried:
            return "no candidate was tried"
        failed = [evaluation for evaluation in self.tried if not np.isfinite(evaluation.value)]
        reason = next((f"; the first: {evaluation.reason}" for evaluation in failed if evaluation.reason), "")
        lack = "members that do not complete" if reason else f"no value of {self.goal.metric}"
        counts = {f"{len(failed)} of {len(self.tried)} candidates have {lack}{reason}": len(failed)}
        for k, condition in enumerate(self.goal.conditions):
            values = [evaluation.conditions[k] for evaluation in self.tried]
            count = sum(not condition.holds(value) for value in values)
            closest = min(filter(np.isfinite, values), key=condition.violation, default=None)
            quantity = metric_of(condition.metric).quantity
            reached = "" if closest is None else f", the nearest reached {exactly(quantity, closest, 4)}"
            counts[f"'{condition.text}' was not met by {count} of {len(self.tried)} candidates{reached}"] = count
        return max(counts, key=lambda text: counts[text])


def search(
    candidates: Candidates,
    axes: tuple[SearchAxis, ...],
    goal: Goal,
    *,
    population: int,
    generations: int,
    seed: int,
    progress: RunsProgress | None = None,
    status: Callable[[Search], None] | None = None,
) -> Search:
    """Search for the best candidate; Ctrl-C ends the search and keeps what was tried.

    Conditions act through the ranking of candidates (Deb, Comput. Methods Appl. Mech. Eng. 186 (2000) 311): one that
    meets them is better than any that does not, and of two that do not, the one with the smaller violation. Since
    differential evolution only compares candidates, this suffices; SciPy's own constraints would be evaluated
    separately, although metric and conditions come from the same runs.
    """
    history = Search(axes, goal)

    def energies(x: FloatArray, /) -> Any:
        points = [tuple(axis.value(float(u)) for axis, u in zip(axes, row, strict=True)) for row in np.atleast_2d(x.T)]
        evaluations = candidates.evaluate(axes, points, goal, progress)
        number = history.generation[-1] + 1 if history.generation else 0
        history.tried += evaluations
        history.generation += [number] * len(evaluations)
        if status is not None:
            status(history)
        violations = [goal.violation(evaluation) for evaluation in evaluations]
        return np.array(
            [
                _INFEASIBLE * (1 + v) if v else evaluation.value
                for v, evaluation in zip(violations, evaluations, strict=True)
            ]
        )

    # evenly spread candidates, and the original values
    first: FloatArray = qmc.LatinHypercube(len(axes), rng=np.random.default_rng([seed, 1])).random(population)
    original = point_of_experiment(axes)
    if original is not None and all(axis.is_within for axis in axes):
        first[0] = [axis.share(value) for axis, value in zip(axes, original, strict=True)]
    options: dict[str, Any] = {"polish": False, "vectorized": True, "updating": "deferred", "tol": _TOLERANCE}
    try:
        result = differential_evolution(
            energies,
            Bounds(np.zeros(len(axes)), np.ones(len(axes))),
            init=first,
            maxiter=generations - 1,
            rng=np.random.default_rng(seed),
            **options,
        )
        after = f"after {generations} generation{'s' * (generations > 1)}"
        history.ending = "the candidates have converged" if result.success else after
    except KeyboardInterrupt:
        history.ending, history.is_interrupted = "interrupted by the user", True
    except RuntimeError as error:
        # SciPy takes a ValueError of the candidates, which many errors here are, for one of its own call
        if isinstance(error.__cause__, GoughStewartError):
            raise error.__cause__ from None
        raise
    return history


def point_of_experiment(axes: tuple[SearchAxis, ...]) -> Point | None:
    """The values of the experiment as it is, also outside the bounds; None if it leaves one out."""
    values = tuple(axis.now for axis in axes if axis.now is not None)
    return values if len(values) == len(axes) else None
