"""Faults of the machine: legs whose force is cut, and sensors that freeze."""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from gough_stewart.harness.control.component import Clock, Signals, Stepped
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.signals import N_LEGS, NAMES, VARIABLES
from gough_stewart.harness.quantities import PositiveTime, Time
from gough_stewart.harness.section import Section
from gough_stewart.model.operations import greater, where
from gough_stewart.model.vectors import FloatArray

# What can fail: the forces of the legs, then the readings of all signals.
CUT = slice(0, N_LEGS)
FROZEN = slice(N_LEGS, N_LEGS + signals.SIZE)
N_FAULTS = FROZEN.stop
_SIZES = {variable.name: variable.size for variable in VARIABLES}


def _numbered(values: list[int], most: int, what: str) -> list[int]:
    for value in values:
        if not 1 <= value <= most:
            raise ValueError(f"no {what} {value}; expected numbers from 1 to {most}")
    if len(set(values)) < len(values):
        raise ValueError(f"is {values}; expected each number once")
    return values


def _legs(values: list[int]) -> list[int]:
    return _numbered(values, N_LEGS, "leg")


def _by_signal(value: Any) -> Any:
    if not isinstance(value, dict):
        raise ValueError(f"expected a table of signals ({', '.join(NAMES)})")  # noqa: TRY004 - pydantic wants this one
    for name in value:
        if name not in NAMES:
            raise ValueError(f"no signal '{name}'; expected {', '.join(NAMES)}")
    return value


def _elements(value: dict[str, list[int]]) -> dict[str, list[int]]:
    for name, elements in value.items():
        if not elements:
            raise ValueError(f"{name} is []; expected numbers from 1 to {_SIZES[name]}")
        _numbered(elements, _SIZES[name], f"element of {name}")
    return value


class FaultChoice(Section):
    """`[[fault]]`: legs that have no force, and readings that stay, for a time or to the end of the run."""

    at: Time
    duration: PositiveTime | None = None
    cut: Annotated[list[int], AfterValidator(_legs)] = Field(default_factory=list)
    freeze: Annotated[dict[str, list[int]], BeforeValidator(_by_signal), AfterValidator(_elements)] = Field(
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
        found = np.zeros(N_FAULTS)
        found[[leg - 1 for leg in self.cut]] = 1.0
        for name, elements in self.freeze.items():
            found[FROZEN.start + np.array(signals.positions([name]))[np.array(elements) - 1]] = 1.0
        return found


class NoCoefficients(NamedTuple):
    """Of what has no parameters."""


class _Fault(Stepped):
    """What a fault does; whether it acts is an input, since faults come and go by the host's clock."""

    name: ClassVar[str] = "fault"
    table: ClassVar[type[Section]] = FaultChoice
    keys: ClassVar[tuple[str, ...]] = ()
    outputs: ClassVar[tuple[str, ...]]
    states: ClassVar[tuple[str, ...]] = ()

    @staticmethod
    def prepare(values: Mapping[str, Any], period: Any) -> NoCoefficients:
        """As `Stepped`."""
        del values, period
        return NoCoefficients()

    @staticmethod
    def without_idle(coefficients: NoCoefficients) -> NoCoefficients:
        """As `Stepped`."""
        return coefficients

    @staticmethod
    def start(coefficients: NoCoefficients, inputs: Signals) -> Signals:
        """As `Stepped`."""
        del coefficients, inputs
        return ()


class Cut(_Fault):
    """The force of a leg, 0 while it is cut; its drive goes on beside it."""

    clock: ClassVar[Clock] = "plant step"
    inputs: ClassVar[tuple[str, ...]] = ("driven", "cut")
    outputs: ClassVar[tuple[str, ...]] = ("actuator_force",)

    @staticmethod
    def step(coefficients: NoCoefficients, states: Signals, inputs: Signals) -> tuple[Signals, Signals]:
        """As `Stepped`."""
        del coefficients
        driven, cut = inputs
        return states, (where(greater(cut, 0.0), 0.0, driven),)


class Freeze(_Fault):
    """A reading, or the last one before it froze."""

    clock: ClassVar[Clock] = "reading"
    inputs: ClassVar[tuple[str, ...]] = ("reading", "last", "frozen")
    outputs: ClassVar[tuple[str, ...]] = ("measured",)

    @staticmethod
    def step(coefficients: NoCoefficients, states: Signals, inputs: Signals) -> tuple[Signals, Signals]:
        """As `Stepped`."""
        del coefficients
        reading, last, frozen = inputs
        return states, (where(greater(frozen, 0.0), last, reading),)
