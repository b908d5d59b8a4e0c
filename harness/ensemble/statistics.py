"""Statistics over all members: quantiles of every metric, and failures by cause."""

import re
from typing import Any, NamedTuple

import numpy as np
import polars
from numpy.typing import NDArray

from gough_stewart.harness.ensemble.columns import (
    AMPLITUDE,
    CAUSE,
    ENDED,
    FREQUENCY,
    GROWING,
    IMPOSSIBLE,
    INTEGRATION_ERROR,
    MARGINS,
    MEMBER,
    OSCILLATING,
    OSCILLATION,
    OUTCOME,
    metric_names,
    numbers,
)
from gough_stewart.harness.report.quantities import LENGTH
from gough_stewart.harness.report.words import exactly
from gough_stewart.harness.results.bands import LEVELS, QUANTILES
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.model.vectors import FloatArray

# A number in the text of a cause, which differs between members.
_NUMBER = re.compile(r"(?<![\w.])[-−+]?\d+(\.\d+)?([eE][-+]?\d+)?")


# So many times the tolerance is no matter of single steps.
_FAR_BEYOND = 10.0


class Failure(NamedTuple):
    """Members that did not complete for the same cause."""

    outcome: str
    cause: str  # of the first one
    members: tuple[int, ...]


def finite(values: FloatArray) -> FloatArray:
    """The defined values."""
    return np.asarray(values[np.isfinite(values)])


def are_counted(members: polars.DataFrame, name: str) -> NDArray[np.bool_]:
    """Which members (N,) statistics of a metric are of: those that completed their runs and have a value.

    Numbers of a run that ended early are of a shorter time, often without the step or the peak. A margin is not a
    number of the run, and counts for all.
    """
    has = np.isfinite(numbers(members, name))
    return np.asarray(has if name.startswith(MARGINS) else has & _are_completed(members))


def counted(members: polars.DataFrame, name: str) -> FloatArray:
    """The values (n,) of a metric that statistics are of, of the members that `are_counted`."""
    return np.asarray(numbers(members, name)[are_counted(members, name)])


def left_out(members: polars.DataFrame) -> int:
    """How many members statistics of metrics leave out: those that did not complete."""
    return int(np.count_nonzero(~_are_completed(members)))


def _are_completed(members: polars.DataFrame) -> NDArray[np.bool_]:
    return np.asarray((members[OUTCOME] == "completed").to_numpy())


def quantiles(members: polars.DataFrame) -> polars.DataFrame:
    """A row for each metric: how many members are `counted`, mean, deviation, extremes and quantiles of these."""
    rows: list[dict[str, Any]] = []
    for name in metric_names(members):
        values = counted(members, name)
        row: dict[str, Any] = {"metric": name, "defined": len(values)}
        if len(values):
            deviation = float(values.std(ddof=1)) if len(values) > 1 else None
            row |= {"mean": float(values.mean()), "deviation": deviation, "lowest": float(values.min())}
            row |= dict(zip(QUANTILES, np.quantile(values, LEVELS).tolist(), strict=True))
            row["highest"] = float(values.max())
        rows.append(row)
    schema = {
        "metric": polars.String,
        "defined": polars.Int64,
        **dict.fromkeys(("mean", "deviation", "lowest", *QUANTILES, "highest"), polars.Float64),
    }
    return polars.DataFrame(rows, schema=schema)


def failures(members: polars.DataFrame) -> tuple[Failure, ...]:
    """Members that did not complete, by outcome and cause, most frequent first.

    Causes that differ only in numbers count as one.
    """
    found: dict[tuple[str, str], list[int]] = {}
    first: dict[tuple[str, str], str] = {}
    failed = members.filter(polars.col(OUTCOME) != "completed")
    for member, outcome, cause in failed.select(MEMBER, OUTCOME, CAUSE).iter_rows():
        text = str(cause or "")
        key = (str(outcome), _NUMBER.sub("#", text))
        found.setdefault(key, []).append(int(member))
        first.setdefault(key, text)
    made = [Failure(key[0], first[key], tuple(each)) for key, each in found.items()]
    return tuple(sorted(made, key=lambda failure: -len(failure.members)))


