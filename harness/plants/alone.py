"""A plant of one platform as a plant of one member."""

from collections.abc import Callable, Mapping

import numpy as np

from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.plant import BoolArray, Plant
from gough_stewart.model.errors import MembersError, StepError
from gough_stewart.model.vectors import FloatArray


class Alone(Plant):
    """A plant of shape () with a member axis, (1,): a user's own, the model, an FMU."""

    shape = (1,)

    def __init__(self, plant: Plant) -> None:
        self._plant, self._signals = plant, signals_of(plant)
        self.may_overrun = getattr(plant, "may_overrun", False)
        self.columns = getattr(plant, "columns", Plant.columns)

    def set_inputs(self, inputs: FloatArray) -> None:
        """Rule 2 of `Plant`."""
        self._plant.set_inputs(inputs[0])

    def set_parameters(self, values: Mapping[str, object]) -> None:
        """Rule 3."""
        self._plant.set_parameters(values)

    def set_parameters_of(self, members: BoolArray, values: Mapping[str, object]) -> None:
        """Rule 9; values are those of one platform."""
        if members.any():
            self._plant.set_parameters(values)

    def signals(self) -> FloatArray:
        """Rule 11."""
        return self._signals()[np.newaxis]

    def results(self) -> FloatArray:
        """Rule 4."""
        return self._plant.results()[np.newaxis]

    def do_step(self, time: float, step: float) -> None:
        """Rules 5, 6 and 9."""
        try:
            self._plant.do_step(time, step)
        except StepError as error:
            raise MembersError({0: error}) from error

    def freeze(self, members: BoolArray) -> None:
        """Rule 9: the run has ended."""

    def close(self) -> None:
        """Rule 8."""
        self._plant.close()


def seen_of(plant: Plant, side: signals.Side) -> Callable[[], FloatArray]:
    """What sensors see: the signals, with lengths and velocities at the motors' side of legs that give.

    Rigid legs have one side.
    """
    columns = tuple(getattr(plant, "columns", Plant.columns))
    if side == "leg" or signals.MOTORS not in columns:
        return signals_of(plant)
    at = columns.index(signals.MOTORS)
    size = signals.LEGS.stop - signals.LEGS.start

    def seen() -> FloatArray:
        found = plant.results()
        return np.concatenate([found[..., : signals.LEGS.start], found[..., at : at + size]], axis=-1)

    return seen


def signals_of(plant: Plant) -> Callable[[], FloatArray]:
    """The function that reads them; a plant that does not inherit from `Plant` may lack `signals`."""
    return plant.signals if hasattr(plant, "signals") else lambda: plant.results()[..., : signals.SIZE]
