"""Cost of many platforms at once, per member and on one core: `make bench`.

`motion_base` with friction and different parameters for each member: vectorised machine code against the scalar
kernel of the FMU, compiled with the FMU's flags and called for the same number of members. Best of many alternating
rounds.
"""

import ctypes
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rich.console import Console
from rich.table import Table

from gough_stewart.fmu_build.codegen import function_source
from gough_stewart.fmu_build.toolchain import compile_library, native
from gough_stewart.harness.plants.lanes import BatchPlant, lane_rows
from gough_stewart.model import interface
from gough_stewart.model.interface import N_INPUTS, N_PARAMETERS, N_STATES, State
from gough_stewart.model.platform import load_preset
from gough_stewart.model.traced import traced_function

MEMBERS = 4096
ROUNDS = 300
# So short that the members hardly move.
STEP = 1e-15
_SCALAR = """#include <math.h>
static double sq(double x)
{{
    return x * x;
}}
{kernel}
__attribute__((visibility("default")))
void many(long long n, const double *x, const double *u, const double *p, double *y)
{{
    for (long long k = 0; k < n; k++)
        kernel_derivatives(x + {states} * k, u + {inputs} * k, p + {parameters} * k, y + {states} * k);
}}
"""


def plant_of(members: int) -> BatchPlant:
    """States of members, all different, in slow motion."""
    rng, nominal = np.random.default_rng(15), load_preset("motion_base")
    some = [replace(nominal, platform_mass=nominal.platform_mass * rng.uniform(0.8, 1.2)) for _ in range(64)]
    platforms = [some[k % len(some)] for k in range(members)]
    starts = [
        State(platform.home_position + rng.uniform(-0.1, 0.1, 3), *rng.uniform(-0.1, 0.1, (3, 3)))
        for platform in platforms
    ]
    return BatchPlant(platforms, starts, substeps=1)


def scalar_kernel(folder: Path) -> ctypes.CDLL:
    """`many`: the FMU's derivatives, one member after the other."""
    text = _SCALAR.format(
        kernel=function_source(traced_function("derivatives"), "static void kernel_"),
        states=N_STATES,
        inputs=N_INPUTS,
        parameters=N_PARAMETERS,
    )
    library = folder / f"scalar{native().suffix}"
    library.write_bytes(compile_library("scalar", {"scalar.c": text}, {}, native()))
    return ctypes.CDLL(str(library))


def microseconds_a_member(members: int, rounds: int, folder: Path) -> Mapping[str, float]:
    """Seconds per call of each row."""
    plant = plant_of(members)
    batch, library = plant.batch, plant._kernel.library
    signals, results = (lane_rows(len(names), batch.blocks) for names in (range(24), interface.RESULT_COLUMNS))
    of = batch.reference
    scalar = scalar_kernel(folder)
    p = batch.parameters.transpose(0, 2, 1).reshape(-1, N_PARAMETERS)
    rates = np.zeros((len(p), N_STATES))
    numbers = [np.ascontiguousarray(each) for each in (batch.states.T, batch.inputs.T, p, rates)]
    pointers = [ctypes.c_void_p(each.ctypes.data) for each in numbers]
    calls: dict[str, Callable[[], object]] = {
        "evaluation, scalar kernel": lambda: scalar.many(ctypes.c_longlong(members), *pointers),
        "RK4 step": lambda: library.lanes_step(of, STEP, 1, 0.0, None),
        # one internal step, whatever the motion
        "controlled step": lambda: library.lanes_step(of, STEP, 0, 1e-2, None),
        "checks of the pose": lambda: library.lanes_check(of),
        "RK4 step with signals": lambda: library.lanes_step(of, STEP, 1, 0.0, signals.ctypes.data),
        "signals alone": lambda: library.lanes_step(of, 0.0, 0, 1e-2, signals.ctypes.data),
        "results": lambda: library.lanes_results(of, results.ctypes.data),
    }
    best = dict.fromkeys(calls, np.inf)
    for _ in range(rounds):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            best[name] = min(best[name], time.perf_counter() - start)
    # make sure that both compute the same
    names = [f"{kind}acceleration[{k}]" for kind in ("", "angular_") for k in (1, 2, 3)]
    accelerations = results[[interface.RESULT_COLUMNS.index(name) for name in names]].T[:members]
    if not np.allclose(accelerations, numbers[3][:members, 6:12], rtol=1e-9, atol=1e-9):
        raise RuntimeError("the vectorised and the scalar kernel differ")
    return {name: 1e6 * seconds / members for name, seconds in best.items()}


def main() -> int:
    """Measure, print the table, and report missed targets."""
    with TemporaryDirectory() as folder:
        cost = microseconds_a_member(MEMBERS, ROUNDS, Path(folder))
    # ten per step of RK4 and its error, as in a run: the parameters are loaded from memory once
    cost = {**cost, "evaluation, in a step": cost["RK4 step"] / 10}
    scalar, vector = cost["evaluation, scalar kernel"], cost["evaluation, in a step"]
    table = Table(f"{MEMBERS} members on one core", "µs a member", "scalar evaluations")
    for name, microseconds in cost.items():
        table.add_row(name, f"{microseconds:.3f}", f"{microseconds / scalar:.2f}")
    console = Console()
    console.print(table)
    targets = Table("target", "measured", "")
    missed = 0
    for text, measured, holds in (
        ("evaluation ≤ 0.06 µs a member", f"{vector:.3f} µs", vector <= 0.06),
        ("≥ 4 × the scalar kernel", f"{scalar / vector:.1f} ×", scalar >= 4 * vector),
    ):
        targets.add_row(text, measured, "ok" if holds else "[bold red]missed[/bold red]")
        missed += not holds
    console.print(targets)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
