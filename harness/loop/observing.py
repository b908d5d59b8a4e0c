"""What sees a run while it runs: row by row, of one member or of many."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.model.vectors import FloatArray


@dataclass(slots=True)
class Sampled:
    """What the controllers did at a sample; views, valid during the call only."""

    j: int  # the sample
    due: BoolArray | None  # (N,), whose sample it is at this row; None is everyone's
    measured: FloatArray  # (*shape, 24); of many members only what the controllers look at
    state: FloatArray  # (*shape, n_states), with which the command was made
    command: FloatArray  # (*shape, 6), before any limit
    force_limited: BoolArray  # (*shape, 6)


class Row(NamedTuple):
    """A row of a run; views, valid during the call only."""

    k: int
    time: float  # [s]
    signals: FloatArray  # (*shape, 24)
    inputs: FloatArray  # (*shape, 12), that act from here on
    wanted: FloatArray | None  # (30,) or (*shape, 30)
    command: FloatArray  # (*shape, 6) of the latest sample, before any limit
    force_limited: BoolArray  # (*shape, 6), of the latest sample
    rate_limited: BoolArray  # (*shape, 6)
    running: BoolArray  # (*shape,), for which members this row counts: up to the row of the outcome
    sampled: Sampled | None = None  # None where nobody samples


class Observer(Protocol):
    """Something that is called at every row, when the inputs are set.

    One that wants accelerations has the plant, and calls its `results`.
    """

    def row(self, row: Row) -> None:
        """Once a row, in the order of time."""
