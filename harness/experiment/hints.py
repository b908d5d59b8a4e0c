"""Hints at values of an experiment that are possible but hardly meant; a run prints and records them."""

from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.plants.signals import VARIABLES
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.platform import Platform

# The largest plausible noise or quantisation: this share of a leg [m] or of a radian, within this time for rates [s].
_SHARE = 0.05
_TIME = 0.1


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
