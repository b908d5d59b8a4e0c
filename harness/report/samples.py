"""Signals of single members of an ensemble, at few times: from them a page draws the bands of those that are marked."""

from dataclasses import dataclass

import numpy as np

from gough_stewart.model.vectors import FloatArray


@dataclass(frozen=True, eq=False)
class Samples:
    """Values of some members of a chart's signal over its abscissa."""

    members: FloatArray  # (M,): their numbers
    x: FloatArray  # (T,)
    values: FloatArray  # (M, T), NaN after a member has ended
    of: int  # members of the ensemble

    def __post_init__(self) -> None:
        for name in ("members", "x", "values"):
            array = np.array(getattr(self, name), dtype=float)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        expected = (len(self.members), len(self.x))
        if self.values.shape != expected:
            raise ValueError(f"samples of members have {self.values.shape} values; expected {expected}")
