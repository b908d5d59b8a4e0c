"""The tables of an ensemble: their files and columns, which members and metrics count, and statistics of all members.

`members` has a row for each member, in their order:

- `member`, its number;
- `varied.KEY`, every number that varies, KEY as in the experiment, elements as in `varied.base_points[1,2]`;
- `outcome`: `completed`, `diverged`, `stopped`, or `impossible` if it could not run; `ended`, its time [s]; `cause`, a
  text, null if there is none; of a member that completed, why its margins cannot be computed;
- `oscillation`, how the loop of a member that completed moves by itself at the end: `oscillating`, `growing`, null if
  it comes to rest or follows its reference; `oscillation.amplitude` [m] of the leg with the largest,
  `oscillation.frequency` [Hz], null if it has none, or if only some of its rows were kept;
- `integration_error`, the largest estimated error of a plant step;
- `internal_steps`, how many steps of the integration it took;
- the metrics by path (`tracking.position.norm_rms`), and `margins.stable`, `margins.disk` if requested; null if
  undefined.
"""

import re
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import polars
from numpy.typing import NDArray

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.report.quantities import LENGTH, NUMBER, Quantity, of_unit
from gough_stewart.harness.report.words import exactly
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.model.interface import BY_NAME, nearest
from gough_stewart.model.parameters import TABLE
from gough_stewart.model.vectors import FloatArray

MEMBERS, BANDS, SAMPLES, METADATA = "members.parquet", "bands.parquet", "samples.parquet", "ensemble.json"
MEMBER, OUTCOME, ENDED, CAUSE = "member", "outcome", "ended", "cause"
OSCILLATION, AMPLITUDE, FREQUENCY = "oscillation", "oscillation.amplitude", "oscillation.frequency"
OSCILLATING, GROWING = "oscillating", "growing"
VARIED, MARGINS = "varied.", "margins."
DISK = f"{MARGINS}disk"
IMPOSSIBLE = "impossible"
INTEGRATION_ERROR = "integration_error"
INTERNAL_STEPS = "internal_steps"
# Part of the metrics of runs, but not used for ranking.
_CIRCUMSTANCES = ("rows", "duration", INTEGRATION_ERROR, INTERNAL_STEPS)
# Short names of frequently used metrics.
SHORT = {"disk_margin": "margins.disk", "stable": "margins.stable"}
# The metrics of the first table; the page shows all.
_USUAL = (
    *(f"tracking.{pose}.norm_{kind}" for pose in ("position", "orientation") for kind in ("rms", "peak", "final")),
    "tracking.leg_length.peak",
    *("force.peak", "power.peak", "energy.absolute_total", "stroke.margin"),
    *("saturation.force_limited.any", "saturation.rate_limited.any", "stroke.exceeded.any"),
    *("margins.stable", "margins.disk"),
)
_USUAL_OF_STEPS = ("overshoot_percent", "rise_time", "settling_time")
# The displayed units of errors.
_OF_ERRORS = {"m": "mm", "rad": "deg"}
_AXES = {"position": "xyz", "orientation": ("roll", "pitch", "yaw")}
# A number in the text of a cause, which differs between members.
_NUMBER = re.compile(r"(?<![\w.])[-−+]?\d+(\.\d+)?([eE][-+]?\d+)?")
# So many times the tolerance is no matter of single steps.
_FAR_BEYOND = 10.0


def metric_names(members: polars.DataFrame) -> tuple[str, ...]:
    """The columns that are metrics or margins."""
    no_metrics = (MEMBER, OUTCOME, ENDED, CAUSE, OSCILLATION, AMPLITUDE, FREQUENCY, *_CIRCUMSTANCES)
    return tuple(name for name in members.columns if name not in no_metrics and not name.startswith(VARIED))


def metric_name(members: polars.DataFrame, name: str) -> str:
    """The column of a metric, which may have a short name.

    Raises
    ------
    RecordError
        Unknown; suggests the nearest name.
    """
    names, full = metric_names(members), SHORT.get(name, name)
    if full not in names:
        raise RecordError(f"no metric '{name}'{nearest(name, names)}")
    return full


def numbers(members: polars.DataFrame, column: str) -> FloatArray:
    """A column as numbers (N,), NaN for null."""
    values: FloatArray = members[column].cast(polars.Float64, strict=False).fill_null(np.nan).to_numpy()
    return values


