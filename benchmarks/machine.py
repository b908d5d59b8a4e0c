"""Speed of platforms that stick and give, against ideal ones: `make bench`.

Units of `motion_base` with friction of 100 N at fixed steps of 1 ms: rigid legs with stiction, and legs of 1e8 N/m with
motors of 20 kg that stick. A C host drives each in a control loop, from rest to rated speed, through a reversal. The
units take turns, in one process; figures are the best of many rounds. And members of an ensemble that stick and give.
"""

import ctypes
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from gough_stewart.fmu_build.plant.plant_component import plant_component
from gough_stewart.fmu_build.sources import sources
from gough_stewart.fmu_build.toolchain import compile_library, native
from gough_stewart.harness.ensemble.chunk import SIZE, limits_of_members
from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.experiment.members import varying_members
from gough_stewart.harness.experiment.preparation import Batch
from gough_stewart.harness.loop.rows import FoldsOfRows
from gough_stewart.harness.loop.run import observe
from gough_stewart.harness.plants.lanes import Stepping
from gough_stewart.harness.results.metric_folds import metric_folds, metric_kernels
from gough_stewart.model.platform import Platform, load_preset
from gough_stewart.model.vectors import FloatArray

STICKING: dict[str, Any] = {"leg_friction_model": "elasto_plastic", "leg_static_friction": 150.0}
GIVING: dict[str, Any] = {"leg_stiffness": 1e8, "leg_armature": 20.0}
# The first is the ideal one; the largest ratios of the others to it, and the smallest of members.
KINDS: dict[str, dict[str, Any]] = {"ideal": {}, "sticks": STICKING, "sticks and gives": {**STICKING, **GIVING}}
LARGEST = {"ideal": 1.0, "sticks": 2.5, "sticks and gives": 4.0}
# A motion of 2 s with peaks at the legs' rated speed [m/s].
ROUNDS, STEPS, FREQUENCY, RATED_SPEED = 40, 2000, 0.5, 0.8
# PD control in leg space at about 2 Hz, of a sixth of the platform with armature.
BANDWIDTH = 2 * np.pi * 2.0
# Motors of members are those of the preset, 515 kg; light ones, whose modes take smaller steps, for comparison.
MEMBERS = {
    **KINDS,
    "sticks and gives": {**STICKING, "leg_stiffness": 1e8},
    "the same, motors of 20 kg": KINDS["sticks and gives"],
}
SMALLEST = {"sticks and gives": 0.25}
# Loose enough to be cheap, and errors of all poses are below 1e-6 m.
TOLERANCE, LARGEST_ERROR = 1e-5, 1e-6
# Without rounding, which would make of small differences others of its size.
LOOP = ("loop.duration=0.5", "reference.at=0.1", "sensors.quantisation.leg_length=0")
VARIED = "ensemble.platform_mass={factor={uniform=[0.8,1.3]}}"


class Unit:
    """A unit with its host as a library."""

    def __init__(self, platform: Platform, folder: Path, name: str) -> None:
        plant = plant_component(platform)
        unit = sources(plant, "2.0", ("timer", "timer"))
        units = {
            **unit.units,
            "machine_timer.c": (Path(__file__).parent / "machine_timer.c").read_text(),
        }
        library = folder / f"{name}{native().suffix}"
        library.write_bytes(compile_library(name, units, unit.headers, native()))
        self._call = ctypes.CDLL(str(library)).time_steps
        self._call.restype = ctypes.c_double
        mass = platform.platform_mass / 6 + platform.leg_armature
        stiffness, damping = mass * BANDWIDTH**2, 1.4 * mass * BANDWIDTH
        self._gains = [ctypes.c_double(each) for each in (RATED_SPEED, stiffness, damping)]

    def run(self, fixed_step_size: float, tolerance: float = 1e-8) -> tuple[float, FloatArray]:
        """Seconds per step, and the pose at the end."""
        pose = (ctypes.c_double * 6)()
        numbers = ctypes.c_double(fixed_step_size), ctypes.c_double(tolerance), ctypes.c_int(STEPS)
        each = self._call(*numbers, ctypes.c_double(FREQUENCY), *self._gains, pose)
        if not np.isfinite(each):
            raise RuntimeError("a call of the unit failed")
        return each, np.array(pose)


