"""What a controller in Python is told at each sample."""

from collections.abc import Mapping
from typing import NamedTuple, cast

import numpy as np

from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

NO_FORCE = np.zeros(N_LEGS)
NO_FORCE.flags.writeable = False


class Sample(NamedTuple):
    """What a controller in Python is told at a sample: what a digital controller on the machine knows.

    Signals are by name, in SI units: position, orientation, velocity, angular_velocity, leg_length, leg_velocity.
    Arrays are its own: to change or to keep them has no effect on the run.

    Examples
    --------
    >>> def law(sample: gs.Sample):
    ...     error = sample.reference["leg_length"] - sample.measured["leg_length"]
    ...     return 8e4 * error - 9e3 * sample.measured["leg_velocity"]
    >>> record = gs.run("heave_step", {"loop.duration": 0.1}, controller=law)

    With memory, as a class:

    >>> class Integral:
    ...     def __init__(self, platform, sample_time, ki=2e5):
    ...         self.gain, self.force = ki * sample_time, 0.0
    ...     def __call__(self, sample):
    ...         self.force += self.gain * (sample.reference["leg_length"] - sample.measured["leg_length"])
    ...         return law(sample) + self.force
    >>> record = gs.run("heave_step", {"loop.duration": 0.1}, controller=Integral)
    """

    time: float
    """[s], a multiple of the sample time, also with jitter."""
    reference: Mapping[str, FloatArray]
    """The reference signals, with acceleration and angular_acceleration."""
    measured: Mapping[str, FloatArray]
    """The measurements of the sensors."""
    index: int = 0  # type: ignore[assignment]  # hides the method of a tuple
    """The number of the sample, from 0."""
    sample_time: float = 0.0
    """[s]."""
    command: FloatArray = NO_FORCE
    """The forces (6,) [N] commanded at the last sample, with feedforward and injection, before the limits: the
    `controller.force` of a record. Zeros at the first sample."""
    excess: FloatArray = NO_FORCE
    """What the limits took off that command (6,) [N]: the force that force and rate limits left, minus the command."""
    feedforward: FloatArray = NO_FORCE
    """The forces (6,) [N] that the loop adds at this sample to those that the controller returns."""
    platform: Platform = cast("Platform", None)
    """The nominal model."""
