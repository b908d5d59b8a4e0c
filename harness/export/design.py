"""What is exported, as data: a designed controller with its parameters, and the ranges of what comes in."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import casadi
import numpy as np

from gough_stewart.harness.control.component import Drive, ForceLimits, Link, Sensor
from gough_stewart.harness.control.controllers import PD, PID, Feedforward
from gough_stewart.harness.control.linear_controller import LinearController, fresh_controller
from gough_stewart.harness.control.makers import name_of
from gough_stewart.harness.control.own_law import traced_function
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ExportError
from gough_stewart.harness.experiment.preparation import Prepared, prepare
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.choices import NOTHING, Carried, Faults, Part, ReferenceFrom, carried
from gough_stewart.harness.export.laws import (
    ExportedLaw,
    ExportSetting,
    FunctionLaw,
    function_law,
    matrix_law,
    pid_law,
    setting,
    setting_of,
)
from gough_stewart.harness.motion.limits.reach import LegMotion
from gough_stewart.harness.motion.motion import Reference
from gough_stewart.harness.plants import signals
from gough_stewart.model import interface
from gough_stewart.model.kinematics import SHORTEST_LEG, leg_geometry
from gough_stewart.model.parameters import FACTOR_OF, Variable
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# Samples, as in an experiment; and a force [N] beyond that of any machine.
MOST_DELAY, LARGEST_FORCE = 1000, 1e9
REFERENCE = ("position", "orientation", "velocity", "angular_velocity", "acceleration", "angular_acceleration")
# Of the width of the range of lengths, at both ends: sensors have offsets, and legs overshoot.
MARGIN = 0.1
# Signals whose references are lengths [m].
_WATCHED = ("leg_length", "position")


class Range(NamedTuple):
    """Lowest and highest values of a variable's elements; each (size,)."""

    low: FloatArray
    high: FloatArray


class Ranges(NamedTuple):
    """Where measurements and references can be."""

    leg_length: tuple[float, float]  # [m], with the margin
    position: Range  # [m]
    sample_time: float  # [s]

    def of(self, variable: Variable) -> Range:
        """The range of a signal, by the name of the interface.

        Rates are those that cross the whole range within one sample, accelerations those that reverse them. A platform
        cannot make a full turn, but roll and yaw may be counted on beyond half a turn.
        """
        T, (low, high), across = self.sample_time, self.leg_length, self.position.high - self.position.low
        turns = np.array([2 * np.pi, np.pi / 2, 2 * np.pi])
        ends = {
            "leg_length": (np.full(6, low), np.full(6, high)),
            "position": self.position,
            "orientation": (-turns, turns),
        }
        if variable.name in ends:
            return Range(*ends[variable.name])
        width = {
            "leg_velocity": np.full(6, high - low),
            "velocity": across,
            "acceleration": 2 * across / T,
            "angular_velocity": np.full(3, 2 * np.pi),
            "angular_acceleration": np.full(3, 4 * np.pi / T),
        }[variable.name]
        return Range(-width / T, width / T)


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
    shortest = collapsed if low is None else float(np.min(low))
    longest = float((home + 2 * arms).max() + home.mean()) if high is None else float(np.max(high))
    if legs is not None:
        shortest, longest = min(shortest, float(legs.leg_length.min())), max(longest, float(legs.leg_length.max()))
    margin = MARGIN * (longest - shortest)
    ends = max(shortest - margin, collapsed), longest + margin
    reach = (ends[1] + arms)[:, None]
    position = Range((platform.base_points - reach).max(axis=0), (platform.base_points + reach).min(axis=0))
    return Ranges(ends, position, sample_time)


