"""The sensors: what a reading makes of a true signal."""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, NamedTuple

from pydantic import BeforeValidator, Field

from gough_stewart.harness.control.component import Parameter, Signals, Stepped
from gough_stewart.harness.plants.signals import NAMES, VARIABLES, Side
from gough_stewart.harness.quantities import PositiveTime
from gough_stewart.harness.section import TableSection
from gough_stewart.model.operations import greater, rounded, where
from gough_stewart.model.parameters import Variable
from gough_stewart.model.units import number

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

    step: Any  # q, 1 where there is none; None if no member has one
    has_steps: Any  # whether there is one; None if all members have


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
    def parameters(cls, signals: tuple[Variable, ...] = VARIABLES) -> tuple[Parameter, ...]:
        """Its parameters for each of some signals, by the key `quantisation.NAME`."""
        text = cls.table.model_fields["quantisation"].description
        condition = f"value <= 0 || value >= {FINEST:g}"
        return tuple(
            Parameter(
                *(f"{v.name}_quantisation", f"quantisation.{v.name}", v.unit, ">= 0", f"{text} of {v.name}", condition),
                none=0.0,
                expected=f"0, which is none, or at least {FINEST:g} {v.unit}",
            )
            for v in signals
        )

    @staticmethod
    def prepare(values: Mapping[str, Any], _period: Any = None) -> SensorCoefficients:
        step = values["quantisation"]
        has_steps = greater(step, 0.0)
        return SensorCoefficients(where(has_steps, step, 1.0), has_steps)

    @staticmethod
    def without_idle(coefficients: SensorCoefficients) -> SensorCoefficients:
        c = coefficients
        if not c.has_steps.any():
            return SensorCoefficients(None, None)
        return c._replace(has_steps=None) if c.has_steps.all() else c

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
