"""Speed of plant and controller together in a co-simulation: `make bench`.

A C host loads both FMI 2.0 units of an exported SSP and couples them at 1 kHz. Figures are the best of many
alternating rounds; a controller step includes setting its inputs and reading its forces.
"""

import json
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import fmpy
from rich.console import Console
from rich.table import Table

import gough_stewart as gs
from gough_stewart.fmu_build.sources import standard_headers
from gough_stewart.fmu_build.toolchain import native

ROUNDS = 40
LOOPS = {
    "PD, gravity feedforward": {"controller.feedforward": "gravity"},
    "PD, computed torque": {"controller.feedforward": "computed_torque"},
}
LARGEST_RATIO = 1.6


def compiled_timer(folder: Path) -> Path:
    """`coupled_timer.c`."""
    for name, text in standard_headers("2.0").items():
        (folder / name).write_text(text)
    source, program = Path(__file__).parent / "coupled_timer.c", folder / "coupled_timer"
    command = [sys.executable, "-m", "ziglang", "cc", "-O2", "-std=c11", "-I", str(folder), str(source)]
    subprocess.run([*command, "-o", str(program), "-ldl"], check=True)
    return program


def unpacked(archive: Path, folder: Path) -> tuple[str, Any]:
    """Library and description of a unit."""
    description = fmpy.read_model_description(str(archive))
    fmpy.extract(str(archive), unzipdir=str(folder))
    target = native()
    identifier = description.coSimulation.modelIdentifier
    return str(folder / "binaries" / target.fmi2_folder / f"{identifier}{target.suffix}"), description


def measure(timer: Path, settings: Mapping[str, object], folder: Path) -> dict[str, float]:
    """Seconds per step: together, plant, controller."""
    settings = {"loop.sample_time": 1e-3, "loop.delay": 1, **settings}
    (ssp,) = gs.export("pitch_sine", settings, forms="ssp", out=folder)
    with zipfile.ZipFile(ssp) as archive:
        archive.extractall(folder)
    plant, plant_description = unpacked(folder / "resources" / "plant.fmu", folder / "plant")
    controller, description = unpacked(folder / "resources" / "controller.fmu", folder / "controller")
    of_plant = {v.name: v.valueReference for v in plant_description.modelVariables}
    inputs = {v.name: v.valueReference for v in description.modelVariables if v.causality == "input"}
    outputs = {v.name: v.valueReference for v in description.modelVariables if v.causality == "output"}
    pairs = [str(reference) for name, own in inputs.items() for reference in (of_plant[name], own)]
    force = "actuator_force[1]"
    command = [plant, plant_description.guid, controller, description.guid, str(ROUNDS), str(of_plant[force])]
    done = subprocess.run([timer, *command, str(outputs[force]), *pairs], capture_output=True, text=True, check=True)
    found: dict[str, float] = json.loads(done.stdout)
    return found


def main() -> int:
    """Measure, print the table, and report missed targets."""
    table = Table("1 kHz, motion_base, pitching", "plant, µs", "controller, µs", "together, µs", "together / plant", "")
    missed = 0
    for name, settings in LOOPS.items():
        with tempfile.TemporaryDirectory() as folder:
            found = measure(compiled_timer(Path(folder)), settings, Path(folder))
        ratio = found["together"] / found["plant"]
        holds = ratio <= LARGEST_RATIO
        missed += not holds
        times = [f"{found[key] * 1e6:.2f}" for key in ("plant", "controller", "together")]
        table.add_row(name, *times, f"{ratio:.2f}", f"≤ {LARGEST_RATIO}" if holds else "[bold red]missed[/bold red]")
    Console().print(table)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
