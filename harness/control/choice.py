"""`[controller]` of an experiment file: the controllers that it may name."""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from gough_stewart.harness.quantities import Frequency, LegForces, Number, PositiveTime, number
from gough_stewart.harness.section import Section


class _Controller(Section):
    feedforward: Literal["none", "gravity", "computed_torque"] = "none"
    # what the feedforward takes for the platform, where that differs from the plant
    model: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _model_of_feedforward(self) -> "_Controller":
        if self.model and self.feedforward == "none":
            raise ValueError("model is what feedforward believes in, and there is none; choose a feedforward")
        return self


class OpenLoop(_Controller):
    """Constant forces, and feedforward if wanted."""

    type: Literal["open_loop"]
    force: LegForces = (0.0,) * 6


def _gains(value: Any, unit: str) -> tuple[float, ...]:
    many = value if isinstance(value, list | tuple) else [value] * 6
    if len(many) != 6:
        raise ValueError(f"expected a number [{unit}] or a list of 6; found {len(many)} values")
    return tuple(number(each, unit) for each in many)


# In task space the last three channels are torques over angles: N.m/rad and so on, plain numbers.
ProportionalGains = Annotated[tuple[float, ...], BeforeValidator(lambda value: _gains(value, "N/m"))]
DerivativeGains = Annotated[tuple[float, ...], BeforeValidator(lambda value: _gains(value, "N.s/m"))]
IntegralGains = Annotated[tuple[float, ...], BeforeValidator(lambda value: _gains(value, "N/(m.s)"))]


class PD(_Controller):
    """Proportional and derivative action in six channels."""

    type: Literal["pd"]
    space: Literal["leg", "task"] = "leg"
    bandwidth: Frequency | None = None
    damping_ratio: Annotated[Number, Field(gt=0)] | None = None
    proportional_gain: ProportionalGains | None = None
    derivative_gain: DerivativeGains | None = None
    derivative_on: Literal["error", "measurement"] = "error"
    derivative_filter: PositiveTime | None = None
    discretisation: Literal["tustin", "backward_diff", "zoh"] = "tustin"

    @model_validator(mode="after")
    def _gains_or_bandwidth(self) -> "PD":
        gains = (self.proportional_gain, self.derivative_gain)
        if (self.bandwidth is None) == (None in gains) and self.bandwidth is None:
            raise ValueError("expected a bandwidth, or proportional_gain and derivative_gain")
        if self.bandwidth is not None and gains != (None, None):
            raise ValueError("expected a bandwidth or gains, not both")
        if self.bandwidth is None and self.damping_ratio is not None:
            raise ValueError("damping_ratio goes with a bandwidth; gains have theirs")
        return self


class PID(PD):
    """The same with integral action; anti-windup by back-calculation."""

    type: Literal["pid"]  # type: ignore[assignment]
    integral_gain: IntegralGains | None = None
    integral_time: PositiveTime | None = None
    anti_windup_time: PositiveTime | None = None

    @model_validator(mode="after")
    def _one_integral(self) -> "PID":
        if self.integral_gain is not None and self.integral_time is not None:
            raise ValueError("expected integral_gain or integral_time, not both")
        return self


class PythonController(_Controller):
    """One's own, from a Python file: a discrete python-control system, a LinearController, or a function."""

    type: Literal["python"]
    file: str
    name: str = "controller"


ControllerChoice = Annotated[OpenLoop | PD | PID | PythonController, Field(discriminator="type")]
