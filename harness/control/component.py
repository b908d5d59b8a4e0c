"""Links of a controller of six channels that have a table of their own, such as `[controller.notch]`.

A link is one class in one file: its keys with units and bounds, and its matrices, of numbers or of CasADi symbols. From
these follow the keys of experiment files, of `--set`, `--vary` and `tune`, the loop's law, margins, and the parameters
and equations of an exported controller.
"""

from abc import abstractmethod
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from gough_stewart.harness.control.state_space import Solve, StateSpace, series
from gough_stewart.harness.quantities import quantity_in
from gough_stewart.harness.section import Section
from gough_stewart.model.parameters import Bound


class Parameter(NamedTuple):
    """A parameter of a link, as an exported controller has it."""

    name: str  # `notch_frequency`
    key: str  # `frequency`, in the table
    unit: str
    bound: Bound
    description: str
    condition: str  # besides the bound, on `value` and `sample_time`: "value * sample_time < 0.5"


class Link(Section):
    """A link between the controller of six channels and its force or wrench, each channel alike."""

    name: ClassVar[str]  # of its table and of its parameters
    conditions: ClassVar[Mapping[str, str]] = {}  # of keys, see `Parameter.condition`

    @staticmethod
    @abstractmethod
    def channel(values: Mapping[str, Any], sample_time: Any, solve: Solve = np.linalg.solve) -> StateSpace:
        """One channel in discrete time, from the values of its keys, numbers or symbols in arrays (1,)."""

    def check(self, sample_time: float) -> None:
        """Refuse values that do not fit a sample time [s].

        Raises
        ------
        ControllerError
            Names the key, its value, and what was expected.
        """

    @classmethod
    def parameters(cls) -> tuple[Parameter, ...]:
        """Its keys as parameters, in order."""
        found = []
        for key, field in cls.model_fields.items():
            quantity: Any = quantity_in(field.annotation, *field.metadata)
            bound: Bound = getattr(quantity, "bound", None) or ">= 0"
            condition = cls.conditions.get(key, "")
            found.append(Parameter(f"{cls.name}_{key}", key, quantity.unit, bound, field.description or "", condition))
        return tuple(found)

    def values(self) -> dict[str, Any]:
        """The values of its keys."""
        return {key: np.array([getattr(self, key)]) for key in type(self).model_fields}


def with_links(
    controller: StateSpace,
    links: Iterable[tuple[type[Link], Mapping[str, Any]]],
    sample_time: Any,
    solve: Solve = np.linalg.solve,
) -> StateSpace:
    """A discrete controller followed by links with these values, in order.

    The states of links are in parts of the controller's direct gain: forces beside errors would leave matrices that no
    solver likes.
    """
    n = controller.noutputs
    gain = np.diagonal(controller.D[:, :n])
    for link, values in links:
        one = link.channel(values, sample_time, solve)
        A, B, C, D = (np.asarray(np.kron(np.eye(n), each)) for each in (one.A, one.B, one.C, one.D))
        controller = series(controller, StateSpace(A, B / gain, gain[:, None] * C, D, one.dt))
    return controller
