"""The interface that the loop requires of a plant, of one platform or many."""

from collections.abc import Mapping
from types import TracebackType
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.errors import PlantError
from gough_stewart.harness.plants import signals
from gough_stewart.model import interface
from gough_stewart.model.vectors import FloatArray

BoolArray = NDArray[np.bool_]


class Plant(Protocol):
    """The platform as seen by the loop, for any implementation.

    The contract:

    1. A plant comes with its platform's parameters set, at time 0 in its start state, under the actuator forces that
       hold its platform at home (`Platform.home_actuator_force`) and no external wrench.
    2. `set_inputs` takes the whole input vector (12,) in the order of `interface.INPUTS`; it holds until the next call.
    3. `set_parameters` sets tunable parameters by name, all or none, at any time between two steps.
    4. `results` returns all outputs and locals (N_RESULTS,) in the order of `columns`, at the present time under the
       present inputs, as a copy. It has no side effects. If its friction sticks or its legs give, it has more of them,
       see `Variant.columns`.
    5. `do_step(time, step)` advances from `time`, the plant's own, to `time + step`.
    6. A failed call raises an error of this project with the plant's message and leaves the plant unchanged:
       `StepError` for a motion that the plant cannot perform, other errors for wrong use.
    7. Two plants of the same platform, start and inputs give the same results within their tolerance, 1e-8 by default.
    8. `close` releases the plant's resources, at any time and repeatedly; as a context manager, a plant closes itself.
    9. A plant of N platforms has the `shape` (N,), the leading axis of all arrays: (N, 12), (N, N_RESULTS); members are
       contiguous in memory, see `members`. `set_parameters` and `set_parameters_of` accept values with or without this
       axis. `do_step` advances all members that can continue; those that cannot stay unchanged from then on, as after
       `freeze`, and are listed in the `MembersError` that it raises at the end.
    10. A plant that `may_overrun` may be stepped for some rows more after a run has reached a limit; by default none
       is.
    11. `signals` returns the first part of the results (*shape, 24) faster, perhaps as a view, valid until the next
       step.
    12. `remarks` returns what a plant from elsewhere said since the last call while all went well, "" for nothing.
    """

    shape: tuple[int, ...] = ()
    may_overrun: bool = False
    columns: tuple[str, ...] = interface.RESULT_COLUMNS

    def set_inputs(self, inputs: FloatArray) -> None:
        """Rule 2."""

    def set_parameters(self, values: Mapping[str, object]) -> None:
        """Rules 3 and 9."""

    def set_parameters_of(self, members: BoolArray, values: Mapping[str, object]) -> None:  # noqa: ARG002
        """Rule 9 for these members (N,) only; values of the others are ignored."""
        raise _single(self)

    def signals(self) -> FloatArray:
        """Rule 11."""
        return self.results()[..., : signals.SIZE]

    def results(self) -> FloatArray:
        """Rule 4."""

    def do_step(self, time: float, step: float) -> None:
        """Rules 5, 6 and 9; both in s."""

    def remarks(self) -> str:
        """Rule 12."""
        return ""

    def freeze(self, members: BoolArray) -> None:  # noqa: ARG002
        """Freeze these members (N,) in their present state (rule 9)."""
        raise _single(self)

    def close(self) -> None:
        """Rule 8."""

    def __enter__(self) -> Self:
        """Rule 8."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Rule 8."""
        self.close()


def _single(plant: Plant) -> PlantError:
    return PlantError(
        f"{type(plant).__name__} is a plant of one platform; expected a plant of many platforms for member actions"
    )
