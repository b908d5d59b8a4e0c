"""Faults of the machine: legs whose force is cut, and sensors that freeze."""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from gough_stewart.harness.control.component import Signals, Stepped
from gough_stewart.harness.control.sensor import by_signal
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.signals import N_LEGS, VARIABLES
from gough_stewart.harness.quantities import PositiveTime, Time
from gough_stewart.harness.section import TableSection
from gough_stewart.model.operations import greater, where
from gough_stewart.model.vectors import FloatArray

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
