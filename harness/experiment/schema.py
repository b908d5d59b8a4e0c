"""The schema of experiments, in TOML files and in Python."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, PrivateAttr, model_validator

from gough_stewart.harness.control import by_hand  # noqa: F401 - by being there its motion is known
from gough_stewart.harness.control.component import ActuatorChoice, FaultChoice, ForceLimit, PerSignal, SensorChoice
from gough_stewart.harness.control.controllers import ControllerChoice
from gough_stewart.harness.control.frequency_response import InjectionChoice
from gough_stewart.harness.motion.limits.reach import WhenBeyond
from gough_stewart.harness.motion.limits.shares import WORST_CONDITION_NUMBER
from gough_stewart.harness.motion.paths import via_path  # noqa: F401 - likewise
from gough_stewart.harness.motion.references import ReferenceChoice
from gough_stewart.harness.plants import PlantKind
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.harness.report.requirements import required
from gough_stewart.harness.sampling.variation import EnsembleChoice
from gough_stewart.harness.section import (
    ZEROS,
    Angle,
    AngularVelocity,
    ByType,
    FileName,
    Force,
    LegForces,
    Number,
    Orientation,
    Position,
    PositiveLength,
    PositiveTime,
    TableSection,
    Time,
    Torque,
    Velocity,
)
from gough_stewart.model.interface import DEFAULT_TOLERANCE, TOLERANCES
from gough_stewart.model.parameters import TABLE
from gough_stewart.model.platform import Pairing
from gough_stewart.model.units import in_si
from gough_stewart.model.vectors import FloatArray


def _by_parameter(value: Any) -> Any:
    """Quantities with a unit as numbers in SI units; all else as it is, since the platform checks its parameters."""
    if not isinstance(value, dict):
        return value
    plain = {name for name in value if name not in TABLE or TABLE[name].words}
    return {
        name: quantity if name in plain else in_si(name, quantity, TABLE[name].unit) for name, quantity in value.items()
    }


# Parameters of a platform by name: numbers in SI units, or strings with a unit, also as elements of lists.
PlatformParameters = Annotated[dict[str, Any], BeforeValidator(_by_parameter)]


class PlatformChoice(TableSection):
    """`[platform]`: the nominal model; a preset, or a file; joints on two circles; single parameters may be changed."""

    preset: str | None = None
    file: FileName | None = None
    # joints in pairs on two circles and the home pose above them, instead of those of the preset or file
    base_radius: PositiveLength | None = None
    platform_radius: PositiveLength | None = None
    base_angle: Angle | None = None
    platform_angle: Angle | None = None
    pairing: Pairing | None = None
    home_leg_length: PositiveLength | None = None
    parameters: PlatformParameters = Field(default_factory=dict)

    @model_validator(mode="after")
    def _one_of_both(self) -> "PlatformChoice":
        if self.preset is not None and self.file is not None:
            raise ValueError("expected preset or file, not both; leave one of them out")
        return self


class PlantChoice(TableSection):
    """`[plant]`: the machine, where it differs from the nominal model, and how it is simulated."""

    kind: PlantKind = "model"
    fmu: FileName | None = None
    # the machine's platform: another file, other values of single parameters
    file: FileName | None = None
    parameters: PlatformParameters = Field(default_factory=dict)
    tolerance: Annotated[Number, Field(ge=TOLERANCES[0], le=TOLERANCES[1])] = DEFAULT_TOLERANCE
    fixed_step_size: Time = 0.0


class Start(TableSection):
    """`[start]`: the state at time 0; missing keys are those of the reference."""

    position: Position | None = None
    orientation: Orientation | None = None
    velocity: Velocity | None = None
    angular_velocity: AngularVelocity | None = None


def _samples(value: Any) -> Any:
    """A delay, which is counted: neither a part of a sample nor a time."""
    if isinstance(value, int) and not isinstance(value, bool):
        return value
    if isinstance(value, float) and math.isfinite(value):
        nearest = sorted({max(0, math.floor(value)), max(0, math.ceil(value))})
        raise ValueError(f"expected a whole number of samples; write {' or '.join(map(str, nearest))}")
    raise ValueError("expected a whole number of samples, such as 2")


Delay = Annotated[int, BeforeValidator(_samples), Field(ge=0, le=1000)]


class LoopChoice(TableSection):
    """`[loop]`: sample times, and the delay of the forces in samples."""

    duration: PositiveTime
    sample_time: PositiveTime = 1e-3
    plant_step: PositiveTime | None = None
    delay: Delay = 0
    jitter: Time = 0.0


class LimitChoice(TableSection):
    """`[limits]`: conditions that refuse a reference or end a run."""

    stroke: Literal["ignore", "warn", "stop"] = "warn"
    # for limits of velocity, acceleration, force or power; a reference out of reach is always refused
    reference: WhenBeyond = "refuse"
    position_error: PositiveLength | None = None
    condition_number: Annotated[Number, Field(gt=1)] = WORST_CONDITION_NUMBER


class ChangeChoice(TableSection):
    """`[[change]]`: from a time on other parameters of the machine, other settings of the loop, or no controller.

    `controller` is a whole table of the same type and structure as `[controller]`; the others are keys of `[loop]`,
    `[actuators]` and `[sensors]`. Settings hold from the next sample on. With `enabled` false the controller is off
    from there on, and `manual_force` acts, by default the last command; true switches it on again.
    """

    at: Time
    parameters: PlatformParameters = Field(default_factory=dict)
    factors: dict[str, Number] = Field(default_factory=dict)
    controller: Annotated[ControllerChoice, ByType()] | None = None
    delay: Delay | None = None
    force_limit: ForceLimit | None = None
    noise: PerSignal | None = None
    quantisation: PerSignal | None = None
    enabled: bool | None = None
    manual_force: LegForces | None = None

    @property
    def has_settings(self) -> bool:
        """Whether it changes settings of the loop."""
        settings = (self.controller, self.delay, self.force_limit, self.noise, self.quantisation)
        return any(setting is not None for setting in settings)

    @property
    def manual(self) -> FloatArray | None:
        """By leg 1 while the controller is off, and the manual forces [N], NaN for the last command; (12,)."""
        if self.enabled is None:
            return None
        force = np.nan if self.manual_force is None else np.asarray(self.manual_force, dtype=float)
        return np.concatenate([np.full(N_LEGS, 0.0 if self.enabled else 1.0), np.broadcast_to(force, N_LEGS)])

    @model_validator(mode="after")
    def _something(self) -> "ChangeChoice":
        if self.manual_force is not None and self.enabled is not False:
            raise ValueError("manual_force acts while the controller is off; expected enabled = false beside it")
        if not self.parameters and not self.factors and not self.has_settings and self.enabled is None:
            raise ValueError("has no effect; expected parameters, factors, or settings of the loop, such as enabled")
        if self.has_settings and not self.at:
            raise ValueError("at is 0 s, where settings are those of the tables; expected a later time")
        return self


class DisturbanceChoice(TableSection):
    """`[[disturbance]]`: an external wrench at Op for a time, in world components."""

    at: Time
    duration: PositiveTime
    force: Force = ZEROS
    torque: Torque = ZEROS


def _by_path(value: Any) -> Any:
    """`[require]`: conditions by the path of a number, also where TOML has made tables of the path's dots."""
    if not isinstance(value, dict):
        return value
    by_path = dict[str, list[str]]()

    def add(path: str, given: Any) -> None:
        if isinstance(given, dict):
            for name, inner in given.items():
                add(f"{path}.{name}" if path else str(name), inner)
            return
        conditions = given if isinstance(given, list | tuple) else [given]
        if not all(isinstance(condition, str) for condition in conditions):
            raise ValueError(f"{path} is {given!r}; expected a condition, such as '<= 1 mm', or a list of them")
        for condition in conditions:
            required(f"{path} {condition}")
        by_path[path] = list(conditions)

    add("", value)
    return by_path


