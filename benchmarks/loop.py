"""Cost of a closed-loop step at 1 kHz on the FMU: `make bench`.

The heave step over 10 s, everything recorded. doStep of the FMU is timed separately; the rest of a step is the
harness: signals, results, controller, limits, record. Best of several rounds.

The same loop in machine code on the lanes' plant, with all rows recorded, against the same called row by row
from Python.

Also many members at once with PD in leg space, delay and quantisation: the harness without the plant and with an empty
observer, against the harness of a single run, in alternating rounds.
"""

import sys
import time
from dataclasses import replace
from typing import Any

from rich.console import Console
from rich.table import Table

from gough_stewart.harness.control.laws_of_members import laws_of
from gough_stewart.harness.control.linear_controller import LinearController
from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.loop.libraries import are_compiled, loop_kernel
from gough_stewart.harness.loop.rows import Observer, RowBlock
from gough_stewart.harness.loop.run import observe, simulate
from gough_stewart.harness.plants.lanes import BatchPlant
from gough_stewart.harness.plants.open import ModelPlant, cached_build
from gough_stewart.harness.plants.unit import FmuPlant
from gough_stewart.model.interface import Variant

ROUNDS = 5
SETTINGS = ["loop.duration=10"]
MEMBERS = 512
OF_MANY = ["loop.duration=1", "loop.delay=1", "sensors.quantisation.leg_length=0.01 mm"]


def seconds_a_step(version: str) -> tuple[float, float]:
    """Times of a whole step and of the FMU's doStep in it."""
    prepared = prepare(load_experiment("heave_step", SETTINGS))
    steps = prepared.loop.timing.steps
    rounds = []
    for _ in range(ROUNDS):
        unit = FmuPlant(cached_build(version), prepared.platform, prepared.start)
        with unit as plant, prepared.law_in_a_run() as law_from:
            inside = Stopwatch(plant._unit.do_step)
            plant._unit.do_step = inside  # type: ignore[method-assign, assignment]
            start = time.perf_counter()
            simulate(plant, law_from, prepared.loop)
            rounds.append(((time.perf_counter() - start) / steps, inside.seconds / steps))
    return min(rounds, key=lambda both: both[0] - both[1])


def seconds_in_machine_code(name: str) -> tuple[float, float]:
    """CPU times of a step of a single run, all rows recorded: in machine code, and row by row on the model."""
    prepared = prepare(load_experiment(name, SETTINGS))
    kernel, steps = loop_kernel(Variant.of(prepared.machine)), prepared.loop.timing.steps
    assert are_compiled([prepared.controller])  # they are linear
    ours = []
    for _ in range(ROUNDS):
        start = time.thread_time()
        batch = BatchPlant([prepared.machine], [prepared.start], tolerance=1e-8, kernel=kernel)
        with batch as plant, prepared.law_in_a_run() as law_from:
            simulate(plant, law_from, prepared.loop)
        ours.append(time.thread_time() - start)
    start = time.thread_time()
    with ModelPlant(prepared.machine, prepared.start) as model, prepared.law_in_a_run() as law_from:
        simulate(model, law_from, prepared.loop)
    return min(ours) / steps, (time.thread_time() - start) / steps


def seconds_of_many() -> tuple[float, float, float]:
    """Times per step and member among many: harness, plant; and per step of a single run without doStep."""
    prepared = prepare(load_experiment("heave_step", OF_MANY))
    assert isinstance(prepared.controller, LinearController)
    steps, n = prepared.loop.timing.steps, MEMBERS
    loop = replace(prepared.loop, shape=(n,))
    rounds = []
    for _ in range(ROUNDS):
        plant = BatchPlant([prepared.machine] * n, [prepared.start] * n, substeps=1)
        # row by row, as with controllers in Python
        inside = [Stopwatch(getattr(plant, name)) for name in ("set_inputs", "signals", "do_step")]
        plant.set_inputs, plant.signals, plant.do_step = inside  # type: ignore[method-assign, assignment]
        law_from = laws_of([prepared.controller] * n, loop.timing.sample_time, prepared.jacobians)
        start = time.perf_counter()
        observe(plant, law_from, loop, Nothing())
        whole = time.perf_counter() - start
        in_plant = sum(each.seconds for each in inside)
        unit = FmuPlant(cached_build("3.0"), prepared.platform, prepared.start)
        with unit as single, prepared.law_in_a_run() as law_of_one:
            step = Stopwatch(single._unit.do_step)
            single._unit.do_step = step  # type: ignore[method-assign, assignment]
            start = time.perf_counter()
            simulate(single, law_of_one, prepared.loop)
            alone = time.perf_counter() - start - step.seconds
        rounds.append(((whole - in_plant) / steps / n, in_plant / steps / n, alone / steps))
    return tuple(min(each) for each in zip(*rounds, strict=True))


class Nothing(Observer):
    """An observer that does nothing."""

    def block(self, rows: RowBlock) -> None:
        """Do nothing."""


class Stopwatch:
    """A function with a sum of its computing times."""

    def __init__(self, function: Any) -> None:
        self.function, self.seconds = function, 0.0

    def __call__(self, *arguments: Any) -> Any:
        """Call the function and add its time."""
        start = time.perf_counter()
        result = self.function(*arguments)
        self.seconds += time.perf_counter() - start
        return result


def main() -> int:
    """Measure, print the table, and report missed targets."""
    table = Table("closed loop at 1 kHz, heave step", "measured", "target")
    missed = []
    for version in ("2.0", "3.0"):
        whole, inside = seconds_a_step(version)
        beyond = 1e6 * (whole - inside)
        table.add_row(f"a step, FMI {version}", f"{1e6 * whole:.1f} µs, {whole / inside:.1f} × doStep", "")
        table.add_row(f"… without doStep, FMI {version}", f"{beyond:.1f} µs", "60 µs")
        missed += [f"beyond doStep, FMI {version}"] if beyond > 60 else []
    for name in ("heave_step", "pitch_sine"):
        ours, theirs = seconds_in_machine_code(name)
        table.add_row(
            f"a step of {name} in machine code", f"{1e6 * ours:.1f} µs, 1/{theirs / ours:.0f} of row by row", "1/30"
        )
        missed += [f"{name} in machine code"] if theirs < 30 * ours else []
    harness, plant, alone = seconds_of_many()
    table.add_row(f"harness per step and member, {MEMBERS} members", f"{1e6 * harness:.3f} µs", "0.15 µs")
    table.add_row("… its plant (no target here)", f"{1e6 * plant:.3f} µs", "")
    table.add_row("… harness of a single run, relative to that", f"{alone / harness:.0f} ×", "")
    missed += ["the harness of many"] if harness > 0.15e-6 else []
    Console().print(table)
    if missed:
        Console().print(f"missed: {', '.join(missed)}", style="bold red")
    return 0


if __name__ == "__main__":
    sys.exit(main())
