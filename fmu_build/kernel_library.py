"""The library of a plant's functions for Python: its unit's stepper, and for the ideal plant the kernel's functions.

Both are the unit's own code, loaded by `gough_stewart.model.stepping` and `kernel`. A wheel carries the library of the
ideal plant, others are compiled at first use: `python -m gough_stewart.fmu_build.kernel_library bristles springs`.
"""

import sys
from itertools import accumulate

from gough_stewart.fmu_build.cache import BuildError, state_of_sources
from gough_stewart.fmu_build.component import Sources
from gough_stewart.fmu_build.libraries import Library
from gough_stewart.fmu_build.toolchain import compiler_of, native
from gough_stewart.model.interface import IDEAL, Variant
from gough_stewart.model.kernel import sizes_of

FLAGS = (
    *("-O2", "-std=c11", "-g0", "-s", "-shared", "-fvisibility=hidden", "-ffp-contract=off", "-fno-math-errno"),
    # of the unit's code, the stepper needs a part
    *("-ffunction-sections", "-fdata-sections"),
)


def kernel_code(variant: Variant = IDEAL) -> Library:
    """The description of the library of a variant."""
    return Library("-".join(["kernel", *variant.parts]), lambda: kernel_sources(variant), state_of_sources(), FLAGS)


def kernel_sources(variant: Variant = IDEAL) -> Sources:
    """The C of the plant's component with its stepper, and of the ideal plant the kernel's functions."""
    from gough_stewart.fmu_build.codegen import function_source
    from gough_stewart.fmu_build.plant.plant_component import plant_component, platform_of
    from gough_stewart.fmu_build.sources import c_folder, defines, filled, sources
    from gough_stewart.model.traced import traced_function

    component = plant_component(platform_of(variant))
    unit = sources(component)
    called = {name: unit.units[name] for name in (*component.code.units, "model.c", "component.c")}
    stepper = Sources(called, unit.headers) | c_folder("stepper")
    if variant.parts:
        return stepper
    sizes = sizes_of(IDEAL)
    places = {f"AT_{part.upper()}": at for part, at in zip(sizes, accumulate(sizes.values(), initial=0), strict=False)}
    tangent = function_source(traced_function("tangent"), "static void kernel_")
    functions = filled("kernel/functions.c", tangent=tangent, places=defines(places))
    return stepper | c_folder("kernel") | Sources({"functions.c": functions}, {})


def main() -> None:
    """The command: prints the path of the library of a plant with these parts, compiled if it is not in the cache."""
    variant, target = Variant("bristles" in sys.argv[1:], "springs" in sys.argv[1:]), native()
    try:
        print(kernel_code(variant).kept(target, compiler=compiler_of(target)))
    except (BuildError, OSError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