# Conditions on numbers of the studies, by their paths: "<= 1 mm", or a list of them.
Requirements = Annotated[dict[str, list[str]], BeforeValidator(_by_path)]


def _writable(text: str) -> str:
    try:
        text.encode()
    except UnicodeEncodeError:
        raise ValueError("expected text in UTF-8") from None
    return text


Text = Annotated[str, AfterValidator(_writable)]


class Experiment(TableSection):
    """A validated experiment, from `load_experiment`; the tables of its file are its attributes.

    Examples
    --------
    >>> experiment = gs.load_experiment("circle", {"loop.delay": 1})
    >>> experiment.loop.sample_time, experiment.reference.frequency
    """

    title: Text
    description: Text = ""
    platform: PlatformChoice = PlatformChoice()
    plant: PlantChoice = PlantChoice()
    start: Start = Start()
    reference: Annotated[ReferenceChoice, ByType()] | None = None
    controller: Annotated[ControllerChoice, ByType()]
    loop: LoopChoice
    sensors: SensorChoice = SensorChoice()
    actuators: ActuatorChoice = ActuatorChoice()
    limits: LimitChoice = LimitChoice()
    change: list[ChangeChoice] = Field(default_factory=list)
    disturbance: list[DisturbanceChoice] = Field(default_factory=list)
    fault: list[FaultChoice] = Field(default_factory=list)
    injection: Annotated[InjectionChoice, ByType()] | None = None
    ensemble: EnsembleChoice | None = None
    require: Requirements = Field(default_factory=dict)
    _where: str = "experiment"
    _folder: Path = Path()
    # what calls have set of it: by key the value, and that of the file, None if it has none
    _changed: dict[str, dict[str, Any]] = PrivateAttr(default_factory=dict)

    @property
    def code(self) -> tuple[str, ...]:
        """Files named by the experiment that a run executes, with the user's rights."""
        return self.controller.code + (() if self.plant.fmu is None else (self.plant.fmu,))

    @property
    def requirements(self) -> tuple[str, ...]:
        """The requirements of `[require]`, as strings: "force.peak <= 800 N"."""
        return tuple(f"{path} {condition}" for path, conditions in self.require.items() for condition in conditions)

    @property
    def where(self) -> str:
        """The file or name of the experiment, for messages."""
        return self._where

    @property
    def folder(self) -> Path:
        """The folder relative to which file names are resolved."""
        return self._folder

    @property
    def changed(self) -> dict[str, dict[str, Any]]:
        """Keys changed by `--set` or `settings`, each with its `value` and the value in the `file`."""
        return dict(self._changed)

    def from_file(self, where: str, folder: Path, changed: Mapping[str, dict[str, Any]] | None = None) -> "Experiment":
        """A copy that knows its file, and optionally which keys were changed."""
        experiment = self.model_copy()
        experiment._where, experiment._folder = where, folder
        experiment._changed = dict(self._changed if changed is None else changed)
        return experiment
