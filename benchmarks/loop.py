"""Cost of a closed-loop step at 1 kHz on the FMU: `make bench`.

The heave step over 10 s, everything recorded. What the FMU itself takes is timed inside, around its doStep; all else of
a step is the harness: two readings of all results, controller, limits, record. Best of some rounds.
"""

import sys
import time
from typing import Any

from rich.console import Console
from rich.table import Table

from gough_stewart.fmu_build.cached import cached_build
from gough_stewart.harness.experiment.file import shipped_experiment
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.loop.run import simulate
from gough_stewart.harness.plants.fmu import FmuPlant

ROUNDS = 5
SETTINGS = ["loop.duration=10"]


def seconds_a_step(version: str) -> tuple[float, float]:
    """Of a whole step, and of the FMU's doStep in it."""
    prepared = prepare(shipped_experiment("heave_step", SETTINGS))
    steps = prepared.loop.timing.steps
    rounds = []
    for _ in range(ROUNDS):
        with FmuPlant(cached_build(version), prepared.platform, prepared.start) as plant:
            inside = Stopwatch(plant._unit.do_step)
            plant._unit.do_step = inside  # type: ignore[method-assign]
            start = time.perf_counter()
            simulate(plant, prepared.law, prepared.loop)
            rounds.append(((time.perf_counter() - start) / steps, inside.seconds / steps))
    return min(rounds, key=lambda both: both[0] - both[1])


class Stopwatch:
    """A function that adds up how long it takes."""

    def __init__(self, function: Any) -> None:
        self.function, self.seconds = function, 0.0

    def __call__(self, *arguments: Any) -> Any:
        """The function's own result."""
        start = time.perf_counter()
        result = self.function(*arguments)
        self.seconds += time.perf_counter() - start
        return result


def main() -> int:
    """Measure, print the table, and say which targets are missed."""
    table = Table("closed loop at 1 kHz, heave step", "measured", "target")
    missed = []
    for version in ("2.0", "3.0"):
        whole, inside = seconds_a_step(version)
        beyond = 1e6 * (whole - inside)
        table.add_row(f"a step, FMI {version}", f"{1e6 * whole:.1f} µs, {whole / inside:.1f} × doStep", "")
        table.add_row(f"… beyond doStep, FMI {version}", f"{beyond:.1f} µs", "60 µs")
        missed += [f"beyond doStep, FMI {version}"] if beyond > 60 else []
    Console().print(table)
    if missed:
        Console().print(f"missed: {', '.join(missed)}", style="bold red")
    return 0


if __name__ == "__main__":
    sys.exit(main())
