"""Tune an experiment: search its numbers for the best figure of merit, and say honestly what was found."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import polars

from gough_stewart.harness.errors import TuningError
from gough_stewart.harness.experiment.file import Settings, experiment_of
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.tuning.candidates import Candidates, Evaluation, Goal, Point, RunsProgress
from gough_stewart.harness.tuning.conditions import check_metric, condition_of
from gough_stewart.harness.tuning.search import Search, own_point, search
from gough_stewart.harness.tuning.space import Axis, axes_of

# Members that a candidate is judged by, where the experiment has more, and those that the search has not seen.
MEMBERS, FRESH = 64, 500
GENERATIONS, POPULATION = 25, 16
QUANTILE = 0.95


@dataclass(frozen=True, eq=False, repr=False)
class Tuning:
    """What a search has found, from `tune`; shows itself as tables and the statement on fresh members."""

    experiment: Experiment
    """The experiment with the values that were found."""
    values: dict[str, float | int]
    """Those values by key, in SI units, frequencies in Hz."""
    seen: Evaluation
    """What they are worth on the members that the search has seen."""
    fresh: Evaluation | None
    """The same on members that it has not seen; None where nothing is random."""
    before: Evaluation | None
    """What the experiment was worth as it was, on the members that the search has seen."""
    before_fresh: Evaluation | None
    """The same on those that it has not."""
    search: Search
    """Everything that was tried."""
    members: int
    """By which candidates were judged."""
    fresh_members: int
    left_out: int
    """Members that the experiment cannot have."""
    integration_error: float
    """The largest estimate of a plant step."""

    def __repr__(self) -> str:
        from gough_stewart.harness.tuning.tables import tuning_text

        return tuning_text(self)

    def _repr_html_(self) -> str:
        from gough_stewart.harness.tuning.tables import tuning_html

        return tuning_html(self)

    @property
    def is_interrupted(self) -> bool:
        """Whether Ctrl-C ended the search."""
        return self.search.is_interrupted

    @property
    def search_is_over_members(self) -> bool:
        """Whether values are quantiles over members."""
        return self.members > 1

    @property
    def candidates(self) -> polars.DataFrame:
        """Everything that was tried: `generation`, a column for each key, `value`, the conditions, `failed`, `kept`."""
        goal, tried = self.search.goal, self.search.tried
        columns: dict[str, object] = {"generation": self.search.generation}
        columns |= {axis.key: [each.point[k] for each in tried] for k, axis in enumerate(self.search.axes)}
        columns["value"] = [each.value for each in tried]
        columns |= {c.metric: [each.conditions[k] for each in tried] for k, c in enumerate(goal.conditions)}
        columns["failed"] = [each.failed for each in tried]
        columns["kept"] = [goal.violation(each) == 0 for each in tried]
        return polars.DataFrame(columns, strict=False)


def tune(
    experiment: Experiment | Path | str,
    vary: Sequence[str],
    minimise: str,
    settings: Settings = (),
    *,
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
    """Search numbers of an experiment for the smallest value of a figure of merit, by differential evolution.

    Over an `[ensemble]` a candidate's value is a quantile over its members, the same members for all candidates; what
    was found is judged once more by members that the search has not seen. Without one it is that of the single run.

    Parameters
    ----------
    vary
        Keys with their bounds: "controller.bandwidth=1..6Hz"; with ",log" behind on a logarithmic scale.
    minimise
        A figure of merit by its path, such as "tracking.position.norm_rms".
    settings
        Keys of the experiment to set anew, as `load_experiment` takes them.
    subject_to
        Conditions on figures of merit and margins: "disk_margin > 0.5", "stroke.margin >= 10 mm".
    quantile
        Of the metric, and of what conditions bound from above; 1 − quantile of what they bound from below.
    members, fresh
        How many candidates are judged by, and how many the search has not seen; 64 and 500 by default, or those that
        the experiment has, if they are fewer.
    generations, population
        Of the search; by default 25 generations of 16 candidates for each key.
    seed
        Of the search itself.
    progress
        Called with numbers of runs that are done.
    status
        Called with the search after every generation.

    Raises
    ------
    TuningError
        What is asked for cannot be, or no candidate keeps the conditions; says which condition most of them break.
    ExperimentError, ReachError
        As `run`.

    Examples
    --------
    >>> found = gs.tune("heave_step", ["controller.damping_ratio=0.4..1.2"], "tracking.position.norm_rms",
    ...                 {"loop.duration": 0.3}, generations=2, population=5)
    >>> found.values, found.seen.value
    """
    chosen = experiment_of(experiment, settings)
    if not 0 < quantile <= 1:
        raise TuningError(f"quantile is {quantile:g}; expected a share above 0, up to 1")
    for name, number in (("members", members), ("fresh", fresh), ("generations", generations)):
        if number is not None and number < 1:
            raise TuningError(f"{name} is {number}; expected at least 1")
    here = Candidates(chosen, _number(chosen, members, MEMBERS if chosen.ensemble is not None else 1))
    axes = axes_of(vary, here.members)
    conditions = tuple(condition_of(text) for text in subject_to)
    size = POPULATION * len(axes) if population is None else population
    if size < 5:
        raise TuningError(f"population is {size}; expected at least 5 candidates in a generation")
    known = here.metrics()
    goal = Goal(check_metric(minimise, known, "--minimise"), conditions, quantile)
    for condition in conditions:
        check_metric(condition.metric, known, f"--subject-to '{condition.text}'")
    left_out, _ = here.leave_out_impossible()
    own = own_point(axes)
    found = search(
        here, axes, goal, population=size, generations=generations, seed=seed, progress=progress, status=status
    )
    best = found.best
    if best is None:
        raise TuningError(f"no candidate keeps the conditions ({found.ending}): {found.broken_most()}")
    judges = [here]
    if here.is_random and not found.is_interrupted:
        other = Candidates(chosen, _number(chosen, fresh, FRESH), here.members.seed + 1)
        other.leave_out_impossible()
        judges.append(other)
    judged = [_judged(each, axes, goal, best.point, own) for each in judges]
    (seen, before), (unseen, before_unseen) = judged[0], judged[1] if judges[1:] else (None, None)
    path_values = {axis.place.path: value for axis, value in zip(axes, best.point, strict=True)}
    return Tuning(
        here.members.experiment(path_values).model_copy(update={"ensemble": chosen.ensemble}),
        dict(zip([axis.key for axis in axes], best.point, strict=True)),
        seen,
        unseen,
        before,
        before_unseen,
        found,
        here.count,
        judges[-1].count if judges[1:] else 0,
        left_out,
        max(each.integration_error for each in judges),
    )


def _judged(
    candidates: Candidates, axes: tuple[Axis, ...], goal: Goal, best: Point, own: Point | None
) -> tuple[Evaluation, Evaluation | None]:
    """What was found, and the experiment as it was, on the same members."""
    found = candidates.evaluate(axes, [best, *([] if own is None else [own])], goal)
    return found[0], found[1] if own is not None else None


def _number(experiment: Experiment, wanted: int | None, most: int) -> int:
    """How many members, if nobody says."""
    if wanted is not None:
        return wanted
    has = None if experiment.ensemble is None else experiment.ensemble.members
    return most if has is None else min(has, most)