@dataclass(frozen=True, eq=False, repr=False)
class EnsembleData:
    """Members, bands and metadata of an ensemble, by the names of metrics and inputs."""

    members: polars.DataFrame
    bands: polars.DataFrame
    metadata: dict[str, Any]
    # Signals of the first members at few times, of `bands.samples_frame`.
    samples: polars.DataFrame | None = None

    @property
    def metrics(self) -> tuple[str, ...]:
        """Names of the metrics and margins."""
        return metric_names(self.members)

    @property
    def varied(self) -> tuple[str, ...]:
        """Names of the varied inputs, without prefix."""
        return tuple(name.removeprefix(VARIED) for name in self.members.columns if name.startswith(VARIED))

    @property
    def block(self) -> int:
        """How many members, one after the other, share their numbers: those of a point of Saltelli's design, or 1."""
        return len(self.metadata["groups"]) + 2 if self.metadata.get("sampling") == "saltelli" else 1

    def independent(self, rows: NDArray[np.bool_]) -> float:
        """How many independent members these rows (N,) are worth: (Σ m)²/Σ m² with m of them in each block.

        The number of blocks if as many are in each: their number over Kish's design effect, as in `proportions`.
        """
        sizes = np.bincount(np.flatnonzero(rows) // self.block)
        return float(sizes.sum() ** 2 / (sizes @ sizes))

    @property
    def title(self) -> str:
        """Title of the experiment."""
        return str(self.metadata.get("title", "ensemble"))

    def values(self, name: str) -> FloatArray:
        """A metric, a margin or a varied input of every member (N,); NaN if undefined."""
        column = f"{VARIED}{name}" if f"{VARIED}{name}" in self.members.columns else metric_name(self.members, name)
        return numbers(self.members, column)


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
    has_value = np.isfinite(numbers(members, name))
    return np.asarray(has_value if name.startswith(MARGINS) else has_value & _are_completed(members))


def counted(members: polars.DataFrame, name: str) -> FloatArray:
    """The values (n,) of a metric that statistics are of, of the members that `are_counted`."""
    return np.asarray(numbers(members, name)[are_counted(members, name)])


def left_out(members: polars.DataFrame) -> int:
    """How many members statistics of metrics leave out: those that did not complete."""
    return int(np.count_nonzero(~_are_completed(members)))


def _are_completed(members: polars.DataFrame) -> NDArray[np.bool_]:
    return np.asarray((members[OUTCOME] == "completed").to_numpy())


def failures(members: polars.DataFrame) -> tuple[Failure, ...]:
    """Members that did not complete, by outcome and cause, most frequent first.

    Causes that differ only in numbers count as one.
    """
    members_of: dict[tuple[str, str], list[int]] = {}
    first: dict[tuple[str, str], str] = {}
    failed = members.filter(polars.col(OUTCOME) != "completed")
    for member, outcome, cause in failed.select(MEMBER, OUTCOME, CAUSE).iter_rows():
        text = str(cause or "")
        key = (str(outcome), _NUMBER.sub("#", text))
        members_of.setdefault(key, []).append(int(member))
        first.setdefault(key, text)
    causes = [Failure(key[0], first[key], tuple(numbers_of)) for key, numbers_of in members_of.items()]
    return tuple(sorted(causes, key=lambda failure: -len(failure.members)))


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
            verb = "oscillate" if kind == OSCILLATING else "grow"
            parts.append(
                f"the loops of {len(which)} of {members.height} members {verb} by themselves; member {which[0]} has "
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


def usual_metrics(members: polars.DataFrame) -> list[str]:
    """The metrics of most interest that some counted member has and that are not always 0."""
    names = [
        name
        for name in metric_names(members)
        if name in _USUAL or (name.startswith("step_response.") and name.endswith(_USUAL_OF_STEPS))
    ]
    shares = ("saturation.", "stroke.exceeded")
    order = {name: k for k, name in enumerate(_USUAL)}

    def is_worth_it(name: str) -> bool:
        values = counted(members, name)
        return len(values) > 0 and not (name.startswith(shares) and values.max() == 0)

    after_errors = order["tracking.leg_length.peak"] + 0.5
    return sorted(filter(is_worth_it, names), key=lambda name: order.get(name, after_errors))


def named_signal(column: str) -> tuple[str, Quantity]:
    """A signal of bands, `position[3]` or `error.position.norm`, in words, and how it is written."""
    is_error, norm = column.startswith("error."), column.endswith(".norm")
    name, _, rest = column.removeprefix("error.").removesuffix(".norm").partition("[")
    unit = BY_NAME[name].unit
    words = name.replace("_", " ")
    if rest:
        k = int(rest.removesuffix("]")) - 1
        words = str(_AXES[name][k]) if name in _AXES else f"{words} {k + 1}"
    if not is_error:
        return words, of_unit(unit)
    return f"error of {words}" + (", norm" if norm else ""), of_unit(_OF_ERRORS.get(unit, unit))


def quantity_of_input(key: str) -> Quantity:
    """How a varied input is written, by key: a parameter of the platform has its unit."""
    name = key.removeprefix("platform.").removeprefix("plant.parameters.").partition("[")[0]
    return of_unit(TABLE[name].unit) if name in TABLE and TABLE[name].unit else NUMBER
