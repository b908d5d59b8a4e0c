"""What is exported, as data: a designed controller with its parameters, ranges, and what it carries of a machine."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.harness.control.controllers import PD, PID, ControllerChoice, Feedforward
from gough_stewart.harness.control.drive import Drive, ForceLimits
from gough_stewart.harness.control.laws import LinearController, fresh_controller
from gough_stewart.harness.control.sensor import Sensor
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ExportError
from gough_stewart.harness.experiment.preparation import Prepared, prepare
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.choices import NOTHING, Carried, Faults, Part, ReferenceFrom
from gough_stewart.harness.export.laws import FunctionLaw, Law, MatrixLaw, PidLaw, own_law
from gough_stewart.harness.export.settings import Setting, setting, setting_of
from gough_stewart.harness.motion.limits.reach import LegMotion
from gough_stewart.harness.motion.motion import Reference
from gough_stewart.harness.plants import signals
from gough_stewart.model import interface
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.parameters import FACTOR_OF, Variable
from gough_stewart.model.platform import Platform
from gough_stewart.model.pose_limits import SHORTEST_LEG
from gough_stewart.model.vectors import FloatArray

# Samples, as in an experiment; and a force [N] beyond that of any machine.
MOST_DELAY, LARGEST_FORCE = 1000, 1e9
REFERENCE = ("position", "orientation", "velocity", "angular_velocity", "acceleration", "angular_acceleration")
# Of the width of the range of lengths, at both ends: sensors have offsets, and legs overshoot.
MARGIN = 0.1


class Range(NamedTuple):
    """Lowest and highest values of a variable's elements; each (size,)."""

    low: FloatArray
    high: FloatArray


class Ranges(NamedTuple):
    """Where measurements and references can be."""

    leg_length: tuple[float, float]  # [m], with the margin
    is_of_stroke: bool  # otherwise of the poses at which the legs exist
    position: Range  # [m]
    sample_time: float  # [s]

    def of(self, variable: Variable) -> Range:
        """The range of a signal, by the name of the interface.

        Rates are those that cross the whole range within one sample, accelerations those that reverse them.
        """
        name, T = variable.name, self.sample_time
        if name == "leg_length":
            low, high = self.leg_length
            return Range(np.full(6, low), np.full(6, high))
        if name == "position":
            return self.position
        if name == "orientation":
            # a platform cannot make a full turn, but roll and yaw may be counted on beyond half a turn
            largest = np.array([2 * np.pi, np.pi / 2, 2 * np.pi])
            return Range(-largest, largest)
        width = {
            "leg_velocity": np.full(6, self.leg_length[1] - self.leg_length[0]),
            "velocity": self.position.high - self.position.low,
            "acceleration": 2 * (self.position.high - self.position.low) / T,
            "angular_velocity": np.full(3, 2 * np.pi),
            "angular_acceleration": np.full(3, 4 * np.pi / T),
        }[name]
        return Range(-width / T, width / T)

    def joined(self, variables: Iterable[Variable]) -> Range:
        """The ranges of one signal or more, one after the other."""
        return Range(*map(np.concatenate, zip(*map(self.of, variables), strict=True)))


def ranges_of(platform: Platform, sample_time: float, legs: LegMotion | None) -> Ranges:
    """The ranges for a platform that follows a motion of its legs.

    Leg lengths are those of the stroke and of the motion, with a margin. Where the platform states no end of its
    stroke, legs are as long as they can be while the platform frame is within a mean leg length of home, in any
    orientation; at that distance a closed loop counts as lost. They are never as short as a collapsed leg, so a
    length of 0 is out of range. Positions are those whose joints such legs reach, B_i ± (L + |p_i|) for every leg.
    """
    home = leg_geometry(platform, platform.home_position, platform.home_orientation).length
    arms = np.linalg.norm(platform.platform_points, axis=1)
    collapsed = SHORTEST_LEG * platform.characteristic_length
    low, high = platform.leg_length_min, platform.leg_length_max
    away = float(home.mean())
    shortest = collapsed if low is None else float(np.min(low))
    longest = float((home + 2 * arms).max()) + away if high is None else float(np.max(high))
    if legs is not None:
        shortest, longest = min(shortest, float(legs.leg_length.min())), max(longest, float(legs.leg_length.max()))
    margin = MARGIN * (longest - shortest)
    ends = max(shortest - margin, collapsed), longest + margin
    reach = (ends[1] + arms)[:, None]
    position = Range((platform.base_points - reach).max(axis=0), (platform.base_points + reach).min(axis=0))
    return Ranges(ends, low is not None and high is not None, position, sample_time)


# Steps in a sample of the controller: a unit keeps the forces of all steps that its output waits.
MOST_STEPS = 1000


