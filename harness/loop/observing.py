"""Observers of a run: called at every row, for one member or many."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.model.vectors import FloatArray


@dataclass(slots=True)
class Sampled:
    """What the controllers did at a sample; views, valid during the call only."""

    j: int  # index of the sample
    due: BoolArray | None  # (N,), members sampled at this row; None means all
    measured: FloatArray  # (*shape, 24); of many members only the signals that controllers use
    state: FloatArray  # (*shape, n_states), before the command was computed
    command: FloatArray  # (*shape, 6), before limits
    force_limited: BoolArray  # (*shape, 6)
    used: tuple[str, ...] = ()  # the signals that controllers use


class Row(NamedTuple):
    """A row of a run; views, valid during the call only."""

    k: int
    time: float  # [s]
    signals: FloatArray  # (*shape, 24)
    inputs: FloatArray  # (*shape, 12), acting from now on
    reference: FloatArray | None  # (30,) or (*shape, 30)
    command: FloatArray  # (*shape, 6) of the latest sample, before limits
    force_limited: BoolArray  # (*shape, 6), of the latest sample
    rate_limited: BoolArray  # (*shape, 6)
    running: BoolArray  # (*shape,), members for which this row counts: up to the row of the outcome
    sampled: Sampled | None = None  # None if no member is sampled


class Observer(Protocol):
    """Called at every row, when the inputs are set.

    An observer that needs accelerations calls `results` of the plant.
    """

    def row(self, row: Row) -> None:
        """Called once per row, in order of time."""
