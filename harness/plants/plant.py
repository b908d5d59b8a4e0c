"""What the loop asks of a plant, of one platform or of many."""

from collections.abc import Mapping
from types import TracebackType
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.errors import PlantError
from gough_stewart.harness.plants import signals
from gough_stewart.model.vectors import FloatArray

BoolArray = NDArray[np.bool_]


class Plant(Protocol):
    """The platform as the loop sees it, whatever it is made of.

    The contract:

    1. A plant comes with its platform's parameters set, at time 0 in its start state, under the actuator forces that
       hold its platform at home (`Platform.home_actuator_force`) and no external wrench.
    2. `set_inputs` takes the whole input vector (12,) in the order of `interface.INPUTS`; it holds until it is set
       anew.
    3. `set_parameters` takes tunable parameters by name, together or not at all, at any time between two steps.
    4. `results` gives all outputs and locals (N_RESULTS,) in the order of `interface.RESULT_COLUMNS`, at the present
       time under the present inputs; a copy. It changes nothing.
    5. `do_step(time, step)` goes from `time`, the plant's own, to `time + step`.
    6. What cannot be done raises an error of this project, with what the plant has to say, and leaves the plant as it
       was: `StepError` for a motion that the plant cannot pass, others for wrong use.
    7. Two plants of the same platform, start and inputs give the same results within their tolerance, 1e-8 by default.
    8. `close` frees what the plant holds, at any time and more than once; a plant is a context manager that does so.
    9. A plant of N platforms has the `shape` (N,), and that as leading axis in all arrays: (N, 12), (N, N_RESULTS); the
       elements of members lie side by side in memory, see `members`. `set_parameters` and `set_parameters_of` take
       values with this leading axis or without. `do_step` goes on with all members that can; those that cannot stay
       exactly as they were, for good, as if by `freeze`, and are in the `MembersError` that it raises at last.
    10. `signals` gives the head of the results (*shape, 24) at less cost; it may be a view, valid until the next step.
    """

    shape: tuple[int, ...] = ()

    def set_inputs(self, inputs: FloatArray) -> None:
        """Rule 2."""

    def set_parameters(self, values: Mapping[str, object]) -> None:
        """Rules 3 and 9."""

    def set_parameters_of(self, members: BoolArray, values: Mapping[str, object]) -> None:  # noqa: ARG002
        """The same of these members (N,) alone (rule 9); what the values say of others is not looked at."""
        raise _single(self)

    def signals(self) -> FloatArray:
        """Rule 10."""
        return self.results()[..., : signals.SIZE]

    def results(self) -> FloatArray:
        """Rule 4."""

    def do_step(self, time: float, step: float) -> None:
        """Rules 5, 6 and 9; both in s."""

    def freeze(self, members: BoolArray) -> None:  # noqa: ARG002
        """Leave these members (N,) as they are from here on (rule 9)."""
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
        f"{type(plant).__name__} is a plant of one platform; expected one of many for what some members do"
    )
