"""The library of a plant's functions for Python: its unit's stepper, and for the ideal plant the kernel's functions.

The stepper is the unit's own code with c/stepper as its face, and the kernel's functions call the unit's equations;
`gough_stewart.model.stepping` and `kernel` load them. A wheel carries the library of the ideal plant,
others are compiled at first use and kept in the cache:

    python -m gough_stewart.fmu_build.kernel_library bristles springs

prints the path of one.
"""

import sys
from collections.abc import Mapping
from itertools import accumulate

from gough_stewart.fmu_build.cache import BuildError, state_of_sources
from gough_stewart.fmu_build.cached import platform_of
from gough_stewart.fmu_build.component import Sources
from gough_stewart.fmu_build.libraries import Library
from gough_stewart.fmu_build.toolchain import compiler_of, native
from gough_stewart.model.interface import IDEAL, N_INPUTS, N_RESULTS, N_STATES, Variant
from gough_stewart.model.kernel import FUNCTIONS, PREFIX, sizes_of

NAME = "kernel"
FLAGS = (
    *("-O2", "-std=c11", "-g0", "-s", "-shared", "-fvisibility=hidden", "-ffp-contract=off", "-fno-math-errno"),
    # of the unit's code, the stepper needs a part
    *("-ffunction-sections", "-fdata-sections"),
)
# Of c/unit, what the plant's code calls.
_SHARED_UNITS = {"model.c", "component.c"}


def kernel_code(variant: Variant = IDEAL) -> Library:
    """The description of the library of a variant."""
    return Library("-".join([NAME, *variant.parts]), lambda: kernel_sources(variant), state_of_sources(), FLAGS)


def kernel_sources(variant: Variant = IDEAL) -> Sources:
    """Units and headers by file name."""
    from gough_stewart.fmu_build.plant.component import plant_component
    from gough_stewart.fmu_build.sources import c_folder, sources

    component = plant_component(platform_of(variant))
    unit = sources(component)
    units = {name: unit.units[name] for name in (*component.code.units, *_SHARED_UNITS)}
    units |= c_folder("stepper").units
    if variant == IDEAL:
        units |= {**c_folder("kernel").units, "functions.c": _functions()}
    return Sources(units, unit.headers)


def _functions() -> str:
    """`functions.c`: the kernel's functions on a block of numbers."""
    from gough_stewart.fmu_build.codegen import function_source
    from gough_stewart.fmu_build.sources import GENERATED
    from gough_stewart.model import traced

    sizes = sizes_of(IDEAL)
    at = dict(zip(sizes, accumulate(sizes.values(), initial=0), strict=False))
    tangent = function_source(traced.tangent_function(), "static void kernel_")
    text = (
        f'{GENERATED}\n#include "kernel.h"\n#include "vectors.h"\n\n#include <math.h>\n\n'
        f"#define sq(x) ((x) * (x))\n{tangent}"
    )
    for name, (arguments, results) in FUNCTIONS.items():
        parts = ", ".join(f"block + {at[part]}" for part in (*arguments, *results))
        call = _columns(at) if name == "jacobians" else f"    kernel_{name}({parts});"
        text += f"\nOFFERED void {PREFIX}{name}(double block[])\n{{\n{call}\n}}\n"
    return text


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


def main() -> None:
    """The command: prints the path of the library of a plant with these parts, compiled if it is not in the cache."""
    variant, target = Variant("bristles" in sys.argv[1:], "springs" in sys.argv[1:]), native()
    try:
        print(kernel_code(variant).kept(target, compiler=compiler_of(target)))
    except (BuildError, OSError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
