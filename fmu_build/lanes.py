"""The library that steps many platforms at once: kernels with eight members per vector, compiled for this processor.

It is built once and cached; c/lanes/lanes.h is its interface.
"""

import platform
import re
import subprocess
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from gough_stewart.fmu_build.cached import digest_of, kept, state_of_sources
from gough_stewart.fmu_build.compiler_cache import cache_folder
from gough_stewart.fmu_build.targets import native
from gough_stewart.fmu_build.toolchain import compile_library
from gough_stewart.model import interface

# Members per vector: the number of doubles in an AVX-512 register; other processors use several registers.
WIDTH = 8
FLAGS = (
    *("-O3", "-mcpu=native", "-std=c11", "-g0", "-s", "-shared", "-fvisibility=hidden"),
    # fused operations are the same for all members; NaN is kept, since the checks look for it
    *("-ffp-contract=fast", "-fno-math-errno", "-freciprocal-math", "-fno-signed-zeros"),
)
# Limits of error-controlled steps: internal steps of a plant step, and the smallest one as a share of it.
CONTROLLED = {"MOST_LANE_STEPS": 10_000.0, "SMALLEST_SHARE": 1e-9}
_NAME = "lanes"
# Instruction sets that the machine code may use.
_VECTOR_SETS = ("avx512f", "avx2", "fma", "asimd")


class Failure(IntEnum):
    """Why a member has failed."""

    GOES_ON = 0
    NOT_FINITE = 1
    PITCHED = 2
    SINGULAR = 3
    PASSED_SINGULAR = 4
    COLLAPSED = 5  # plus the number of the leg, from 0
    TOO_MANY_STEPS = 11


class LanesLibrary(NamedTuple):
    """A library that has been built for this processor."""

    path: Path
    # processor, its vector instructions, and a digest of the machine code: equal texts mean identical bits
    features: str


def lanes_library() -> LanesLibrary:
    """The library for this processor, from the cache if it was built from the same sources before.

    Raises
    ------
    BuildError
        The compiler (extra `fmu`) is missing or fails, or the machine is not supported.
    OSError
        The cache cannot be written.
    """
    target, processor = native(), _processor()
    key = digest_of(f"{state_of_sources()}\n{FLAGS}\n{processor}".encode())[:24]
    path = kept(cache_folder() / _NAME / f"{key}-{target.name}" / f"{_NAME}{target.suffix}", _compiled)
    words = set(processor.split())
    sets = [name for name in _VECTOR_SETS if name in words]
    return LanesLibrary(path, " ".join([target.name, *sets, digest_of(path.read_bytes())[:16]]))


def lanes_sources() -> tuple[dict[str, str], dict[str, str]]:
    """Units and headers by file name."""
    from gough_stewart.fmu_build.codegen import function_source  # imports CasADi, which a cached library does not need
    from gough_stewart.fmu_build.plant.tables import plant_header
    from gough_stewart.fmu_build.sources import c_folder
    from gough_stewart.fmu_build.tables import GENERATED
    from gough_stewart.model import kernel

    own, plant, unit = c_folder("lanes"), c_folder("plant"), c_folder("unit")
    scalar = function_source(kernel.legs_function())
    units = {
        **own.units,
        "conditioning.c": plant.units["conditioning.c"],
        "legs.c": f'{GENERATED}\n#include "lanes_table.h"\n\n#include <math.h>\n\n'
        f"static double sq(double x)\n{{\n    return x * x;\n}}\n{scalar}",
    }
    headers = {
        **own.headers,
        "conditioning.h": plant.headers["conditioning.h"],
        "internal.h": unit.headers["internal.h"],
        "plant_table.h": plant_header(0.0, is_in_a_system=False),
        "lanes_table.h": _table(scalar),
        "lanes_kernel.h": f"{GENERATED}\n" + "".join(_in_lanes(f) for f in _vector_kernels()),
    }
    return units, headers


def _compiled() -> bytes:
    return compile_library(_NAME, *lanes_sources(), native(), flags=FLAGS)


def _vector_kernels() -> tuple[Any, ...]:
    from gough_stewart.model import kernel

    return (
        kernel.derivatives_function(),
        kernel.outputs_function(),
        kernel.signals_function(),
        kernel.margins_function(),
    )


def _in_lanes(function: Any) -> str:
    """A kernel on vectors; divisors are inverted by a function of c/lanes/elementary.h."""
    from gough_stewart.fmu_build.codegen import Types, function_source

    text = function_source(function, "static __attribute__((noinline)) void kernel_", Types("lanes"))
    text = re.sub(r"=1/(\w+);", r"=reciprocal(\1);", text)
    return re.sub(r"=\((\w+)/(\w+)\);", r"=(\1*reciprocal(\2));", text)


def _table(scalar_kernel: str) -> str:
    """`lanes_table.h`: sizes of the kernels' vectors, and the kernel of single members."""
    from gough_stewart.fmu_build.tables import GENERATED, defines
    from gough_stewart.model import kernel

    sizes = {
        "N_STATES": kernel.N_STATES,
        "N_INPUTS": kernel.N_INPUTS,
        "N_PARAMETERS": kernel.N_PARAMETERS,
        "N_RESULTS": kernel.N_RESULTS,
        "N_SIGNALS": interface.size_of(kernel.SIGNALS),
    }
    declaration = scalar_kernel[: scalar_kernel.index("\n{")].strip()
    return f"""{GENERATED}
#ifndef LANES_TABLE_H
#define LANES_TABLE_H

#include "internal.h"
#include "plant_table.h"

{defines(sizes)}
{defines(CONTROLLED)}

/* why a member has failed; for a collapsed leg, its number from 0 is added */
{defines({f"FAILURE_{each.name}": int(each) for each in Failure})}

INTERNAL_BEGIN
{declaration};
INTERNAL_END

#endif
"""


@cache
def _processor() -> str:
    """Model and features of the processor, on which the machine code depends."""
    try:
        first = Path("/proc/cpuinfo").read_text(encoding="utf-8").split("\n\n")[0]
    except OSError:
        if platform.system() != "Darwin":
            return f"{platform.machine()} {platform.processor()}"
        command = ["sysctl", "-n", "machdep.cpu.brand_string"]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout
    kinds = ("vendor_id", "cpu family", "model", "flags", "Features", "CPU implementer", "CPU part", "CPU variant")
    lines = (line.partition(":") for line in first.splitlines())
    return "\n".join(f"{name.strip()}: {value.strip()}" for name, _, value in lines if name.strip() in kinds)
