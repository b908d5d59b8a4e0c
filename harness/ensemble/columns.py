"""The table of an ensemble's members: names of its columns, which of them are metrics, and their values.

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

import numpy as np
import polars

from gough_stewart.harness.errors import RecordError
from gough_stewart.model.interface import nearest
from gough_stewart.model.vectors import FloatArray

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


def metric_names(members: polars.DataFrame) -> tuple[str, ...]:
    """The columns that are metrics or margins."""
    other = (MEMBER, OUTCOME, ENDED, CAUSE, OSCILLATION, AMPLITUDE, FREQUENCY, *_CIRCUMSTANCES)
    return tuple(name for name in members.columns if name not in other and not name.startswith(VARIED))


def metric_name(members: polars.DataFrame, name: str) -> str:
    """The column of a metric, which may have a short name.

    Raises
    ------
    RecordError
        Unknown; suggests the nearest name.
    """
    known, full = metric_names(members), SHORT.get(name, name)
    if full not in known:
        raise RecordError(f"no metric '{name}'{nearest(name, known)}")
    return full


def numbers(members: polars.DataFrame, column: str) -> FloatArray:
    """A column as numbers (N,), NaN for null."""
    values: FloatArray = members[column].cast(polars.Float64, strict=False).fill_null(np.nan).to_numpy()
    return values