def kinds_of_oscillation(members: polars.DataFrame) -> dict[str, list[int]]:
    """Members that completed while their loops oscillated or grew by themselves; the largest amplitude first."""
    if OSCILLATION not in members.columns:  # a result of an older version
        return {OSCILLATING: [], GROWING: []}
    ordered = members.sort(AMPLITUDE, descending=True, nulls_last=True)
    return {kind: ordered.filter(polars.col(OSCILLATION) == kind)[MEMBER].to_list() for kind in (OSCILLATING, GROWING)}


def oscillation_warning(members: polars.DataFrame) -> str:
    """A warning if loops of some members oscillate or grow by themselves; "" if not."""
    parts = []
    for kind, which in kinds_of_oscillation(members).items():
        if which:
            worst = members.row(by_predicate=polars.col(MEMBER) == which[0], named=True)
            rate = "" if worst[FREQUENCY] is None else f" at {worst[FREQUENCY]:.3g} Hz"
            what = "oscillate" if kind == OSCILLATING else "grow"
            parts.append(
                f"the loops of {len(which)} of {members.height} members {what} by themselves; member {which[0]} has "
                f"the largest amplitude, {exactly(LENGTH, worst[AMPLITUDE], 3)}{rate}"
            )
    return f"{'; '.join(parts)}. `run --member K` shows one" if parts else ""


def judgement_warning(members: polars.DataFrame) -> str:
    """A warning if margins of members that completed cannot be computed, with the first cause; "" if not."""
    without = members.filter((polars.col(OUTCOME) == "completed") & polars.col(CAUSE).is_not_null())
    if not without.height:
        return ""
    how_many = f"{without.height} of {members.height} members completed but could not be judged"
    return f"{how_many}; the first is member {without[MEMBER][0]}, {without[CAUSE][0]}"


def works(members: polars.DataFrame) -> NDArray[np.bool_]:
    """Which members (N,) completed their runs without a loop that grows."""
    growing = np.isin(members[MEMBER].to_numpy(), kinds_of_oscillation(members)[GROWING])
    return np.asarray(_are_completed(members) & ~growing)


def integration_warning(members: polars.DataFrame, tolerance: float) -> str:
    """A warning if fixed steps give some members an error far beyond the tolerance; "" if not."""
    errors = numbers(members, INTEGRATION_ERROR)
    beyond = int(np.count_nonzero(errors > _FAR_BEYOND * tolerance))
    if not beyond:
        return ""
    worst = int(members[MEMBER][int(np.nanargmax(errors))])
    return (
        f"integration errors up to {np.nanmax(errors):.2g} in a plant step (member {worst}), and more than "
        f"{_FAR_BEYOND:g} times the tolerance of {tolerance:g} in {beyond} of {len(errors)} members; shorten "
        "plant.fixed_step_size, or leave it out"
    )


def worst_members(members: polars.DataFrame, by: str, number: int) -> list[int]:
    """The members with the largest value of a metric; before them those that did not complete, earliest first.

    Impossible members have no run and are left out. Of a metric that is better if larger, such as a margin, the
    smallest are the worst.
    """
    runs = members.filter(polars.col(OUTCOME) != IMPOSSIBLE)
    values = numbers(runs, by)
    badness = -values if metric_of(by).better == "larger" else values
    completed = (runs[OUTCOME] == "completed").to_numpy()
    ended = numbers(runs, ENDED)
    order = np.lexsort((np.where(np.isnan(badness), np.inf, -badness), np.where(completed, 0.0, ended), completed))
    return [int(member) for member in runs[MEMBER].to_numpy()[order][:number]]