def microseconds_a_step(rounds: int, folder: Path) -> tuple[dict[str, float], dict[str, float]]:
    """Of each kind, at fixed steps of 1 ms; and the distance of its end from that under error control at 1e-10."""
    platform = load_preset("motion_base")
    units = {name: Unit(replace(platform, **kind), folder, f"unit{k}") for k, (name, kind) in enumerate(KINDS.items())}
    best = dict.fromkeys(units, np.inf)
    for _ in range(rounds):
        for name, unit in units.items():
            best[name] = min(best[name], 1e6 * unit.run(1e-3)[0])
    errors = {name: float(np.abs(unit.run(1e-3)[1] - unit.run(0.0, 1e-10)[1]).max()) for name, unit in units.items()}
    return best, errors


def batch_of(kind: dict[str, Any], members: int) -> Batch:
    """Members of `heave_step` on this kind of machine."""
    words = [f"plant.parameters.{key}={value}" for key, value in kind.items()]
    drawn = varying_members(load_experiment("heave_step", [*words, *LOOP, VARIED, f"ensemble.members={members}"]))
    return drawn.preparation.members(drawn.draws(0, members).values, range(members))


def run(batch: Batch, tolerance: float) -> tuple[float, FloatArray]:
    """Seconds of the loop with its metrics, and the poses at its end."""
    running = batch.in_parallel(Stepping(tolerance=tolerance))
    limits = limits_of_members(batch, running.size)
    folds = metric_folds(running.loop.timing.times, running.loop.reference, limits)
    rows = FoldsOfRows(running.loop, folds, running.size, metric_kernels())
    start = time.perf_counter()
    with running.plant as plant:
        observe(plant, running.law_from, running.loop, rows)
        seconds = time.perf_counter() - start
        return seconds, plant.signals()[..., :6]


def simulated_seconds(rounds: int) -> tuple[dict[str, float], dict[str, float]]:
    """Simulated seconds per second of a chunk of members on one core; and the distance from a tolerance of 1e-10."""
    batches = {name: batch_of(kind, SIZE) for name, kind in MEMBERS.items()}
    best = dict.fromkeys(batches, np.inf)
    for _ in range(rounds):
        for name, batch in batches.items():
            best[name] = min(best[name], run(batch, TOLERANCE)[0])
    errors = {}
    for name, kind in MEMBERS.items():
        few = batch_of(kind, 32)
        errors[name] = float(np.abs(run(few, TOLERANCE)[1] - run(few, 1e-10)[1]).max())
    return {name: SIZE * batches[name].timing.duration / seconds for name, seconds in best.items()}, errors


def main() -> int:
    """Measure, print the tables, and report missed targets."""
    with tempfile.TemporaryDirectory() as folder:
        cost, errors = microseconds_a_step(ROUNDS, Path(folder))
    speed, distances = simulated_seconds(3)
    table = Table("fixed steps of 1 ms", "µs", "× ideal", "target", "off 1e-10 by, m or rad", "")
    missed = 0
    for name, each in cost.items():
        ratio, largest = each / cost["ideal"], LARGEST[name]
        holds = ratio <= largest
        missed += not holds
        words = f"{each:.2f}", f"{ratio:.2f}", f"<= {largest:g}", f"{errors[name]:.1e}"
        table.add_row(name, *words, "ok" if holds else "missed")
    members = Table(
        f"members, tolerance {TOLERANCE:g}", "simulated s per s", "× ideal", "target", "off by, m or rad", ""
    )
    for name, each in speed.items():
        share, smallest = each / speed["ideal"], SMALLEST.get(name, 0.0)
        holds = share >= smallest and (not smallest or distances[name] <= LARGEST_ERROR)
        missed += not holds
        words = f"{each:.0f}", f"{share:.2f}", f">= {smallest}" if smallest else "", f"{distances[name]:.1e}"
        members.add_row(name, *words, "ok" if holds else "missed")
    Console().print(table)
    Console().print(members)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