@dataclass(frozen=True, eq=False)
class Designed:
    """A controller as designed in an experiment."""

    title: str
    platform: Platform  # the nominal model
    sample_time: float  # [s]
    delay: int  # of the forces [samples]
    law: Law | None  # None without feedback
    feedforward: Feedforward
    constant_force: FloatArray  # (6,) [N], added to the feedforward
    reference: Reference | None  # None if it is an input, or if there is none
    reference_inputs: bool
    force_limit: float  # [N], infinite without one
    rate_limit: float  # [N/s], likewise
    start_force: FloatArray  # (6,) [N]
    first_measured: FloatArray  # the reference signals at time 0, in the order of `measured`
    first_reference: FloatArray  # likewise (18,)
    ranges: Ranges  # of measurements and references
    faults: Faults  # what is done about inputs that cannot be
    notes: tuple[str, ...] = ()  # paragraphs about its loop, for the header
    carried: Carried = NOTHING  # of the machine around it

    @property
    def step(self) -> float:
        """Of its clock [s]."""
        return self.sample_time / self.carried.steps_a_sample

    @property
    def measured(self) -> tuple[Variable, ...]:
        """The signals that it uses, in the interface's order."""
        used = () if self.law is None else self.law.signals
        return tuple(v for v in signals.VARIABLES if v.name in used)

    @property
    def reference_variables(self) -> tuple[Variable, ...]:
        """The reference inputs, by the interface's names; none if the reference is inside."""
        return tuple(interface.BY_NAME[name] for name in REFERENCE) if self.reference_inputs else ()

    @property
    def zeros_are_no_measurement(self) -> bool:
        """Whether inputs that are all zero mean that no values have arrived yet.

        Velocities are zero at rest; poses and leg lengths are not, unless the reference starts at zero.
        """
        ends = np.cumsum([v.size for v in self.measured])[:-1]
        parts = zip(self.measured, np.split(self.first_measured, ends), strict=False)
        places = [part for v, part in parts if not v.name.endswith("velocity")]
        if self.reference_inputs:
            places.append(self.first_reference[:6])
        return any(bool(part.any()) for part in places)

    @property
    def watched(self) -> tuple[Variable, ...]:
        """The measurements that must not stand still while their reference moves."""
        return self.faults.watched(self.measured)

    @cached_property
    def settings(self) -> tuple[Setting, ...]:
        """Its parameters, in C the fields of its struct, in this order."""
        sampled: tuple[str, ...] = ()
        if self.law is not None and self.law.fixes_sample_time:
            sampled = ("REAL(fabs)(parameters->sample_time / DEFAULT_SAMPLE_TIME - 1) <= 1e-9",)
        force_limit, rate_limit = ForceLimits.parameters()
        _, lag = Drive.parameters()
        settings = [
            setting(
                *("sample_time", "s", "> 0", "time from sample to sample", self.sample_time),
                variability="fixed",
                conditions=sampled or ("parameters->sample_time >= 1e-6",),
                largest=1e3,
            ),
            setting(
                *("delay", "", ">= 0", "samples until a force acts; the feedforward is for half a sample later"),
                self.delay,
                variability="fixed",
                conditions=("REAL(floor)(parameters->delay) >= parameters->delay",),
                largest=MOST_DELAY,
                expected=f"a whole number of samples, at most {MOST_DELAY}",
            ),
            setting_of(force_limit, self.force_limit),
            setting_of(rate_limit, self.rate_limit, "" if self.carried.drives else ", for the anti-windup"),
            setting(
                *("start_force", "N", None, "forces before the first sample, and while all inputs are zero"),
                self.start_force,
                largest=LARGEST_FORCE,
                expected=f"at most {LARGEST_FORCE:g} N",
            ),
        ]
        if self.carried.drives:
            settings.append(setting_of(lag, self.carried.lag, "; 0: none"))
        if self.carried.sensors:
            values = self.carried.quantisation
            settings += [
                setting_of(parameter, values.get(v.name, 0.0), "; 0: none")
                for v, parameter in zip(self.measured, Sensor.parameters(self.measured), strict=True)
            ]
        if self.law is not None:
            settings += self.law.settings
        if self.law is None and self.constant_force.any():
            settings.append(setting("constant_force", "N", None, "added to the feedforward", self.constant_force))
        if self.needs_platform:
            for v in self.platform_parameters:
                value = np.asarray(getattr(self.platform, v.name), dtype=float).reshape(v.shape)
                settings.append(setting(v.name, v.unit, v.lower_bound, v.description, value, variability=v.variability))
        return tuple(settings)

    @property
    def platform_parameters(self) -> tuple[Variable, ...]:
        """The physical parameters that exported code has: without fixed factors of legs that are alike."""
        return tuple(
            v
            for v in interface.PLATFORM_PARAMETERS
            if v.variability != "fixed"
            or v.name not in FACTOR_OF.values()
            or np.any(getattr(self.platform, v.name) != 1)
        )

    @property
    def needs_platform(self) -> bool:
        """Whether any computation uses the nominal model of the platform."""
        legs = self.law is not None and (
            self.law.space == "task"
            or any(name.startswith("leg_") for name in self.law.signals)
            or (isinstance(self.law, FunctionLaw) and any("_leg_" in name for name in self.law.function.name_in()))
        )
        return self.feedforward != "none" or legs or any(v.name == "leg_length" for v in self.watched)


