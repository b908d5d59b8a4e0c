"""The machine code of the loop for this machine, if it is there and agrees with NumPy's loop."""

import warnings
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np

from gough_stewart.fmu_build.cache_files import cache_folder, digest_of
from gough_stewart.fmu_build.errors import BuildError
from gough_stewart.fmu_build.lanes import LanesLibrary
from gough_stewart.harness.control.laws import LinearController
from gough_stewart.harness.control.laws_of_members import laws_of
from gough_stewart.harness.control.state_space import StateSpace
from gough_stewart.harness.loop.actuators import Actuators
from gough_stewart.harness.loop.loop import Loop
from gough_stewart.harness.loop.loop_library import loop_library
from gough_stewart.harness.loop.run import simulate
from gough_stewart.harness.loop.sensors import Sensors
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.lanes import CompiledLanes, lanes_plant
from gough_stewart.model.parameters import Part
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.process.files import write_whole
from gough_stewart.model.state import State
from gough_stewart.model.variant import ELASTO_PLASTIC, Variant
from gough_stewart.model.vectors import FloatArray

# Share of the largest force by which the two may differ after the test's rows; they differ by rounding.
_AGREES = 1e-9
# What gives the test's platform each part.
_PARTS: Mapping[Part, Mapping[str, float]] = {
    "bristles": {"leg_friction_model": ELASTO_PLASTIC, "leg_coulomb_friction": 2.0, "leg_static_friction": 3.0},
    "springs": {"leg_stiffness": 1e6, "leg_armature": 1.0},
}


@cache
def loop_kernel(variant: Variant) -> CompiledLanes | None:
    """What runs loops of plants of a variant in machine code; None where NumPy's loop has to.

    There is a warning if it does not work. At its first use on a machine it is held against NumPy's loop, and a note of
    that is kept in the cache.
    """
    try:
        library = loop_library(variant)
        kernel = CompiledLanes(library)
        if not _is_noted(library):
            gap = _gap(kernel, variant)
            if not gap <= _AGREES:
                warnings.warn(
                    f"{library.path} computes forces that differ by {gap:.2g} of the largest one from NumPy's; loops "
                    "run in NumPy instead, more slowly",
                    stacklevel=2,
                )
                return None
            with suppress(OSError):  # then it is held against NumPy's again next time
                _note(library).parent.mkdir(parents=True, exist_ok=True)
                write_whole(_note(library), library.features.encode())
    except (BuildError, OSError):
        return None
    return kernel


def _note(library: LanesLibrary) -> Path:
    return cache_folder() / "agrees" / f"{digest_of(library.features.encode())[:24]}.txt"


def _is_noted(library: LanesLibrary) -> bool:
    return _note(library).is_file() and _note(library).read_text() == library.features


def _gap(kernel: CompiledLanes, variant: Variant) -> float:
    """The largest difference between the forces of both loops, as a share of the largest force."""
    parts = {part: _PARTS[part] for part in variant.parts}
    platform = load_preset("liu2000").with_parameters({name: v for part in parts.values() for name, v in part.items()})
    ours, theirs = (_forces(platform, each) for each in (kernel, None))
    return float(np.max(np.abs(ours - theirs)) / np.max(np.abs(theirs)))


def _forces(platform: Platform, kernel: CompiledLanes | None) -> FloatArray:
    """The forces of a loop with all components, on two members, by row."""
    timing = Timing(duration=6e-3, sample_time=2e-3, plant_step=1e-3)
    steps = timing.steps + 1
    home = State(platform.home_position, platform.home_orientation, np.zeros(3), np.zeros(3))
    controller = LinearController(
        StateSpace(0.9 * np.eye(6), 0.1 * np.eye(6), 300.0 * np.eye(6), 2000.0 * np.eye(6), timing.sample_time)
    )
    with lanes_plant([platform] * 2, [home] * 2, compiler=False, kernel=kernel) as plant:
        reference = np.zeros((steps, 30))
        reference[:, : signals.SIZE] = plant.signals()[0] + 0.01 * np.arange(steps)[:, None]
        loop = Loop(
            timing,
            reference,
            np.zeros((len(timing.samples), 6)),
            np.asarray(platform.home_actuator_force),
            Sensors(noise={"leg_length": 1e-4}, quantisation={"leg_length": 1e-5}, seed=7),
            Actuators(force_limit=80.0, rate_limit=4e4, lag=1e-3, delay=1),
        )
        law = laws_of([controller] * 2, timing.sample_time, np.zeros((len(timing.samples), 6, 6)))
        return simulate(plant, law, loop).inputs
