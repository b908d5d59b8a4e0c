"""Components: what stands between the reference and the plant, each described once for every host.

A component is one class: the keys of its table with units and bounds, what comes in and goes out, its states, and its
equations. From these follow the keys of experiment files, of `--set`, `--vary` and `tune`, the machine code of loops,
small signals for margins, the parameters and the traced equations of exported code, and the documentation's tables. A
host only moves time and values: it calls a component at the controller's samples, at the steps of the plant, or at the
sensors' readings, with the inputs of then.

In the order of the loop: links filter what a controller gives, the takeover makes of it the command, limits clip it,
and a drive follows it with the force that acts; a sensor reads a true signal; faults cut forces and freeze readings.

Rules of the equations of a `Stepped` component:

1. Arrays have the members last: signals (size, N), parameters (N,) or numbers; or one member of CasADi symbols.
2. Nothing branches on a value. What compares is in `model/vectors.py`. A part that is absent has the coefficient
   None, which is structure, not a value.
3. All that a step remembers is in its state; it keeps and changes no array that it was given.
"""

from abc import abstractmethod
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from gough_stewart.harness.control.state_space import Solve, StateSpace, matrices_at, series
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.signals import N_LEGS, NAMES, VARIABLES, Side
from gough_stewart.harness.section import (
    Frequency,
    PositiveForceRate,
    PositiveNumber,
    PositiveTime,
    Share,
    TableSection,
    Time,
    Unit,
    annotation_in,
    positive_or_word,
)
from gough_stewart.model.parameters import Bound, Variable
from gough_stewart.model.units import number
from gough_stewart.model.vectors import FloatArray, clip, greater, less, minimum, not_equal, rounded, sign, where

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
            quantity: Any = annotation_in(Unit, field.annotation, *field.metadata)
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
    def start(coefficients: Any, inputs: Signals) -> Signals:  # noqa: ARG004 - of those with states
        """The states at rest in these inputs, in the order of `states`."""
        return ()

    @staticmethod
    @abstractmethod
    def step(coefficients: Any, states: Signals, inputs: Signals) -> tuple[Signals, Signals]:
        """The next states, and the outputs until the next step; an output of None is one that nothing affects."""


# ---- links ----


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
    n = len(controller.D)
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


# ---- manual operation, and drives ----

# In which a force that was taken over from manual operation fades [s].
TRANSFER_TIME = 1.0


class TakeoverCoefficients(NamedTuple):
    """Of `Takeover`."""

    share: Any  # of what was taken over that fades in a sample


class Takeover(Stepped):
    """Off, the command is the manual force; on, it begins there, and its distance from the controller's own fades."""

    name: ClassVar[str] = "takeover"
    table: ClassVar[type[TableSection]] = TableSection
    keys: ClassVar[tuple[str, ...]] = ()
    inputs: ClassVar[tuple[str, ...]] = ("wanted", "manual_force", "off")
    outputs: ClassVar[tuple[str, ...]] = ("command",)
    states: ClassVar[tuple[str, ...]] = ("transfer",)

    @staticmethod
    def prepare(_values: Mapping[str, Any], period: Any) -> TakeoverCoefficients:
        return TakeoverCoefficients(period / TRANSFER_TIME)

    @staticmethod
    def start(_coefficients: TakeoverCoefficients, inputs: Signals) -> Signals:
        return (0 * inputs[0],)

    @staticmethod
    def step(coefficients: TakeoverCoefficients, states: Signals, inputs: Signals) -> tuple[Signals, Signals]:
        (transfer,), (wanted, manual_force, off) = states, inputs
        is_off = greater(off, 0.0)
        lacked = where(is_off, manual_force - wanted, transfer - transfer * coefficients.share)
        return (lacked,), (where(is_off, manual_force, wanted + transfer),)


ForceLimit = Annotated[
    float | str,
    BeforeValidator(lambda value: positive_or_word(value, "N", "platform", "none")),
    *(Unit("N"), Field(description="largest force of an actuator")),
]


class ActuatorChoice(TableSection):
    """`[actuators]`: limits, and the time constant of a lag; the platform's force limit by default."""

    force_limit: ForceLimit = "platform"
    rate_limit: Annotated[PositiveForceRate | None, Field(description="rate limit of the drives")] = None
    lag: Annotated[Time, Field(description="time constant of the drives")] = 0.0


