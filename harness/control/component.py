"""Components: what stands between the reference and the plant, each described once for every host.

A component is one class: the keys of its table with units and bounds, what comes in and goes out, its states, and its
equations. From these follow the keys of experiment files, of `--set`, `--vary` and `tune`, the run of N members in
NumPy, small signals for margins, the parameters and the traced equations of exported code, and the documentation's
tables. A host only moves time and values: it calls a component at the controller's samples, at the steps of the plant,
or at the sensors' readings, with the inputs of then.

Rules of the equations of a `Stepped` component:

1. Arrays have the members last: signals (size, N), parameters (N,) or numbers; or one member of CasADi symbols.
2. Nothing branches on a value. What compares is in `model/operations.py`. A part that is absent has the coefficient
   None, which is structure, not a value.
3. All that a step remembers is in its state; it keeps and changes no array that it was given.
"""

from abc import abstractmethod
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from gough_stewart.harness.control.state_space import Solve, StateSpace, matrices_at, series
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.section import Frequency, PositiveNumber, Share, TableSection, quantity_in
from gough_stewart.model.parameters import Bound

Signals = tuple[Any, ...]


class Parameter(NamedTuple):
    """A parameter of a component, as exported code has it."""

    name: str  # `notch_frequency`
    key: str  # `frequency`, in the table
    unit: str
    bound: Bound
    description: str
    condition: str  # besides the bound, on `value` and `sample_time`: "value * sample_time < 0.5"
    none: float | None = None  # the value of a part that is absent; 0 where it is written
    expected: str = ""  # the condition in the user's words


class Component:
    """What all components declare."""

    name: ClassVar[str]  # beginning of its parameters' names
    table: ClassVar[type[TableSection]]  # of an experiment, with its keys
    keys: ClassVar[tuple[str, ...]]  # those that are parameters of exported code
    conditions: ClassVar[Mapping[str, str]] = {}  # of keys, see `Parameter.condition`
    absent: ClassVar[Mapping[str, float]] = {}  # of keys that need not be given, see `Parameter.none`

    @classmethod
    def parameters(cls) -> tuple[Parameter, ...]:
        """Its parameters, in order."""
        parameters = []
        for key in cls.keys:
            field = cls.table.model_fields[key]
            quantity: Any = quantity_in(field.annotation, *field.metadata)
            none = cls.absent.get(key)
            bound: Bound = (getattr(quantity, "bound", None) if none is None else None) or ">= 0"
            name = key if key.startswith(cls.name) else f"{cls.name}_{key}"
            text = field.description or ""
            parameters.append(Parameter(name, key, quantity.unit, bound, text, cls.conditions.get(key, ""), none))
        return tuple(parameters)


class Stepped(Component):
    """A component that a host steps; see the rules above."""

    inputs: ClassVar[tuple[str, ...]]
    outputs: ClassVar[tuple[str, ...]]
    states: ClassVar[tuple[str, ...]] = ()
    by_channel: ClassVar[tuple[str, ...]] = ()  # coefficients that loops have for each channel

    @staticmethod
    @abstractmethod
    def prepare(values: Mapping[str, Any], period: Any) -> Any:
        """The coefficients, a named tuple, from the values of its keys and the time [s] between its steps."""

    @staticmethod
    def without_idle(coefficients: Any) -> Any:
        """The same for numbers, with None for parts that no member has, which costs no time in a step."""
        return coefficients

    @staticmethod
    def start(coefficients: Any, inputs: Signals) -> Signals:  # noqa: ARG004 - of those with states
        """The states at rest in these inputs, in the order of `states`."""
        return ()

    @staticmethod
    @abstractmethod
    def step(coefficients: Any, states: Signals, inputs: Signals) -> tuple[Signals, Signals]:
        """The next states, and the outputs until the next step; an output of None is one that nothing affects."""


class Link(TableSection, Component):
    """A linear component between the controller of six channels and its force or wrench, each channel alike.

    Hosts join it to the controller, whose step x⁺ = A x + B u they have; so it has matrices in place of a step.
    """

    @classmethod
    def __pydantic_init_subclass__(cls, **_options: Any) -> None:
        """It is a table, and all its keys are parameters."""
        cls.table, cls.keys = cls, tuple(cls.model_fields)

    @staticmethod
    @abstractmethod
    def linear(values: Mapping[str, Any], sample_time: Any, solve: Solve = np.linalg.solve) -> StateSpace:
        """One channel in discrete time, from the values of its keys, numbers or symbols in arrays (1,)."""

    def check(self, sample_time: float) -> None:
        """Refuse values that do not fit a sample time [s]."""


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
        channel = link.linear(values, sample_time, solve)
        A, B, C, D = (np.asarray(np.kron(np.eye(n), block)) for block in channel.blocks)
        controller = series(controller, StateSpace(A, B / gain, gain[:, None] * C, D, channel.dt))
    return controller


class Notch(Link):
    """N(s) = (s² + 2 d ζ ω s + ω²) / (s² + 2 ζ ω s + ω²) with ω = 2π `frequency`, `damping` ζ and `depth` d.

    |N| is d at the frequency and 1 far from it; between ω (√(1 + ζ²) ∓ ζ) it is less than √((1 + d²)/2). Sampled by
    Tustin's rule, warped so that the frequency stays. It filters the force of each channel, or the wrench.

    Raises
    ------
    ControllerError
        Impossible values.

    Examples
    --------
    >>> controller = gs.PD(bandwidth=3, notch=gs.Notch(frequency=30, damping=0.5, depth=0.1))
    >>> gs.margins("heave_step", {"controller": controller}).disk.alpha
    """

    error: ClassVar[type[ControllerError]] = ControllerError
    name: ClassVar[str] = "notch"
    conditions: ClassVar[Mapping[str, str]] = {"frequency": "value * sample_time < 0.5", "depth": "value < 1"}

    frequency: Annotated[Frequency, Field(description="of the notch")]
    damping: Annotated[PositiveNumber, Field(description="damping ratio of the notch: half its relative width")] = 0.5
    depth: Annotated[Share, Field(description="gain at its frequency, from 0 to below 1")] = 0.0

    def check(self, sample_time: float) -> None:
        """Refuse a frequency that a sample time [s] cannot show."""
        highest = 0.5 / sample_time
        if not self.frequency < highest:
            raise ControllerError(
                f"notch.frequency is {self.frequency:g} Hz; expected less than {highest:g} Hz, half the sampling "
                "frequency"
            )

    @staticmethod
    def linear(values: Mapping[str, Any], sample_time: Any, solve: Solve = np.linalg.solve) -> StateSpace:
        """ẋ₁ = ω x₂, ẋ₂ = ω (u − x₁ − 2 ζ x₂), y = u − 2 ζ (1 − d) x₂, by Tustin's rule with T' = 2/ω tan(ω T/2)."""
        omega, zeta, depth = 2 * np.pi * values["frequency"], values["damping"], values["depth"]
        zero = 0 * omega
        A = np.array([[zero, omega], [-omega, -2 * zeta * omega]])[..., 0]
        B = np.array([[zero], [omega]])[..., 0]
        C = np.array([[zero, -2 * zeta * (1 - depth)]])[..., 0]
        warped = 2 / omega * np.tan(omega * sample_time / 2)  # (1,): a bare symbol would treat an array as a matrix
        return matrices_at(StateSpace(A, B, C, np.array([[1.0]])), warped, "tustin", solve)
