"""What may be turned while a machine runs, and its linear loop, as data for c/machine: see turning.h there."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.controllers import SixChannels
from gough_stewart.harness.control.faults import N_FAULTS
from gough_stewart.harness.control.laws import linear_of
from gough_stewart.harness.control.loop_transfer import held_plant, space_of
from gough_stewart.harness.control.pid import DAMPING_RATIO, Gains, channels_of, modal_masses
from gough_stewart.harness.experiment.preparation import Prepared
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.variants import VARIANTS, variant_of
from gough_stewart.harness.loop.loop import LENGTHS, Change, Loop
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.model.vectors import FloatArray

# `turning` of c/machine/turning.h.
FIELDS = (
    ("variant", "WHOLE"),
    ("sample_time", "NUMBER"),
    ("masses", "PLACE"),
    ("gains", "PLACE"),
    ("filter_time", "NUMBER"),
    ("tracking_time", "NUMBER"),
    ("notch", "PLACE"),
    ("wanted", "PLACE"),
    ("used", "PLACE"),
    ("n_plant", "WHOLE"),
    ("A", "PLACE"),
    ("B", "PLACE"),
    ("C", "PLACE"),
    ("to_space", "PLACE"),
    ("to_force", "PLACE"),
    ("work", "PLACE"),
    ("n_work", "WHOLE"),
    ("most_states", "WHOLE"),
    ("results", "PLACE"),
)
# Positions in `wanted`.
WANTED = (
    *("bandwidth", "damping_ratio", "integral_time", "filter_time", "proportional", "derivative", "integral"),
    *("delay", "force_limit", "noise", "quantisation"),
)
# Positions in `results`: see turning.h.
POLES = 4 + 5 * N_LEGS + 1
# Samples of delay for which there is room.
MOST_DELAY = 12
_POINTS = 900  # MOST_POINTS of margins.c
_ENCODERS = "leg_length"


class Turned(NamedTuple):
    """Values of `FIELDS`, and what the loop has of the settings that need room."""

    fields: Mapping[str, Any]
    loop: Loop

    def with_room(self, loop: Loop) -> Loop:
        """The loop with all that is turned, and the longest delay, for their tables in machine code."""
        sensors, actuators = loop.sensors, loop.actuators
        noise = {**sensors.noise, _ENCODERS: sensors.noise.get(_ENCODERS) or 1.0}
        steps = {**sensors.quantisation, _ENCODERS: sensors.quantisation.get(_ENCODERS) or 1.0}
        limit = 1.0 if actuators.force_limit is None else actuators.force_limit
        delay = max(int(actuators.delay), MOST_DELAY)
        return replace(
            loop,
            sensors=replace(sensors, noise=noise, quantisation=steps),
            actuators=replace(actuators, force_limit=limit, delay=delay),
            changes=(Change(0.0, faults=np.zeros(N_FAULTS)), *loop.changes),
        )

    def begin(self, c: Any, arrays: Mapping[int, NDArray[Any]]) -> None:
        """Set in these tables what the loop begins with."""
        sensors, actuators = self.loop.sensors, self.loop.actuators
        arrays[c.delay.at][...] = actuators.delay
        if actuators.force_limit is None:
            limits = arrays[c.limits.at]
            limits[0, 0], limits[0, 1] = -np.inf, np.inf
        if c.n_noisy and not sensors.noise.get(_ENCODERS):
            of_lengths = arrays[c.noisy][:, 0] == LENGTHS.start
            arrays[c.deviations.at][0, of_lengths] = 0.0
        if c.sensors.at and not sensors.quantisation.get(_ENCODERS):
            has_step = arrays[c.sensors.at].reshape(-1, 2)
            has_step[LENGTHS] = 1.0, 0.0


def turned_of(experiment: Experiment, prepared: Prepared) -> Turned:
    """Of an experiment's loop."""
    linear, loop, choice = linear_of(prepared.controller), prepared.loop, experiment.controller
    gains = choice.gains(prepared.platform)
    variant = variant_of(choice, gains) if isinstance(choice, SixChannels) and gains is not None else None
    T = loop.timing.sample_time
    fields: dict[str, Any] = {
        "variant": -1 if variant is None else VARIANTS.index(variant),
        "sample_time": T,
        "wanted": _wanted(choice, loop),
    }
    if variant is not None and isinstance(choice, SixChannels) and gains is not None:
        fields |= _of_gains(choice, gains, prepared)
    # the linear loop in C knows neither the sensors' own clock nor jitter
    if linear is not None and prepared.motion is not None and not loop.worst_delay:
        fields |= _linear_loop(prepared, linear)
    return Turned(fields, loop)


def _of_gains(choice: SixChannels, gains: Gains, prepared: Prepared) -> dict[str, Any]:
    used = np.concatenate([*channels_of(gains)[:3], [gains.filter_time], gains.tracking_time])
    notch = choice.notch
    return {
        "masses": modal_masses(prepared.platform, choice.space),
        "gains": used,
        "used": used,
        "filter_time": choice.derivative_filter or 0.0,
        "tracking_time": getattr(choice, "anti_windup_time", None) or 0.0,
        "notch": np.zeros(3) if notch is None else np.array([notch.frequency, notch.damping, notch.depth]),
    }


def _wanted(choice: Any, loop: Loop) -> FloatArray:
    bandwidth = getattr(choice, "bandwidth", None)
    limit = loop.actuators.force_limit
    values = {
        "bandwidth": bandwidth or 0.0,
        "damping_ratio": getattr(choice, "damping_ratio", None) or DAMPING_RATIO,
        "integral_time": getattr(choice, "integral_time", None) or 1.0,
        "filter_time": 0.0,
        **dict.fromkeys(("proportional", "derivative", "integral"), 1.0),
        "delay": loop.actuators.delay,
        "force_limit": math.inf if limit is None else limit,
        "noise": loop.sensors.noise.get(_ENCODERS, 0.0),
        "quantisation": loop.sensors.quantisation.get(_ENCODERS, 0.0),
    }
    return np.array([float(values[name]) for name in WANTED])


def _linear_loop(prepared: Prepared, linear: Any) -> dict[str, Any]:
    """The plant in the first pose of the reference, as `margins` has it, and room for its analysis."""
    loop, motion = prepared.loop, prepared.motion
    timing, actuators = loop.timing, loop.actuators
    assert motion is not None  # a controller has a reference
    pose = motion.position[0], motion.orientation[0]
    plant = held_plant(
        prepared.machine, linear, timing.sample_time, float(actuators.lag), *pose, side=loop.sensors.side
    )
    (_, readings), to_force = space_of(prepared.platform, linear, *pose)
    n, states = plant.nstates, linear.system.nstates
    most = n + N_LEGS * max(int(actuators.delay), MOST_DELAY) + states
    both = n + states
    work = both * (both + 4 * N_LEGS) + 2 * (most**2 + most + N_LEGS * _POINTS) + 2 * _POINTS
    return {
        "n_plant": n,
        "A": plant.A,
        "B": plant.B,
        "C": plant.C,
        "to_space": readings,
        "to_force": to_force,
        "work": np.zeros(work),
        "n_work": work,
        "most_states": most,
        "results": np.zeros(POLES + 4 * most),
    }