class LimitCoefficients(NamedTuple):
    """Of `ForceLimits`."""

    low: Any  # [N]; None without a limit
    high: Any
    change: Any  # largest change of the force in a sample [N]; None without a rate limit


class ForceLimits(Stepped):
    """Clips a command to ± `force_limit`, and foresees how much of it the drives reach within a sample.

    Their force one sample after each command, `planned`, changes by at most `rate_limit` times the sample time. The
    excess is `planned` minus the command, which controllers with integral action feed back.
    """

    name: ClassVar[str] = "force"
    table: ClassVar[type[TableSection]] = ActuatorChoice
    keys: ClassVar[tuple[str, ...]] = ("force_limit", "rate_limit")
    absent: ClassVar[Mapping[str, float]] = {"force_limit": np.inf, "rate_limit": np.inf}
    inputs: ClassVar[tuple[str, ...]] = ("command",)
    outputs: ClassVar[tuple[str, ...]] = ("allowed", "force_limited", "excess")
    states: ClassVar[tuple[str, ...]] = ("planned",)
    by_channel: ClassVar[tuple[str, ...]] = ("low", "high")

    @staticmethod
    def prepare(values: Mapping[str, Any], period: Any) -> LimitCoefficients:
        limit = values["force_limit"]
        return LimitCoefficients(-limit, limit, values["rate_limit"] * period)

    @staticmethod
    def start(coefficients: LimitCoefficients, inputs: Signals) -> Signals:
        """The command; no states without a rate limit."""
        return () if coefficients.change is None else inputs

    @staticmethod
    def step(coefficients: LimitCoefficients, states: Signals, inputs: Signals) -> tuple[Signals, Signals]:
        low, high, change = coefficients
        (command,) = inputs
        if high is None:
            allowed, is_cut = command, None
        else:
            allowed = clip(command, low, high)
            is_cut = not_equal(allowed, command)
        if change is None:
            return states, (allowed, is_cut, None if high is None else allowed - command)
        (planned,) = states
        planned = clip(allowed, planned - change, planned + change)
        return (planned,), (allowed, is_cut, planned - command)


class DriveCoefficients(NamedTuple):
    """Of `Drive`."""

    period: Any  # h [s]
    rate: Any  # [N/s], infinite without a limit; None if that is left out
    slope: Any  # the same, 0 without a limit
    lag: Any  # τ [s], 1 where there is none; None if it is left out
    lags: Any  # whether there is one; None if all have


class Drive(Stepped):
    """Follows a target within `rate_limit`, ṙ = ± rate until r is there, and then by a `lag` τ ḟ = r − f.

    Between two steps of the plant r is a ramp and then constant, so r and f are exact; the force that acts is the mean
    of f over the step.
    """

    name: ClassVar[str] = "force"
    table: ClassVar[type[TableSection]] = ActuatorChoice
    keys: ClassVar[tuple[str, ...]] = ("rate_limit", "lag")
    absent: ClassVar[Mapping[str, float]] = {"rate_limit": np.inf, "lag": 0.0}
    inputs: ClassVar[tuple[str, ...]] = ("target",)
    outputs: ClassVar[tuple[str, ...]] = ("actuator_force", "rate_limited")
    states: ClassVar[tuple[str, ...]] = ("reached", "followed")

    @staticmethod
    def prepare(values: Mapping[str, Any], period: Any) -> DriveCoefficients:
        rate, lag = values["rate_limit"], values["lag"]
        lags = greater(lag, 0.0)
        return DriveCoefficients(period, rate, where(less(rate, np.inf), rate, 0.0), where(lags, lag, 1.0), lags)

    @staticmethod
    def start(_coefficients: DriveCoefficients, inputs: Signals) -> Signals:
        return inputs[0], inputs[0]

    @staticmethod
    def step(coefficients: DriveCoefficients, states: Signals, inputs: Signals) -> tuple[Signals, Signals]:
        h, rate, slope, tau, lags = coefficients
        (r0, force), (target,) = states, inputs
        if rate is None:
            r1 = mean = target
            reached, on_ramp, rest, is_behind = r0, force, h, None
        else:
            # from r₀ to the target at ±rate, reached after a ≤ h, or at the step's end not yet
            distance = target - r0
            a = minimum(np.abs(distance) / rate, h)
            slope = sign(distance) * slope
            r1 = where(less(a, h), target, r0 + slope * h)
            mean = r1 - (r1 - r0) * a / (2 * h)
            reached, is_behind = r1, not_equal(r1, target)
        if tau is None:
            return (reached, force), (mean, is_behind)
        if rate is not None:
            # on the ramp f = r − s τ + (f₀ − r₀ + s τ) e^(−t/τ)
            ramp = slope * tau
            on_ramp = r0 + slope * a - ramp + (force - r0 + ramp) * np.exp(-a / tau)
            on_ramp = where(greater(a, 0.0), on_ramp, force)
            rest = h - a
        # then f = r₁ + (f − r₁) e^(−t/τ); the mean of ḟ = (r − f)/τ over the step
        following = r1 + (on_ramp - r1) * np.exp(-rest / tau)
        late = mean - (following - force) * tau / h
        return (reached, following), (late if lags is None else where(lags, late, mean), is_behind)


