"""The tables of an ensemble: their files and columns, which members and metrics count, and statistics of all members.

`members` has a row for each member, in their order:

- `member`, its number;
- `varied.KEY`, every number that varies, KEY as in the experiment, elements as in `varied.base_points[1,2]`;
- `outcome`: `completed`, `diverged`, `stopped`, or `impossible` if it could not run; `ended`, its time [s]; `cause`, a
  text, null if there is none; of a member that completed, why its margins cannot be computed;
- `oscillation`, how the loop of a member that completed moves without input at its end: `oscillating`, `growing`, null
  if it comes to rest or follows its reference; `oscillation.amplitude` [m] of the leg with the largest,
  `oscillation.frequency` [Hz], null if it has none, or if only some of its rows were kept;
- `integration_error`, the largest estimated error of a plant step;
- `internal_steps`, how many steps of the integration it took;
- the metrics by path (`tracking.position.norm_rms`), and `margins.stable`, `margins.disk` if requested; null if
  undefined.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import polars
from numpy.typing import NDArray

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.report.quantities import LENGTH, NUMBER, Quantity, exactly, of_unit
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.model.interface import nearest
from gough_stewart.model.parameters import TABLE
from gough_stewart.model.vectors import FloatArray

MEMBERS, BANDS, SAMPLES, METADATA = "members.parquet", "bands.parquet", "samples.parquet", "ensemble.json"
# Columns before the metrics, apart from those that vary; the last ones are metrics of runs, but not used for ranking.
_NO_METRICS = (
    *("member", "outcome", "ended", "cause", "oscillation", "oscillation.amplitude", "oscillation.frequency"),
    *("rows", "duration", "integration_error", "internal_steps"),
)
# Short names of frequently used metrics.
SHORT = {"disk_margin": "margins.disk", "stable": "margins.stable"}
# The metric of the verdict, which also ranks the worst members: the first of these that exists. The error of a
# reference that jumps is the jump itself at first, so that what is left of it counts.
PEAK, FINAL = "tracking.position.norm_peak", "tracking.position.norm_final"
_OTHERWISE = "force.peak"
# The metrics of the first table, those of steps after the errors; the page shows all.
_USUAL = (
    *(f"tracking.{pose}.norm_{kind}" for pose in ("position", "orientation") for kind in ("rms", "peak", "final")),
    *("tracking.leg_length.peak", "step_response.", "force.peak", "power.peak", "energy.absolute_total"),
    *("stroke.margin", "saturation.force_limited.any", "saturation.rate_limited.any", "stroke.exceeded.any"),
    *("margins.stable", "margins.disk"),
)
_USUAL_OF_STEPS = ("overshoot_percent", "rise_time", "settling_time")


@dataclass(frozen=True, eq=False, repr=False)
class MemberTable:
    """Members, bands and metadata of an ensemble, by the names of metrics and inputs."""

    members: polars.DataFrame
    bands: polars.DataFrame
    metadata: dict[str, Any]
    # Signals of the first members at few times, of `bands.band_tables`.
    samples: polars.DataFrame | None = None

    title: str = field(init=False)  # of the experiment
    metrics: tuple[str, ...] = field(init=False)  # names of the metrics and margins
    varied: tuple[str, ...] = field(init=False)  # names of the varied inputs, without prefix
    # How many members, one after the other, share their numbers: those of a point of Saltelli's design, or 1.
    block: int = field(init=False)
    # How finely numbers of its machines are told; those of an older version have none.
    fineness: float = field(init=False)
    is_complete: NDArray[np.bool_] = field(init=False)  # which members (N,) completed their runs
    works: NDArray[np.bool_] = field(init=False)  # which members (N,) completed them without a loop that grows
    # Members that completed while their loops oscillated or grew without input; the largest amplitude first.
    oscillating: dict[str, list[int]] = field(init=False)

    def __post_init__(self) -> None:
        metadata, members, columns = self.metadata, self.members, self.members.columns
        oscillating: dict[str, list[int]] = {"oscillating": [], "growing": []}
        if "oscillation" in columns:  # results of an older version have none
            rows = members.sort("oscillation.amplitude", descending=True, nulls_last=True)
            for kind in oscillating:
                oscillating[kind] = rows.filter(polars.col("oscillation") == kind)["member"].to_list()
        is_complete = np.asarray((members["outcome"] == "completed").to_numpy())
        vars(self).update(
            title=str(metadata.get("title", "ensemble")),
            metrics=tuple(name for name in columns if name not in _NO_METRICS and not name.startswith("varied.")),
            varied=tuple(name.removeprefix("varied.") for name in columns if name.startswith("varied.")),
            block=len(metadata["groups"]) + 2 if metadata.get("sampling") == "saltelli" else 1,
            fineness=float(metadata.get("fineness", 1.0)),
            is_complete=is_complete,
            works=is_complete & ~np.isin(members["member"].to_numpy(), oscillating["growing"]),
            oscillating=oscillating,
        )

    def values(self, name: str) -> FloatArray:
        """A metric, a margin or a varied input of every member (N,), NaN if undefined; `RecordError` if unknown."""
        column = f"varied.{name}" if f"varied.{name}" in self.members.columns else SHORT.get(name, name)
        if not column.startswith("varied.") and column not in self.metrics:
            raise RecordError(f"no metric '{name}'{nearest(name, self.metrics)}")
        return self.numbers(column)

    def numbers(self, column: str) -> FloatArray:
        """Any column as numbers (N,), NaN for null."""
        values: FloatArray = self.members[column].cast(polars.Float64, strict=False).fill_null(np.nan).to_numpy()
        return values

    # --- which members count

    def are_counted(self, name: str) -> NDArray[np.bool_]:
        """Which members (N,) statistics of a metric are of: those that completed their runs and have a value.

        Numbers of a run that ended early are of a shorter time, often without the step or the peak. A margin is not a
        number of the run, and counts for all.
        """
        has_value = np.isfinite(self.numbers(name))
        return np.asarray(has_value if name.startswith("margins.") else has_value & self.is_complete)

    def counted(self, name: str) -> FloatArray:
        """The values (n,) of a metric that statistics are of, of the members that `are_counted`."""
        return np.asarray(self.numbers(name)[self.are_counted(name)])

    def independent(self, rows: NDArray[np.bool_]) -> float:
        """How many independent members these rows (N,) are worth: (Σ m)²/Σ m² with m of them in each block.

        The number of blocks if as many are in each: their number over Kish's design effect, as in `proportions`.
        """
        sizes = np.bincount(np.flatnonzero(rows) // self.block)
        return float(sizes.sum() ** 2 / (sizes @ sizes))

    # --- what is worth telling

    @property
    def usual_metrics(self) -> list[str]:
        """The metrics of most interest that some counted member has and that are not always 0."""
        places = {}
        for name in self.metrics:
            is_step = name.startswith("step_response.") and name.endswith(_USUAL_OF_STEPS)
            kind = "step_response." if is_step else name
            values = self.counted(name) if kind in _USUAL else np.zeros(0)
            is_zero = name.startswith(("saturation.", "stroke.exceeded")) and not values.any()
            if len(values) and not is_zero:
                places[name] = _USUAL.index(kind)
        return sorted(places, key=places.__getitem__)

    @property
    def worst_by(self) -> str:
        """The metric that ranks the worst members: the experiment's `worst_by`, or what is left of the error."""
        experiment = self.metadata.get("experiment") or {}
        by = (experiment.get("ensemble") or {}).get("worst_by")
        if by is not None:
            metric = str(SHORT.get(by, by))
            self.values(metric)  # refuses one that these members lack
            return metric
        first = [FINAL] if (experiment.get("reference") or {}).get("type") == "step" else []
        return next(name for name in (*first, PEAK, _OTHERWISE, *self.metrics) if name in self.metrics)

    def worst_members(self, by: str, number: int) -> list[int]:
        """The members with the largest value of a metric; before them those that did not complete, earliest first.

        Impossible members have no run and are left out. Of a metric that is better if larger, such as a margin, the
        smallest are the worst.
        """
        values, is_complete = self.numbers(by), self.is_complete
        badness = -values if metric_of(by).better == "larger" else values
        keys = (
            np.where(np.isnan(badness), np.inf, -badness),
            np.where(is_complete, 0.0, self.numbers("ended")),
            is_complete,
        )
        has_run = (self.members["outcome"] != "impossible").to_numpy()
        order = [k for k in np.lexsort(keys) if has_run[k]]
        return [int(member) for member in self.members["member"].to_numpy()[order[:number]]]

    @property
    def oscillation_warning(self) -> str:
        """A warning if loops of some members oscillate or grow without input; "" if not."""
        parts = []
        for kind, members in self.oscillating.items():
            if members:
                worst = self.members.row(by_predicate=polars.col("member") == members[0], named=True)
                frequency, amplitude = worst["oscillation.frequency"], worst["oscillation.amplitude"]
                rate = "" if frequency is None else f" at {frequency:.3g} Hz"
                parts.append(
                    f"the loops of {len(members)} of {self.members.height} members "
                    f"{'oscillate' if kind == 'oscillating' else 'grow'} without input; member {members[0]} has the "
                    f"largest amplitude, {exactly(LENGTH, amplitude, 3)}{rate}"
                )
        return f"{'; '.join(parts)}. `run --member K` shows one" if parts else ""


def quantity_of_input(key: str) -> Quantity:
    """How a varied input is written, by key: a parameter of the platform has its unit."""
    name = key.removeprefix("platform.").removeprefix("plant.parameters.").partition("[")[0]
    return of_unit(TABLE[name].unit) if name in TABLE and TABLE[name].unit else NUMBER
