"""Speed of the dynamics, as ratios measured in one run: `make bench`.

All rows evaluate the derivatives of one state of the paper's platform. Each figure is the best of several rounds, and
the rounds of all rows alternate, so that drifts of the machine affect all rows.
"""

import subprocess
import sys
import tempfile
import timeit
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio
from rich.console import Console
from rich.progress import track
from rich.table import Table

from gough_stewart.model import interface
from gough_stewart.model.dynamics import plant_equations
from gough_stewart.model.formulations.cases import paper_case
from gough_stewart.model.interface import IDEAL
from gough_stewart.model.kernel import Kernel, parameter_vector
from gough_stewart.model.stepping import SteppingModel
from gough_stewart.model.traced import traced_function

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.support.pinocchio_platform import PinocchioPlatform

ROUNDS = 15


def compiled_timer(folder: Path) -> Path:
    """The traced derivatives as C with a timing loop, compiled by `python -m ziglang cc -O3`."""
    traced_function("derivatives").generate("derivatives.c")
    Path("derivatives.c").replace(folder / "derivatives.c")
    program = folder / "derivatives_timer"
    source = Path(__file__).parent / "derivatives_timer.c"
    command = [sys.executable, "-m", "ziglang", "cc", "-O3", "-std=c11", f"-DN_PARAMETERS={interface.N_PARAMETERS}"]
    subprocess.run([*command, str(folder / "derivatives.c"), str(source), "-lm", "-o", str(program)], check=True)
    return program


def main() -> int:
    """Measure, print the table, and report missed targets."""
    case = paper_case()
    x, u, p = case.start.to_vector(), np.concatenate(case.inputs), parameter_vector(case.platform)
    k = Kernel()
    engine = PinocchioPlatform(case.platform, case.start, case.inputs)
    quaternion = pinocchio.SE3.Identity()
    with tempfile.TemporaryDirectory() as folder:
        timer = compiled_timer(Path(folder))
        numbers = "\n".join(repr(float(v)) for v in np.concatenate([x, u, p]))

        def compiled() -> float:
            done = subprocess.run([str(timer), "20000"], input=numbers, capture_output=True, text=True, check=True)
            values = np.array(done.stdout.split(), dtype=float)
            # make sure that the timed code computes the same as the kernel
            if not np.allclose(values[:12], k.derivatives(x, u, p), rtol=1e-11):
                raise RuntimeError("compiled derivatives differ from the kernel's")
            return float(values[12]) * 1e-9

        rows: dict[str, Callable[[], float]] = {
            "NumPy, plant_equations": timed(lambda: plant_equations(IDEAL, case.platform, x, case.inputs), 20),
            "kernel, CasADi VM through buffers": timed(lambda: k.derivatives(x, u, p), 1000),
            "kernel, compiled with zig cc -O3": compiled,
            "Pinocchio constraintDynamics, from Python": timed(engine.evaluate, 200),
            "empty Pinocchio call, from Python": timed(quaternion.inverse, 2000),
        }
        best = dict.fromkeys(rows, float("inf"))
        for _ in track(range(ROUNDS), "measuring", transient=True):
            for name, measure in rows.items():
                best[name] = min(best[name], measure())
    numpy, vm, c, pin, empty = best.values()
    table = Table("derivatives of one state", "µs", "ratio to compiled")
    for name, seconds in best.items():
        table.add_row(name, f"{seconds * 1e6:.3f}", f"{seconds / c:.1f}")
    console = Console()
    console.print(table)

    targets = Table("target", "measured", "")
    missed = 0
    for text, measured, holds in (
        ("kernel call ≤ 10 µs", f"{vm * 1e6:.2f} µs", vm <= 10e-6),
        ("kernel ≥ 20 × faster than NumPy", f"{numpy / vm:.0f} ×", numpy / vm >= 20),
        ("compiled ≤ 0.6 µs", f"{c * 1e6:.3f} µs", c <= 0.6e-6),
        ("compiled ≥ 20 × faster than Pinocchio", f"{pin / c:.0f} ×", pin / c >= 20),
        (
            "the same, without Python's call overhead for Pinocchio",
            f"{(pin - empty) / c:.0f} ×",
            (pin - empty) / c >= 20,
        ),
    ):
        targets.add_row(text, measured, "ok" if holds else "[bold red]missed[/bold red]")
        missed += not holds
    console.print(targets)
    console.print(stepping_table())
    return 1 if missed else 0


def timed(call: Callable[[], object], number: int) -> Callable[[], float]:
    """Seconds per call, one round."""
    return lambda: timeit.timeit(call, number=number) / number


def stepping_table() -> Table:
    """Real-time factor of the stepping model in the paper's case."""
    table = Table("stepping model, paper's second", "wall s", "× real time")
    for step in (1e-3, 1e-2, 1.0):
        case = paper_case()
        model = SteppingModel(case.platform)

        def run(model: SteppingModel = model, step: float = step) -> None:
            model.reset()
            model.set_many({**paper_case().start._asdict(), "actuator_force": paper_case().actuator_force})
            for i in range(round(1 / step)):
                model.do_step(i * step, step)

        seconds = min(timeit.repeat(run, number=1, repeat=3))
        table.add_row(f"communication step {step:g} s, tolerance 1e-8", f"{seconds:.3f}", f"{1 / seconds:.1f}")
    return table


if __name__ == "__main__":
    sys.exit(main())