# ---- sensors ----

# Smaller noise and steps are rounding, and their inverse overflows.
FINEST = 1e-15
_UNITS = {variable.name: variable.unit for variable in VARIABLES}


def by_signal(value: Any) -> dict[str, Any]:
    """A table whose keys are signals."""
    if not isinstance(value, dict):
        raise ValueError(f"expected a table of signals ({', '.join(NAMES)})")  # noqa: TRY004 - pydantic wants this one
    for name in value:
        if name not in NAMES:
            raise ValueError(f"no signal '{name}'; expected {', '.join(NAMES)}")
    return value


def _sizes(value: Any) -> dict[str, float]:
    sizes = {}
    for name, size in by_signal(value).items():
        try:
            sizes[name] = number(size, _UNITS[name])
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None
        if sizes[name] and not sizes[name] >= FINEST:
            raise ValueError(f"{name} is {size!r}; expected 0, or at least {FINEST:g} {_UNITS[name]}")
    return sizes


PerSignal = Annotated[dict[str, float], BeforeValidator(_sizes)]


class SensorChoice(TableSection):
    """`[sensors]`: standard deviation of noise and quantisation step by signal, and their sample time."""

    noise: Annotated[PerSignal, Field(description="standard deviation of white noise")] = Field(default_factory=dict)
    quantisation: Annotated[PerSignal, Field(description="quantisation step")] = Field(default_factory=dict)
    # by default the controller's
    sample_time: Annotated[PositiveTime | None, Field(description="time between readings")] = None
    # of elastic legs: where their length and velocity are read; the same of rigid ones
    side: Annotated[Side, Field(description="side of a leg that its encoder reads")] = "leg"
    seed: Annotated[int, Field(ge=0)] = 0  # of noise and jitter


class SensorCoefficients(NamedTuple):
    """Of `Sensor`."""

    step: Any  # q, 1 where there is none; None if it is left out
    has_steps: Any  # whether there is one; None if all have


class Sensor(Stepped):
    """A reading of one signal: q · round((true + noise)/q) with the step q of its `quantisation`.

    Noise is an input, since random streams are the host's; so is the time of a reading.
    """

    name: ClassVar[str] = "sensor"
    table: ClassVar[type[TableSection]] = SensorChoice
    keys: ClassVar[tuple[str, ...]] = ("quantisation",)
    absent: ClassVar[Mapping[str, float]] = {"quantisation": 0.0}
    inputs: ClassVar[tuple[str, ...]] = ("true", "noise")
    outputs: ClassVar[tuple[str, ...]] = ("reading",)

    @classmethod
    def parameters(cls, of_signals: tuple[Variable, ...] = VARIABLES) -> tuple[Parameter, ...]:
        """Its parameters for each of some signals, by the key `quantisation.NAME`."""
        text = cls.table.model_fields["quantisation"].description
        condition = f"value <= 0 || value >= {FINEST:g}"
        return tuple(
            Parameter(
                *(f"{v.name}_quantisation", f"quantisation.{v.name}", v.unit, ">= 0", f"{text} of {v.name}", condition),
                none=0.0,
                expected=f"0, which is none, or at least {FINEST:g} {v.unit}",
            )
            for v in of_signals
        )

    @staticmethod
    def prepare(values: Mapping[str, Any], _period: Any = None) -> SensorCoefficients:
        step = values["quantisation"]
        has_steps = greater(step, 0.0)
        return SensorCoefficients(where(has_steps, step, 1.0), has_steps)

    @staticmethod
    def step(coefficients: SensorCoefficients, states: Signals, inputs: Signals) -> tuple[Signals, Signals]:
        q, has_steps = coefficients
        true, noise = inputs
        reading = true if noise is None else true + noise
        if q is None:
            return states, (reading,)
        counted = rounded(reading / q)
        counted *= q
        return states, (counted if has_steps is None else where(has_steps, counted, reading),)


