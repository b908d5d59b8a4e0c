"""The interface that the loop requires of a plant, of one platform or many, and a plant of one as one of many."""

from collections.abc import Mapping
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.errors import PlantError
from gough_stewart.harness.plants import signals
from gough_stewart.model import interface
from gough_stewart.model.errors import InterfaceError, MembersError, StepError
from gough_stewart.model.interface import Variant
from gough_stewart.model.parameters import Variable
from gough_stewart.model.vectors import FloatArray

BoolArray = NDArray[np.bool_]


class Closing(Protocol):
    """What closes itself as a context manager."""

    def close(self) -> None:
        """Release the resources, by default nothing; may be called again."""
        return

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Plant(Closing, Protocol):
    """The platform as seen by the loop, for any implementation.

    The contract:

    1. A plant comes with its platform's parameters set, at time 0 in its start state, under the actuator forces that
       hold its platform at home (`Platform.home_actuator_force`) and no external wrench.
    2. `set_inputs` takes the whole input vector (12,) in the order of `interface.INPUTS`; it holds until the next call.
    3. `set_parameters` sets tunable parameters by name, all or none, at any time between two steps.
    4. `results` returns all outputs and locals (N_RESULTS,) in the order of `columns`, at the present time under the
       present inputs, as a copy. It has no side effects. A plant with stiction or elastic legs has
       more of them, see `Variant.columns`.
    5. `do_step(time, step)` advances from `time`, the plant's own, to `time + step`.
    6. A failed call raises an error of this project with the plant's message and leaves the plant unchanged:
       `StepError` for a motion that the plant cannot perform, other errors for wrong use.
    7. Two plants of the same platform, start and inputs give the same results within their tolerance, 1e-8 by default.
    8. `close` releases the plant's resources, at any time and repeatedly; as a context manager, a plant closes itself.
    9. A plant of N platforms has the `shape` (N,), the leading axis of all arrays: (N, 12), (N, N_RESULTS); members are
       contiguous in memory, see `signals`. `set_parameters` and `set_parameters_of` accept values with or without this
       axis. `do_step` advances all members that can continue; those that cannot stay unchanged from then on, as after
       `freeze`, and are listed in the `MembersError` that it raises at the end.
    10. `signals` returns the first part of the results (*shape, 24) faster, perhaps as a view, valid until the next
       step.
    11. `remarks` returns what a plant from elsewhere said since the last call while all went well, "" for nothing.

    A user's plant of one platform needs `set_inputs`, `set_parameters`, `results` and `do_step`.
    """

    shape: tuple[int, ...] = ()
    columns: tuple[str, ...] = interface.RESULT_COLUMNS

    def set_inputs(self, inputs: FloatArray) -> None:
        """Hold these inputs (*shape, 12) from now on."""

    def set_parameters(self, values: Mapping[str, object]) -> None:
        """Set tunable parameters of all members by name, all of them or none."""

    def results(self) -> FloatArray:
        """A copy of all outputs and locals (*shape, N_RESULTS) at the present time."""

    def do_step(self, time: float, step: float) -> None:
        """Advance all members that can continue from a time [s] by a step [s]."""

    def signals(self) -> FloatArray:
        """The first part of the results (*shape, 24), perhaps a view that is valid until the next step."""
        return self.results()[..., : signals.SIZE]

    def set_parameters_of(self, members: BoolArray, values: Mapping[str, object]) -> None:  # noqa: ARG002
        """Set tunable parameters of these members (N,) only; values of the others are ignored."""
        raise PlantError(f"{type(self).__name__} cannot set parameters of members; expected a plant of many platforms")

    def freeze(self, members: BoolArray) -> None:
        """Leave these members (N,) in their present state from now on; with its only member a run has ended."""
        if len(members) > 1:
            raise PlantError(f"{type(self).__name__} cannot freeze members; expected a plant of many platforms")

    def remarks(self) -> str:
        """What the plant said since the last call while all went well."""
        return ""


class PlantOfOne(Plant):
    """A plant of shape () as one of shape (1,): a user's own, which may lack what has a default, the model, an FMU."""

    shape = (1,)

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self.columns = getattr(plant, "columns", Plant.columns)
        self._has_signals = hasattr(plant, "signals")

    def set_inputs(self, inputs: FloatArray) -> None:
        self._plant.set_inputs(inputs[0])

    def set_parameters(self, values: Mapping[str, object]) -> None:
        self._plant.set_parameters(values)

    def set_parameters_of(self, members: BoolArray, values: Mapping[str, object]) -> None:
        if members.any():
            self._plant.set_parameters(values)

    def signals(self) -> FloatArray:
        return self._plant.signals()[np.newaxis] if self._has_signals else super().signals()

    def results(self) -> FloatArray:
        return self._plant.results()[np.newaxis]

    def do_step(self, time: float, step: float) -> None:
        try:
            self._plant.do_step(time, step)
        except StepError as error:
            raise MembersError({0: error}) from error


def tunable(variant: Variant, name: str) -> Variable:
    """The parameter of this name, which may change during a run; `InterfaceError` lists those that may."""
    for variable in variant.tunable:
        if variable.name == name:
            return variable
    names = ", ".join(variable.name for variable in variant.tunable)
    raise InterfaceError(name, f"cannot be set during a run; expected one of {names}")


def seen(plant: Plant, side: signals.Side) -> FloatArray:
    """The signals (*shape, 24) for sensors at this side of legs: motors' lengths and velocities of elastic ones."""
    if side == "leg" or signals.MOTORS not in plant.columns:
        return plant.signals()
    results, first, n = plant.results(), plant.columns.index(signals.MOTORS), signals.LEGS.stop - signals.LEGS.start
    return np.concatenate([results[..., : signals.LEGS.start], results[..., first : first + n]], axis=-1)
