"""Speed of the FMU in a C host: `make bench`.

The host is linked with the FMI 2.0 unit, compiled with the flags of the FMU's libraries. Figures are the best of many
alternating rounds. In a control step of 1 ms the host sets six new forces and reads position, orientation and leg
lengths.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from gough_stewart.fmu_build.plant.component import plant_component
from gough_stewart.fmu_build.sources import sources
from gough_stewart.fmu_build.targets import native
from gough_stewart.fmu_build.toolchain import FLAGS
from gough_stewart.model.formulations.cases import paper_case
from gough_stewart.model.stepping import SteppingModel

ROUNDS = 300


def compiled_timer(folder: Path) -> Path:
    """Compile `fmu_timer.c` together with all sources of the FMU."""
    unit, target = sources(plant_component(paper_case().platform), "2.0", "timer"), native()
    for name, text in {**unit.units, **unit.headers}.items():
        (folder / name).write_text(text)
    program = folder / "fmu_timer"
    flags = [flag for flag in FLAGS if flag != "-shared"]
    command = [
        sys.executable,
        "-m",
        "ziglang",
        "cc",
        "-target",
        target.triple,
        *flags,
        *target.flags_of("unit"),
        "-I",
        ".",
    ]
    command += [*unit.unit_names, str(Path(__file__).parent / "fmu_timer.c"), "-o", str(program), "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return program


def pose_of_the_model() -> list[float]:
    """The pose after the same 1 s in Python."""
    case = paper_case()
    model = SteppingModel(case.platform)
    model.set_many({**case.start._asdict(), "actuator_force": case.actuator_force})
    model.do_step(0.0, 1.0)
    return [float(v) for name in ("position", "orientation") for v in np.ravel(model.get(name))]


def main() -> int:
    """Measure, print the tables, and report missed targets."""
    with tempfile.TemporaryDirectory() as folder:
        timer = compiled_timer(Path(folder))
        done = subprocess.run([str(timer), str(ROUNDS)], capture_output=True, text=True, check=True)
    best = json.loads(done.stdout)
    # make sure that the timed code computes the platform's motion
    if not np.allclose(best["pose"], pose_of_the_model(), rtol=0, atol=1e-6):
        raise RuntimeError("the compiled unit and the model in Python end in different poses")
    derivatives = best["derivatives"]
    table = Table("FMU, FMI 2.0", "µs", "derivatives", "× real time")
    for name, seconds, simulated in (
        ("control step of 1 ms, tolerance 1e-8", best["control"], 1e-3),
        ("control step of 1 ms, fixed step of 1 ms (RK4)", best["fixed"], 1e-3),
        ("the paper's 1 s in one step, tolerance 1e-8", best["second"], 1.0),
    ):
        table.add_row(name, f"{seconds * 1e6:.2f}", f"{seconds / derivatives:.1f}", f"{simulated / seconds:.0f}")
    table.add_row("derivatives alone", f"{derivatives * 1e6:.3f}", "1", "")
    console = Console()
    console.print(table)

    targets = Table("target", "measured", "")
    missed = 0
    for text, seconds, limit in (
        ("control step ≤ 5 µs", best["control"], 5e-6),
        ("the paper's 1 s in one step ≤ 300 µs", best["second"], 300e-6),
    ):
        holds = seconds <= limit
        targets.add_row(text, f"{seconds * 1e6:.2f} µs", "ok" if holds else "[bold red]missed[/bold red]")
        missed += not holds
    console.print(targets)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
