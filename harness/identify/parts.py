"""Parts of logs: segments of even rows, of which some are fitted and the others validate the fit."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gough_stewart.harness.identify.log import Log
from gough_stewart.model.vectors import FloatArray

# Share of each log, taken from its end, that validates the fit.
VALIDATION = 0.2


class Part(NamedTuple):
    """A segment of a log; its rows before `fitted_until` are fitted, the later ones validate the fit."""

    log: Log
    fitted_until: float = math.inf  # [s]
    which: int = 0  # the log that it is from, in their order

    def is_fitted(self, time: FloatArray) -> np.ndarray:
        """Which times (n,) [s] are fitted (n,)."""
        return np.asarray(time < self.fitted_until)


def on_one_axis(parts: Sequence[Part], times: Sequence[FloatArray]) -> tuple[FloatArray, list[tuple[float, float]]]:
    """Times (n,) of the rows of all parts for one chart, logs after each other, and the spans that validate [s]."""
    shifted, spans, end, shift = [], [], -math.inf, 0.0
    for k, (part, time) in enumerate(zip(parts, times, strict=True)):
        if not len(time):
            continue
        if k and part.which != parts[k - 1].which:
            shift = end - float(time[0]) + (float(np.median(np.diff(time))) if len(time) > 1 else 0.0)
        shifted.append(time + shift)
        end = float(shifted[-1][-1])
        aside = np.flatnonzero(~part.is_fitted(time))
        if aside.size:
            spans.append((float(shifted[-1][aside[0]]), end))
    return np.concatenate(shifted), spans
