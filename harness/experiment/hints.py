"""What is possible but hardly meant: values of an experiment, and a platform that rests off its reference."""

from typing import TYPE_CHECKING, Any

import numpy as np

from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.plants.signals import VARIABLES
from gough_stewart.harness.report.quantities import LENGTH
from gough_stewart.harness.report.words import exactly
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.platform import Platform

if TYPE_CHECKING:
    from gough_stewart.harness.results.record import Record

# The largest plausible noise or quantisation: this share of a leg [m] or of a radian, within this time for rates [s].
_SHARE = 0.05
_TIME = 0.1
# The last part of a run, in which a platform at rest moves less than this share of its error.
_LAST_PART = 0.2
_AT_REST = 0.02
# A noticeable error, as a share of the mean leg length.
_NOTICEABLE = 1e-4


def hints_of(experiment: Experiment, platform: Platform) -> tuple[str, ...]:
    """One line each: legs that nearly touch, joints in a bad order, a motion after the end, coarse sensors."""
    length = float(leg_geometry(platform, platform.home_position, platform.home_orientation).length.mean())
    scales = {"m": length, "rad": 1.0, "m/s": length / _TIME, "rad/s": 1.0 / _TIME}
    coarse = [
        f"sensors.{kind}.{variable.name} is {value:g} {variable.unit}, {value / scales[variable.unit]:.3g} of the "
        f"platform's scale of {scales[variable.unit]:.3g} {variable.unit}; check its unit"
        for kind in ("noise", "quantisation")
        for variable in VARIABLES
        if (value := getattr(experiment.sensors, kind).get(variable.name) or 0.0) > _SHARE * scales[variable.unit]
    ]
    return (*platform.hints, *too_late(experiment), *coarse)


def too_late(experiment: Experiment) -> tuple[str, ...]:
    """A reference that begins after the run has ended: whatever is measured is that of rest."""
    at, duration = float(getattr(experiment.reference, "at", 0.0)), experiment.loop.duration
    if at < duration:
        return ()
    return (f"reference.at is {at:g} s in a run of {duration:g} s, so nothing moves; set it earlier, or run longer",)


def unread(experiment: Experiment, controller: Any) -> tuple[str, ...]:
    """Faults that freeze signals which the controller (None: no feedback) does not read: they change nothing."""
    read = () if controller is None else getattr(controller, "signals", None)
    if read is None:
        return ()
    return tuple(
        f"fault.{k}.freeze.{name}: nobody reads {name}, so this changes nothing; the controller reads "
        f"{' and '.join(read) or 'no sensor'}"
        for k, fault in enumerate(experiment.fault, 1)
        for name in fault.freeze
        if name not in read
    )


def static_error(record: "Record") -> list[str]:
    """What a platform that rests off its reference needs: a feedforward of gravity, or an integral; empty otherwise.

    At rest a PD acts as a spring, F = kp e, so the error is what the load, here the platform's weight, takes of it.
    """
    from gough_stewart.harness.results.record import platform_of

    choice = record.metadata["experiment"]["controller"]
    if choice.get("type") != "pd" or choice.get("feedforward", "none") != "none" or "error.position" not in record:
        return []
    first = int((1 - _LAST_PART) * record.table.height)
    error, reference = record["error.position"][first:], record["reference.position"][first:]
    if len(error) < 2 or np.ptp(reference, axis=0).any() or not np.isfinite(error).all():
        return []
    mean = error.mean(axis=0)
    distance, scale = float(np.linalg.norm(mean)), float(record["leg_length"][0].mean())
    if distance < _NOTICEABLE * scale or np.abs(error - mean).max() > _AT_REST * distance:
        return []
    gravity = platform_of(record).gravity
    # e = reference − position points against gravity where the platform hangs below
    along = -float(mean @ gravity) / (distance * float(np.linalg.norm(gravity)) or 1.0)
    size = exactly(LENGTH, distance, 3)
    how = f"hangs {size} below" if along > 0.9 else f"rests {size} off"
    return [
        f"the platform {how} its reference at the end: the load over the stiffness of its PD; "
        "set controller.feedforward = 'gravity', or use a PID, whose integral takes it away"
    ]
