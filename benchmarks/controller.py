"""Cost of an exported controller: time per step beside the plant's derivatives, size on a Cortex-M7: `make bench`.

Times are the best of many alternating rounds, compiled with the flags of the FMU's libraries. Sizes are those of the
object file with -Os (code with constants) and of the structs (parameters with coefficients, memory).
"""

import re
import struct
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from gough_stewart.fmu_build.codegen import function_source
from gough_stewart.fmu_build.toolchain import FLAGS, native
from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.export import trace
from gough_stewart.harness.export.design import designed
from gough_stewart.harness.export.write import controller_sources
from gough_stewart.model import interface
from gough_stewart.model.formulations.cases import paper_case
from gough_stewart.model.kernel import parameter_vector
from gough_stewart.model.traced import traced_function

CASES: dict[str, tuple[str, dict[str, Any], float | None]] = {
    "PD, gravity": ("circle", {}, 0.4),
    "PD, computed torque": ("circle_computed_torque", {}, 1.0),
    "PID, gravity, limits": ("saturation", {}, None),
    "PD in task space, gravity": ("pitch_sine", {}, None),
}
CORTEX_M7 = ("-target", "thumb-linux-musleabihf", "-mcpu=cortex_m7")
ZIG = (sys.executable, "-m", "ziglang", "cc")
_SIZES = """#include "controller.h"
char parameters[sizeof(controller_parameters) + sizeof(controller_coefficients)];
char memory[sizeof(controller_memory)];
"""
_PLANT = "#include <math.h>\nstatic double sq(double x)\n{\n    return x * x;\n}\n"


def step_times(folder: Path, real: str) -> tuple[float, float]:
    """Times of the controller in a folder and of the derivatives [ns]."""
    (folder / "plant.c").write_text(_PLANT + function_source(traced_function("derivatives")))
    flags = [flag for flag in FLAGS if flag != "-shared"]
    files = ["controller.c", "plant.c", str(Path(__file__).parent / "controller_timer.c")]
    defines = [f"-DCONTROLLER_REAL={real}", f"-DN_PARAMETERS={interface.N_PARAMETERS}", "-I", "."]
    command = [*ZIG, "-target", native().triple, *flags, *defines, *files, "-o", "timer", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    case = paper_case()
    start = [case.start.to_vector(), np.concatenate(case.inputs), parameter_vector(case.platform)]
    first = np.loadtxt(folder / "measured.txt")
    numbers = "\n".join(repr(float(v)) for v in np.concatenate([*start, first]))
    done = subprocess.run([folder / "timer", "1000"], input=numbers, capture_output=True, text=True, check=True)
    own, plant = map(float, done.stdout.split())
    return own, plant


def sizes(folder: Path, real: str) -> tuple[int, int, int]:
    """Sizes of code with constants, parameters with coefficients, and memory [bytes], on a Cortex-M7."""
    (folder / "sizes.c").write_text(_SIZES)
    for name in ("controller", "sizes"):
        command = [
            *ZIG,
            *CORTEX_M7,
            "-std=c11",
            "-fdata-sections",
            "-Os",
            f"-DCONTROLLER_REAL={real}",
            "-c",
            f"{name}.c",
            "-o",
            f"{name}.o",
        ]
        subprocess.run(command, cwd=folder, check=True)
    code = sum(size for name, size in sections(folder / "controller.o") if re.match(r"\.(text|rodata|data)", name))
    kept = dict(sections(folder / "sizes.o"))
    return code, kept[".bss.parameters"], kept[".bss.memory"]


def sections(file: Path) -> list[tuple[str, int]]:
    """Names and sizes of the sections of a little-endian 32-bit ELF file."""
    data = file.read_bytes()
    (table,) = struct.unpack_from("<I", data, 0x20)
    size, number, names = struct.unpack_from("<HHH", data, 0x2E)
    headers = [struct.unpack_from("<IIIIIIIIII", data, table + k * size) for k in range(number)]
    text = headers[names][4]
    return [(data[text + h[0] : data.index(b"\0", text + h[0])].decode(), h[5]) for h in headers]


def main() -> int:
    """Measure, print the table, and report missed targets."""
    columns = ("controller", "real", "operations", "µs a step", "/ derivatives", "code", "parameters", "memory")
    table = Table(*columns, title="exported controllers; sizes in bytes, on a Cortex-M7")
    missed = []
    for what, (name, settings, target) in CASES.items():
        design = designed(load_experiment(name, settings))
        sources = controller_sources(design, trace.traced(design))
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            for file, text in {**sources.units, **sources.headers}.items():
                (folder / file).write_text(text)
            np.savetxt(folder / "measured.txt", design.first_measured + 1e-4)
            for real in ("double", "float"):
                own, plant = step_times(folder, real)
                row = [
                    f"{sources.operations}",
                    f"{own / 1e3:.3f}",
                    f"{own / plant:.2f}",
                    *map(str, sizes(folder, real)),
                ]
                table.add_row(what, real, *row)
                if target is not None and own / 1e3 > target:
                    missed.append(f"{what} in {real}: {own / 1e3:.3f} µs per step; target: at most {target} µs")
    console = Console(width=110)
    console.print(table)
    for line in missed:
        console.print(line)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
