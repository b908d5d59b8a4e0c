"""Speed of the FMU in a C host, and of the stepping model beside FMPy's steps of the FMU: `make bench`.

The host is linked with the FMI 2.0 unit, compiled with the flags of the FMU's libraries. Figures are the best of many
alternating rounds. In a control step of 1 ms the host sets six new forces and reads position, orientation and leg
lengths; the loops in Python set six forces and read the position.
"""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import fmpy
import numpy as np
from fmpy.fmi3 import FMU3Slave
from rich.console import Console
from rich.table import Table

from gough_stewart.fmu_build.plant.plant_component import plant_component
from gough_stewart.fmu_build.sources import sources
from gough_stewart.fmu_build.toolchain import FLAGS, native
from gough_stewart.harness.plants.open import cached_build
from gough_stewart.model import interface
from gough_stewart.model.formulations.cases import paper_case
from gough_stewart.model.interface import Variant
from gough_stewart.model.platform import Platform, load_preset
from gough_stewart.model.stepping import SteppingModel

ROUNDS = 300
# Of the loops in Python: steps of 1 ms, and alternating pairs.
STEPS, PAIRS = 1000, 9
STICKING = {"leg_friction_model": "elasto_plastic", "leg_coulomb_friction": 100.0}
ELASTIC = {"leg_stiffness": 2e7}
# Parameters of `motion_base`, and the largest time of a step of the stepping model over one through FMPy.
LOOPS: dict[str, tuple[dict[str, Any], float]] = {
    "ideal": ({}, 0.6),
    "sticking": (STICKING, 0.9),
    "elastic": (ELASTIC, 0.9),
    "both": (STICKING | ELASTIC, 0.9),
}


def compiled_timer(folder: Path) -> Path:
    """Compile `fmu_timer.c` together with all sources of the FMU."""
    plant, target = plant_component(paper_case().platform), native()
    unit = sources(plant, "2.0", ("timer", "timer"))
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
        *(["-fPIC"] if target.suffix == ".so" else []),
        "-I",
        ".",
    ]
    command += [*unit.units, str(Path(__file__).parent / "fmu_timer.c"), "-o", str(program), "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return program


def pose_of_the_model() -> list[float]:
    """The pose after the same 1 s in Python."""
    case = paper_case()
    model = SteppingModel(case.platform, integrator="scipy")
    model.set_many({**case.start._asdict(), "actuator_force": case.actuator_force})
    model.do_step(0.0, 1.0)
    return [float(v) for name in ("position", "orientation") for v in np.ravel(model.get(name))]


def forces_of(platform: Platform) -> list[list[float]]:
    """Actuator forces (STEPS, 6) that move every leg at its own frequency, up to 120 N."""
    waves = np.sin(0.02 * np.arange(STEPS)[:, None] * np.arange(1, 7) + np.arange(6))
    return (platform.home_actuator_force + np.linspace(20, 120, STEPS)[:, None] * waves).tolist()  # type: ignore[no-any-return]


def seconds_of_the_model(platform: Platform, forces: list[list[float]]) -> tuple[float, list[float]]:
    """Time of a step of the stepping model, and the position at the end."""
    model = SteppingModel(platform)
    begin = time.process_time()
    for k, force in enumerate(forces):
        model.set("actuator_force", force)
        model.do_step(k * 1e-3, 1e-3)
        position = model.get("position")
    return (time.process_time() - begin) / STEPS, np.ravel(position).tolist()


def stepped_by_fmpy(platform: Platform, folder: Path) -> Callable[[list[list[float]]], tuple[float, list[float]]]:
    """The same by FMPy's instance of the FMI 3.0 unit, which is unpacked in a folder."""
    variant = Variant.of(platform)
    path = str(cached_build("3.0", None, variant))
    description = fmpy.read_model_description(path)
    fmpy.extract(path, str(folder))
    references = {v.name: v.valueReference for v in description.modelVariables}
    starts = {v.name: getattr(platform, v.name) for v in variant.parameters}
    starts |= interface.start_values((*interface.INPUTS, *variant.states), platform)
    forces_at, position_at = [references["actuator_force"]], [references["position"]]

    def seconds(forces: list[list[float]]) -> tuple[float, list[float]]:
        unit = FMU3Slave(
            guid=description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="plant",
        )
        unit.instantiate()
        for name, value in starts.items():
            unit.setFloat64([references[name]], np.ravel(value).astype(float).tolist())
        unit.enterInitializationMode(tolerance=1e-8, startTime=0.0)
        unit.exitInitializationMode()
        begin = time.process_time()
        for k, force in enumerate(forces):
            unit.setFloat64(forces_at, force)
            unit.doStep(k * 1e-3, 1e-3)
            position = unit.getFloat64(position_at, 3)
        taken = (time.process_time() - begin) / STEPS
        unit.terminate()
        unit.freeInstance()
        return taken, list(position)

    return seconds


def loops_in_python(console: Console) -> list[tuple[str, float, float]]:
    """Print the times of both loops for each kind of platform; the ratios with their targets."""
    table = Table("a step of 1 ms in a Python loop", "stepping model, µs", "FMPy, µs", "ratio")
    found = []
    for name, (parameters, limit) in LOOPS.items():
        platform = load_preset("motion_base").with_parameters(parameters)
        forces = forces_of(platform)
        with tempfile.TemporaryDirectory() as folder:
            by_fmpy = stepped_by_fmpy(platform, Path(folder))
            pairs = [(seconds_of_the_model(platform, forces), by_fmpy(forces)) for _ in range(PAIRS)]
        if any(ours[1] != theirs[1] for ours, theirs in pairs):
            raise RuntimeError(f"{name}: the stepping model and the unit end in different positions")
        ratio = median(ours[0] / theirs[0] for ours, theirs in pairs)
        ours, theirs = (median(pair[k][0] for pair in pairs) * 1e6 for k in (0, 1))
        table.add_row(name, f"{ours:.2f}", f"{theirs:.2f}", f"{ratio:.2f}")
        found.append((f"stepping model over FMPy, {name} ≤ {limit}", ratio, limit))
    console.print(table)
    return found


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
    for text, ratio, limit in loops_in_python(console):
        holds = ratio <= limit
        targets.add_row(text, f"{ratio:.2f}", "ok" if holds else "[bold red]missed[/bold red]")
        missed += not holds
    console.print(targets)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
