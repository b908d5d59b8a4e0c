"""The library of the kernel's functions for Python: the traced equations as C, with the bits of CasADi's evaluation.

`gough_stewart.model.compiled_kernel` loads it.
"""

from collections.abc import Mapping

from gough_stewart.fmu_build.targets import Target
from gough_stewart.fmu_build.toolchain import compile_library
from gough_stewart.model.compiled_kernel import PREFIX
from gough_stewart.model.interface import N_INPUTS, N_RESULTS, N_STATES
from gough_stewart.model.kernel_block import FUNCTIONS, offsets

NAME = "kernel"
FLAGS = ("-O2", "-std=c11", "-g0", "-s", "-shared", "-fvisibility=hidden", "-ffp-contract=off", "-fno-math-errno")


def compiled_kernel(target: Target) -> bytes:
    """The library for a target; see `toolchain.compile_library` for errors."""
    return compile_library(NAME, *kernel_sources(), target, flags=FLAGS)


def kernel_sources() -> tuple[dict[str, str], dict[str, str]]:
    """Units and headers by file name."""
    from gough_stewart.fmu_build.codegen import function_source
    from gough_stewart.fmu_build.sources import GENERATED, c_folder
    from gough_stewart.model import traced

    own, at = c_folder("kernel"), offsets()
    units = dict(own.units)
    for name, (arguments, results) in FUNCTIONS.items():
        traced_name = {"jacobians": "tangent"}.get(name, name)
        # divisions stay divisions: equal bits
        code = function_source(getattr(traced, f"{traced_name}_function")(), "static void kernel_", reciprocals=False)
        parts = ", ".join(f"block + {at[part]}" for part in (*arguments, *results))
        call = _columns(at) if name == "jacobians" else f"    kernel_{name}({parts});"
        units[f"{name}.c"] = (
            f'{GENERATED}\n#include "processor.h"\n\n#include <math.h>\n\n#define sq(x) ((x) * (x))\n{code}\n'
            f"OFFERED void {PREFIX}{name}(double block[])\n{{\n{call}\n}}\n"
        )
    return units, dict(own.headers)


def _columns(at: Mapping[str, int]) -> str:
    """The Jacobians by their columns, at a tenth of the code of all elements at once, and as fast."""
    of_direction = ((N_STATES, "A", "C", "unit, none"), (N_INPUTS, "B", "D", "none, unit"))
    loops = "\n".join(
        f"    for (int k = 0; k < {n}; k++) {{\n        unit[k] = 1;\n"
        f"        kernel_tangent({{given}}, {direction}, block + {at[rates]} + {N_STATES} * k, "
        f"block + {at[results]} + {N_RESULTS} * k);\n        unit[k] = 0;\n    }}"
        for n, rates, results, direction in of_direction
    ).replace("{given}", ", ".join(f"block + {at[part]}" for part in ("x", "u", "p")))
    n = max(N_STATES, N_INPUTS)
    return f"    double unit[{n}] = {{0}};\n    const double none[{n}] = {{0}};\n{loops}"