@dataclass(frozen=True, eq=False)
class Designed:
    """A controller as designed in an experiment."""

    title: str
    platform: Platform  # the nominal model
    sample_time: float  # [s]
    delay: int  # of the forces [samples]
    law: ExportedLaw | FunctionLaw | None  # None without feedback
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
    def watched(self) -> tuple[Variable, ...]:
        """The measurements that must not stand still while their reference moves."""
        return () if self.faults.frozen is None else tuple(v for v in self.measured if v.name in _WATCHED)

    @cached_property
    def settings(self) -> tuple[ExportSetting, ...]:
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
            setting_of(rate_limit, self.rate_limit, "" if "drives" in self.carried.parts else ", for the anti-windup"),
            setting(
                *("start_force", "N", None, "forces before the first sample, and while all inputs are zero"),
                self.start_force,
                largest=LARGEST_FORCE,
                expected=f"at most {LARGEST_FORCE:g} N",
            ),
        ]
        if "drives" in self.carried.parts:
            settings.append(setting_of(lag, self.carried.lag, "; 0: none"))
        if "sensors" in self.carried.parts:
            steps = self.carried.quantisation
            for v, parameter in zip(self.measured, Sensor.parameters(self.measured), strict=True):
                settings.append(setting_of(parameter, steps.get(v.name, 0.0), "; 0: none"))
        if self.law is not None:
            settings += self.law.settings
        elif self.constant_force.any():
            settings.append(setting("constant_force", "N", None, "added to the feedforward", self.constant_force))
        # the nominal model of the platform, if any computation uses it
        law, names = self.law, () if self.law is None else self.law.signals
        if isinstance(law, FunctionLaw):
            names = (*names, *(name.removeprefix("reference_") for name in law.function.name_in()))
        of_legs = any(name.startswith("leg_") for name in (*names, *(v.name for v in self.watched)))
        needs_platform = self.feedforward != "none" or of_legs or (law is not None and law.space == "task")
        for v in self.platform_parameters if needs_platform else ():
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


def designed(
    experiment: Experiment,
    controller: Any = None,
    reference: ReferenceFrom = "inside",
    faults: Faults = Faults(),  # noqa: B008 - a tuple
    prepared: Prepared | None = None,
    parts: tuple[Part, ...] = (),
) -> Designed:
    """The controller of an experiment."""
    if reference not in ("inside", "inputs"):
        raise ExportError(f"reference is {reference!r}; expected 'inside' or 'inputs'")
    prepared = prepared or prepare(experiment, controller)
    choice, loop = experiment.controller, prepared.loop
    law: ExportedLaw | FunctionLaw | None = None
    T = loop.timing.sample_time
    if prepared.controller is not None:
        chosen, made = choice if controller is None else None, fresh_controller(prepared.controller)
        if isinstance(chosen, PD | PID):
            gains = chosen.gains(prepared.platform)
            links = tuple(value for _, value in chosen if isinstance(value, Link))
            law = pid_law(gains, chosen.derivative_on, chosen.discretisation, chosen.space, T, links)
        elif isinstance(made, LinearController):
            made.check_sample_time(T)
            law = matrix_law(made)
        elif isinstance(made, UnitController):
            raise ExportError(f"controller is {made.path}, which is already an FMU; expected its source controller")
        elif isinstance(made, casadi.Function):
            law = function_law(made, prepared.known.gains, "a CasADi function", fixes_sample_time=False)
        else:
            assert loop.reference is not None
            rows_of_samples = loop.reference[:: loop.timing.steps_a_sample]
            function = traced_function(prepared.controller, prepared.known, rows_of_samples)
            name = f"traced from {name_of(made).removeprefix('object of ')}"
            law = function_law(function, {}, name, fixes_sample_time=True)
    if law is None and choice.feedforward == "none":
        raise ExportError(
            f"controller is type = '{choice.type}' without feedforward: its forces are constant; expected a controller "
            "with feedback, or feedforward = 'gravity' or 'computed_torque' with a [reference]"
        )
    actuators, rows = loop.actuators, loop.reference
    if rows is None:
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
        sample_time=T,
        delay=actuators.delay,
        law=law,
        feedforward=choice.feedforward,
        constant_force=np.zeros(6) if prepared.controller is not None else choice.planned(np.zeros((1, 6)))[0],
        reference=prepared.reference if reference == "inside" else None,
        reference_inputs=reference == "inputs",
        force_limit=math.inf if actuators.force_limit is None else actuators.force_limit,
        rate_limit=math.inf if actuators.rate_limit is None else actuators.rate_limit,
        start_force=loop.start_force.copy(),
        first_measured=rows[0, signals.positions(used)] if used else np.zeros(0),
        first_reference=np.delete(rows[0], np.s_[12:24]),
        ranges=ranges_of(prepared.platform, T, prepared.legs),
        faults=faults,
        carried=carried(parts, prepared),
    )
    if faults.frozen is not None and not design.watched:
        raise ExportError(
            f"frozen needs measurements of {' or '.join(_WATCHED)}, whose references are lengths; the controller "
            f"measures {', '.join(v.name for v in design.measured) or 'nothing'}"
        )
    return design
