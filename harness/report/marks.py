"""What a chart shows beside its series: margins between curves and their limits, and when limits are active."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.harness.report.palette import Role
from gough_stewart.model.vectors import FloatArray

# More intervals are joined over the shortest gaps; a screen has some 2,000 pixels.
_MOST_INTERVALS = 1000


@dataclass(frozen=True)
class Span:
    """A distance along the vertical axis at one abscissa, with a text: such as a gain margin, from a curve to 1."""

    at: float
    low: float
    high: float
    text: str
    role: Role = "good"

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (self.at, self.low, self.high))):
            raise ValueError(f"the span '{self.text}' at {self.at}, {self.low} to {self.high}; expected finite numbers")


@dataclass(frozen=True)
class Strip:
    """When something holds along the axis of a chart, such as a limit that is active: intervals from – to."""

    name: str
    intervals: tuple[tuple[float, float], ...]
    role: Role = "limit"
    share: float = 0.0  # of the axis, 0 to 1


def strip_of(name: str, at: FloatArray, holds: ArrayLike, role: Role = "limit") -> Strip | None:
    """A strip where `holds` (n,) is true; each row counts until the next one (n,). None if it never holds."""
    active = np.asarray(holds, dtype=bool)[:-1]
    if not active.any():
        return None
    edges = np.flatnonzero(np.diff(np.concatenate([[False], active, [False]]).astype(int)))
    starts, ends = at[edges[::2]], at[edges[1::2]]
    share = float((ends - starts).sum() / (at[-1] - at[0]))
    if len(starts) > _MOST_INTERVALS:
        gaps = starts[1:] - ends[:-1]
        kept = np.sort(np.argsort(gaps, kind="stable")[-(_MOST_INTERVALS - 1) :])
        starts, ends = np.concatenate([starts[:1], starts[kept + 1]]), np.concatenate([ends[kept], ends[-1:]])
    return Strip(name, tuple(zip(starts.tolist(), ends.tolist(), strict=True)), role, share)
