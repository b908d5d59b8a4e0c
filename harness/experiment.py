"""What an experiment is: the schema of its TOML file, and of the same in Python."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from gough_stewart.harness.kinds import PlantKind
from gough_stewart.harness.quantities import (
    Angle,
    AngularVelocity,
    Force,
    Frequency,
    LegForces,
    Orientation,
    Position,
    PositiveForce,
    PositiveForceRate,
    PositiveLength,
    PositiveTime,
    Time,
    Torque,
    Velocity,
    number,
)
from gough_stewart.harness.signals import NAMES, VARIABLES
from gough_stewart.model.cases import PAPER_PRESET

_REST = (0.0, 0.0, 0.0)
_SIGNAL_UNITS = {variable.name: variable.unit for variable in VARIABLES}


class Section(BaseModel):
    """A table of the file: unknown keys are errors, nothing changes once it is made."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class PlatformChoice(Section):
    """`[platform]`: a preset, or a file of one's own; single parameters may be changed."""

    preset: str | None = None
    file: str | None = None
    parameters: dict[str, Any] = {}

    @model_validator(mode="after")
    def _one_of_both(self) -> "PlatformChoice":
        if self.preset is not None and self.file is not None:
            raise ValueError("expected preset or file, not both")
        return self

    @property
    def preset_name(self) -> str:
        """The preset, the paper's platform by default."""
        return self.preset or PAPER_PRESET


class PlantChoice(Section):
    """`[plant]`: what simulates the platform."""

    kind: PlantKind = "model"
    fmu: str | None = None
    tolerance: Annotated[float, Field(strict=False, ge=1e-13, le=1e-2)] = 1e-8
    fixed_step_size: Time = 0.0


class Start(Section):
    """`[start]`: the state at time 0; where a key is left out, the reference's."""

    position: Position | None = None
    orientation: Orientation | None = None
    velocity: Velocity | None = None
    angular_velocity: AngularVelocity | None = None


class _Pose(Section):
    """Where a motion happens; the home pose by default."""

    position: Position | None = None
    orientation: Orientation | None = None


class HoldReference(_Pose):
    """Stay."""

    type: Literal["hold"]


class StepReference(_Pose):
    """Jump."""

    type: Literal["step"]
    position_change: Position = _REST
    orientation_change: Orientation = _REST
    at: Time = 0.0


class PointToPointReference(StepReference):
    """Go from rest to rest by a quintic polynomial."""

    type: Literal["point_to_point"]  # type: ignore[assignment]
    duration: PositiveTime


class SineReference(_Pose):
    """Swing."""

    type: Literal["sine"]
    position_amplitude: Position = _REST
    orientation_amplitude: Orientation = _REST
    frequency: Frequency
    phase: Angle = 0.0
    fade_in: Time = 0.0


class CircleReference(_Pose):
    """Circle."""

    type: Literal["circle"]
    radius: PositiveLength
    frequency: Frequency
    plane: Literal["xy", "xz", "yz"] = "xy"
    fade_in: Time = 0.0


class ChirpReference(_Pose):
    """Swing ever faster, or slower."""

    type: Literal["chirp"]
    position_amplitude: Position = _REST
    orientation_amplitude: Orientation = _REST
    from_frequency: Frequency
    to_frequency: Frequency
    duration: PositiveTime
    fade_in: Time = 0.0


class FileReference(Section):
    """Go through the rows of a CSV file."""

    type: Literal["file"]
    file: str


ReferenceChoice = Annotated[
    HoldReference
    | StepReference
    | PointToPointReference
    | SineReference
    | CircleReference
    | ChirpReference
    | FileReference,
    Field(discriminator="type"),
]


class _Controller(Section):
    feedforward: Literal["none", "gravity", "computed_torque"] = "none"
    # what the feedforward takes for the platform, where that differs from the plant
    model: dict[str, Any] = {}


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
    damping_ratio: Annotated[float, Field(strict=False, gt=0)] = 0.7
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


class LoopChoice(Section):
    """`[loop]`: clocks, and the delay of the forces in samples."""

    duration: PositiveTime
    sample_time: PositiveTime = 1e-3
    plant_step: PositiveTime | None = None
    delay: Annotated[int, Field(ge=0, le=1000)] = 0


def _by_signal(value: Any) -> dict[str, float]:
    if not isinstance(value, dict):
        raise ValueError(f"expected a table of signals ({', '.join(NAMES)})")  # noqa: TRY004 - pydantic wants this one
    found = {}
    for name, size in value.items():
        if name not in NAMES:
            raise ValueError(f"no signal '{name}'; expected {', '.join(NAMES)}")
        try:
            found[name] = number(size, _SIGNAL_UNITS[name])
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None
        if not found[name] >= 0:
            raise ValueError(f"{name} is {size!r}; expected >= 0 {_SIGNAL_UNITS[name]}")
    return found


PerSignal = Annotated[dict[str, float], BeforeValidator(_by_signal)]


class SensorChoice(Section):
    """`[sensors]`: standard deviation of noise and step of quantisation by signal."""

    noise: PerSignal = {}
    quantisation: PerSignal = {}
    seed: Annotated[int, Field(ge=0)] = 0


class ActuatorChoice(Section):
    """`[actuators]`: limits, and the time constant of a lag; the platform's force limit by default."""

    force_limit: PositiveForce | Literal["platform", "none"] = "platform"
    rate_limit: PositiveForceRate | None = None
    lag: Time = 0.0


class LimitChoice(Section):
    """`[limits]`: what refuses a reference, and what ends a run."""

    stroke: Literal["ignore", "warn", "stop"] = "warn"
    position_error: PositiveLength | None = None
    condition_number: Annotated[float, Field(strict=False, gt=1)] = 100.0


class ChangeChoice(Section):
    """`[[change]]`: other tunable parameters from a time on, as values or as factors of the present ones."""

    at: Time
    parameters: dict[str, Any] = {}
    factors: dict[str, float] = {}


class DisturbanceChoice(Section):
    """`[[disturbance]]`: an external wrench at Op over a time, in world components."""

    at: Time
    duration: PositiveTime
    force: Force = _REST
    torque: Torque = _REST


class Experiment(Section):
    """A whole experiment."""

    title: str
    description: str = ""
    platform: PlatformChoice = PlatformChoice()
    plant: PlantChoice = PlantChoice()
    start: Start = Start()
    reference: ReferenceChoice | None = None
    controller: ControllerChoice
    loop: LoopChoice
    sensors: SensorChoice = SensorChoice()
    actuators: ActuatorChoice = ActuatorChoice()
    limits: LimitChoice = LimitChoice()
    change: list[ChangeChoice] = []
    disturbance: list[DisturbanceChoice] = []
    _where: str = "experiment"
    _folder: Path = Path()

    @property
    def where(self) -> str:
        """The file or name it comes from, for messages."""
        return self._where

    @property
    def folder(self) -> Path:
        """Where the files that it names are looked for."""
        return self._folder

    def from_file(self, where: str, folder: Path) -> "Experiment":
        """The same, with its origin."""
        made = self.model_copy()
        made._where, made._folder = where, folder
        return made