# ---- faults ----

# What can fail: the forces of the legs, then the readings of all signals.
CUT = slice(0, N_LEGS)
FROZEN = slice(N_LEGS, N_LEGS + signals.SIZE)
N_FAULTS = FROZEN.stop
_SIZES = {variable.name: variable.size for variable in VARIABLES}


def _numbered(values: list[int], most: int, kind: str) -> list[int]:
    for value in values:
        if not 1 <= value <= most:
            raise ValueError(f"no {kind} {value}; expected numbers from 1 to {most}")
    if len(set(values)) < len(values):
        raise ValueError(f"is {values}; expected each number once")
    return values


def _elements(value: dict[str, list[int]]) -> dict[str, list[int]]:
    for name, elements in value.items():
        if not elements:
            raise ValueError(f"{name} is []; expected numbers from 1 to {_SIZES[name]}")
        _numbered(elements, _SIZES[name], f"element of {name}")
    return value


class FaultChoice(TableSection):
    """`[[fault]]`: legs that have no force, and readings that stay, for a time or to the end of the run."""

    at: Time
    duration: PositiveTime | None = None
    cut: Annotated[list[int], AfterValidator(lambda legs: _numbered(legs, N_LEGS, "leg"))] = Field(default_factory=list)
    freeze: Annotated[dict[str, list[int]], BeforeValidator(by_signal), AfterValidator(_elements)] = Field(
        default_factory=dict
    )

    @model_validator(mode="after")
    def _something(self) -> "FaultChoice":
        if not self.cut and not self.freeze:
            raise ValueError("has no effect; expected cut, a list of legs, or freeze, a table of signals")
        return self

    @property
    def flags(self) -> FloatArray:
        """What fails (N_FAULTS,): 1 or 0."""
        flags = np.zeros(N_FAULTS)
        flags[[leg - 1 for leg in self.cut]] = 1.0
        for name, elements in self.freeze.items():
            flags[FROZEN.start + np.array(signals.positions([name]))[np.array(elements) - 1]] = 1.0
        return flags


class NoCoefficients(NamedTuple):
    """Of what has no parameters."""


class _Fault(Stepped):
    """What a fault does; whether it acts is an input, since faults come and go by the host's clock."""

    name: ClassVar[str] = "fault"
    table: ClassVar[type[TableSection]] = FaultChoice
    keys: ClassVar[tuple[str, ...]] = ()

    @staticmethod
    def prepare(_values: Mapping[str, Any], _period: Any) -> NoCoefficients:
        return NoCoefficients()


class Cut(_Fault):
    """The force of a leg, 0 while it is cut; its drive goes on beside it."""

    inputs: ClassVar[tuple[str, ...]] = ("driven", "cut")
    outputs: ClassVar[tuple[str, ...]] = ("actuator_force",)

    @staticmethod
    def step(_coefficients: NoCoefficients, states: Signals, inputs: Signals) -> tuple[Signals, Signals]:
        driven, cut = inputs
        return states, (where(greater(cut, 0.0), 0.0, driven),)


class Freeze(_Fault):
    """A reading, or the last one before it froze."""

    inputs: ClassVar[tuple[str, ...]] = ("reading", "last", "frozen")
    outputs: ClassVar[tuple[str, ...]] = ("measured",)

    @staticmethod
    def step(_coefficients: NoCoefficients, states: Signals, inputs: Signals) -> tuple[Signals, Signals]:
        reading, last, frozen = inputs
        return states, (where(greater(frozen, 0.0), last, reading),)