def designed(
    experiment: Experiment,
    controller: Any = None,
    reference: ReferenceFrom = "inside",
    faults: Faults = Faults(),  # noqa: B008 - a tuple
    prepared: Prepared | None = None,
    parts: tuple[Part, ...] = (),
) -> Designed:
    """The controller of an experiment.

    Parameters
    ----------
    controller
        Replaces the experiment's: a discrete python-control system, a `LinearController`, a class or function whose
        call is arithmetic, or a CasADi function as in `FunctionLaw`. The feedforward is unchanged.
    reference
        "inside": the experiment's motion is part of the controller; "inputs": the reference is an input at each sample.
    faults
        What is done about inputs that cannot be.
    prepared
        The experiment with this controller, if already prepared.
    parts
        Of the machine, which it carries.

    Raises
    ------
    ExportError
        A controller that is unstable by itself or cannot be traced, or nothing to compute.
    ExperimentError, ReachError
        The experiment cannot run as written.
    """
    if reference not in ("inside", "inputs"):
        raise ExportError(f"reference is {reference!r}; expected 'inside' or 'inputs'")
    prepared = prepared or prepare(experiment, controller)
    choice = experiment.controller
    law = _law_of(choice if controller is None else None, prepared)
    constant = np.zeros(6) if prepared.controller is not None else choice.planned(np.zeros((1, 6)))[0]
    if law is None and choice.feedforward == "none":
        raise ExportError(
            f"controller is type = '{choice.type}' without feedforward: its forces are constant; expected a controller "
            "with feedback, or feedforward = 'gravity' or 'computed_torque' with a [reference]"
        )
    loop = prepared.loop
    actuators, reference_rows = loop.actuators, loop.reference
    if reference_rows is None:
        raise ExportError("a controller without a reference; expected the reference signals for it to follow")
    if actuators.force_limit is not None and np.ndim(actuators.force_limit) > 1:
        raise ExportError(
            f"force_limit is {np.ravel(actuators.force_limit).tolist()} N, and exported code has one for all legs; "
            "expected one number, for instance actuators.force_limit = that of the weakest leg"
        )
    used = () if law is None else tuple(name for name in signals.NAMES if name in law.signals)
    design = Designed(
        title=experiment.title,
        platform=prepared.platform,
        sample_time=loop.timing.sample_time,
        delay=actuators.delay,
        law=law,
        feedforward=choice.feedforward,
        constant_force=np.asarray(constant),
        reference=prepared.reference if reference == "inside" else None,
        reference_inputs=reference == "inputs",
        force_limit=math.inf if actuators.force_limit is None else actuators.force_limit,
        rate_limit=math.inf if actuators.rate_limit is None else actuators.rate_limit,
        start_force=loop.start_force.copy(),
        first_measured=reference_rows[0, signals.positions(used)] if used else np.zeros(0),
        first_reference=np.delete(reference_rows[0], np.s_[12:24]),
        ranges=ranges_of(prepared.platform, loop.timing.sample_time, prepared.legs),
        faults=faults,
        carried=carried(parts, prepared),
    )
    faults.check(design.measured)
    return design


def _law_of(chosen: ControllerChoice | None, prepared: Prepared) -> Law | None:
    if prepared.controller is None:
        return None
    controller = fresh_controller(prepared.controller)
    if isinstance(chosen, PD | PID):
        gains = chosen.gains(prepared.platform)
        T = prepared.loop.timing.sample_time
        return PidLaw(gains, chosen.derivative_on, chosen.discretisation, chosen.space, T, chosen.links)
    if isinstance(controller, LinearController):
        controller.check_sample_time(prepared.loop.timing.sample_time)
        return MatrixLaw(controller)
    if isinstance(controller, UnitController):
        raise ExportError(f"controller is {controller.path}, which is already an FMU; expected its source controller")
    rows = prepared.loop.reference
    assert rows is not None
    return own_law(prepared.controller, prepared.known, rows[:: prepared.loop.timing.steps_a_sample])


def carried(parts: tuple[Part, ...], prepared: Prepared) -> Carried:
    """The parts of a prepared experiment.

    Raises
    ------
    ExportError
        Too many steps in a sample.
    """
    loop = prepared.loop
    has_sensors = "sensors" in parts
    reading = loop.sensors.sample_time if has_sensors else None
    has_steps = "drives" in parts or reading is not None
    steps = loop.timing.steps_a_sample if has_steps else 1
    if steps > MOST_STEPS:
        raise ExportError(
            f"{' and '.join(parts)} run at the plant_step of {loop.timing.plant_step:g} s, {steps} times in a sample "
            f"of {loop.timing.sample_time:g} s; expected at most {MOST_STEPS} times: a longer plant_step"
        )
    return Carried(
        parts,
        float(loop.actuators.lag) if "drives" in parts else 0.0,
        dict(loop.sensors.quantisation) if has_sensors else {},
        steps,
        None if reading is None else loop.timing.steps_in(reading, "the sensors' sample_time"),
    )
