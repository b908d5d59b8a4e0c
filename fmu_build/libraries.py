"""Libraries of machine code: what each is compiled from, and how it is made once and found again.

c/lanes steps many platforms at once, eight members per vector; c/loop runs their sampled loops, c/law a user's control
law among them, c/folds folds their rows; c/machine is c/loop for one member, as plain C99 with equal bits on any
target, also WebAssembly. The kernel is for `gough_stewart.model`: a plant's stepper as in its unit, and of the ideal
plant the functions of `model.kernel`. A wheel carries that of the ideal plant, others are compiled at first use:
`python -m gough_stewart.fmu_build.libraries bristles springs`. The library of a unit is in `build`.
"""

import ctypes
import platform
import re
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from hashlib import sha256
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

from gough_stewart.fmu_build.cache import (
    BuildError,
    cache_folder,
    digest_of_texts,
    kept,
    state_of_sources,
)
from gough_stewart.fmu_build.component import Sources
from gough_stewart.fmu_build.sources import GENERATED, c_folder, defines, filled, sources
from gough_stewart.fmu_build.toolchain import WEB_ASSEMBLY, Library, Target, compiler_of, native
from gough_stewart.model import interface
from gough_stewart.model.interface import IDEAL, Variant
from gough_stewart.model.kernel import kernel_library, new_block
from gough_stewart.model.process.files import write_whole
from gough_stewart.model.process.installed import prebuilt, state_of_texts

# Members per vector: the number of doubles in an AVX-512 register; other processors use several registers.
WIDTH = 8
_NATIVE = "-mcpu=native"
VECTOR_FLAGS = (
    *("-O3", _NATIVE, "-std=c11", "-g0", "-s", "-shared", "-fvisibility=hidden"),
    # fused operations are the same for all members; NaN is kept, since the checks look for it
    *("-ffp-contract=fast-honor-pragmas", "-fno-math-errno", "-fno-signed-zeros"),
)
# Of all compilers: no fused operations, which some processors lack.
_MACHINE_FLAGS = (
    *("-O2", "-std=c99", "-g0", "-DWIDTH=1", "-fvisibility=hidden", "-ffp-contract=off", "-fno-math-errno"),
)
_KERNEL_FLAGS = (
    *("-O2", "-std=c11", "-g0", "-s", "-shared", "-fvisibility=hidden", "-ffp-contract=off", "-fno-math-errno"),
    # of the unit's code, the stepper needs a part
    *("-ffunction-sections", "-fdata-sections"),
)
# Limits of error-controlled steps: internal steps of a plant step, and the smallest one as a share of it.
CONTROLLED = {"MOST_LANE_STEPS": 10_000.0, "SMALLEST_SHARE": 1e-9}
# Instruction sets that the machine code may use.
_VECTOR_SETS = ("avx512f", "avx2", "fma", "asimd")
# Lines of /proc/cpuinfo on which machine code depends.
_PROCESSOR = ("vendor_id", "cpu family", "model", "flags", "Features", "CPU implementer", "CPU part", "CPU variant")
# Functions of the C library with two arguments.
_OF_TWO = ("atan2", "copysign", "fmax", "fmin", "fmod", "hypot", "pow", "remainder")


# ---- machine code for a processor -----------------------------------------------------------------------------------


class LanesLibrary(NamedTuple):
    """A library in vectors of members that was built for this processor."""

    path: Path
    # processor, its vector instructions, and a digest of the machine code: equal texts mean identical bits
    features: str


def vector_library(
    name: str,
    sources: Callable[[], Sources],
    state: str = "",
    variant: Variant = IDEAL,
    files: Iterable[tuple[str, ...]] = (),
) -> Library:
    """A library in vectors of members; `state` is a digest of sources outside of this package.

    By default it is that of source `files`: the name of each package is followed by those of its files.
    """
    texts = [resources.files(package).joinpath(name).read_bytes() for package, *names in files for name in names]
    if texts:
        state = sha256(b"".join(texts)).hexdigest()
    whole_state = sha256(f"{state_of_texts()}\n{state}".encode()).hexdigest()
    return Library("-".join([name, *variant.parts]), sources, whole_state, VECTOR_FLAGS)


def machine_code(library: Library) -> LanesLibrary:
    """A library in vectors for this processor, which came with the package, or is in the cache, or is compiled."""
    target, kernel = native(), kernel_library()
    # of x86-64, 1 to 4; 0 on others, and if it is not known
    highest = 0 if kernel is None else int(kernel.processor_level())
    # without a level: also of a wheel that was made for the processor at hand
    for level in ("", *(f"-v{level}" for level in (4, 3) if level <= highest)):
        carried = prebuilt(f"{target.name}/{library.name}{level}", library.state)
        if carried is None:
            continue
        content, digest = carried.content, sha256(carried.content).hexdigest()
        try:
            place = cache_folder() / "unpacked" / digest[:24] / f"{library.name}{target.suffix}"
            path = kept(place, lambda content=content: content)  # type: ignore[misc]
        except OSError:
            path = Path(_own_folder().name, f"{library.name}-{digest[:24]}{target.suffix}")
            write_whole(path, content)
        if _loads(path):
            words = [target.name, *([f"x86-64{level}"] if level else []), digest[:16]]
            return LanesLibrary(path, " ".join(words))

    # machine code depends on model and features of the processor
    cpuinfo = Path("/proc/cpuinfo")
    if platform.system() == "Darwin":
        command = ["sysctl", "-n", "machdep.cpu.brand_string"]
        processor = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    elif cpuinfo.exists():
        lines = (line.partition(":") for line in cpuinfo.read_text(encoding="utf-8").split("\n\n")[0].splitlines())
        stated = ((name.strip(), value.strip()) for name, _, value in lines)
        processor = "\n".join(f"{name}: {value}" for name, value in stated if name in _PROCESSOR)
    else:
        processor = f"{platform.machine()} {platform.processor()}"
    path = library.kept(target, processor=f"{state_of_sources()}\n{processor}")
    words = [name for name in _VECTOR_SETS if name in set(processor.split())]
    return LanesLibrary(path, " ".join([target.name, *words, sha256(path.read_bytes()).hexdigest()[:16]]))


def flags_by_level(target: Target) -> dict[str, tuple[str, ...]]:
    """The compiler's flags for the levels of processors of a target for which a wheel has machine code.

    By the ending of the library's name: of x86-64 [x86-64 psABI, 3.1.1] "-v3", with AVX2, as nearly all since 2013, and
    "-v4", with AVX-512; "" for all processors of a target. Those that compute ensembles with AVX-512 run Linux; Apple's
    systems enable it late in a process, if at all.
    """
    general = tuple(flag for flag in VECTOR_FLAGS if flag != _NATIVE)
    if not target.name.startswith("x86_64"):
        return {"": general}
    levels = (3, 4) if target.suffix == ".so" else (3,)
    return {f"-v{level}": (f"-mcpu=x86_64_v{level}", *general) for level in levels}


@cache
def _own_folder() -> tempfile.TemporaryDirectory[str]:
    """A temporary folder of this process, removed when it ends, where the cache cannot be written."""
    return tempfile.TemporaryDirectory(prefix="gough-stewart-", ignore_cleanup_errors=True)


@cache
def _loads(path: Path) -> bool:
    """Whether a library loads on this machine; if not, a warning says why."""
    try:
        ctypes.CDLL(str(path))
    except OSError as error:
        warnings.warn(f"{path} does not load here, and is compiled instead: {error}", stacklevel=3)
        return False
    return True


# ---- many platforms, and their loop ---------------------------------------------------------------------------------


def lanes_code(variant: Variant = IDEAL) -> Library:
    """The description of the library of c/lanes."""
    return vector_library("lanes", lambda: lanes_sources(variant), variant=variant)


def lanes_sources(variant: Variant = IDEAL, *, alone: bool = False) -> Sources:
    """The C of c/lanes for plants of a variant; `alone` for one member, with the elementary functions of vectors."""
    from gough_stewart.fmu_build.codegen import function_source, in_lanes  # needed to compile only: imports CasADi
    from gough_stewart.fmu_build.plant.layout import plant_header
    from gough_stewart.model.traced import traced_function

    plant, legs = c_folder("plant"), function_source(traced_function("legs", variant))
    functions = [traced_function(name, variant) for name in ("derivatives", "outputs", "posed")]
    sizes = {
        "N_STATES": variant.n_states,
        "N_INPUTS": interface.N_INPUTS,
        "N_PARAMETERS": variant.n_parameters,
        "N_RESULTS": variant.n_results,
        "N_SIGNALS": interface.N_SIGNALS,
    }
    if not variant.parts:
        functions.append(traced_function("motion"))
        sizes["N_SHARED"] = functions[-1].numel_in(0)
    head = "#include <math.h>\n\nstatic double sq(double x)\n{\n    return x * x;\n}"
    head = '#include "elementary.h"\n' if alone else head
    return c_folder("lanes") | Sources(
        {
            "conditioning.c": plant.units["conditioning.c"],
            "legs.c": f'{GENERATED}\n#include "lanes_table.h"\n\n{head}\n{legs}',
        },
        {
            "conditioning.h": plant.headers["conditioning.h"],
            "internal.h": c_folder("unit").headers["internal.h"],
            "plant_table.h": plant_header(variant),
            "lanes_table.h": filled(
                "lanes/lanes_table.h",
                sizes=defines(sizes),
                controlled=defines(CONTROLLED),
                kernel=legs[: legs.index("\n{")].strip(),
            ),
            "lanes_kernel.h": f"{GENERATED}\n" + "".join(map(in_lanes, functions)),
        },
    )


def loop_sources(components: str, variant: Variant = IDEAL, *, alone: bool = False) -> Sources:
    """The C of c/loop and c/lanes, with the components of the loop as `components.h`."""
    return lanes_sources(variant, alone=alone) | c_folder("loop") | Sources({}, {"components.h": components})


def machine_library(sources: Sources, target: Target) -> Library:
    """The description of the library of c/machine for a target; a WebAssembly module imports nothing."""
    flags: tuple[str, ...] = ("-s", "-shared")
    if target is WEB_ASSEMBLY:
        offered = re.findall(r"^OFFERED [\w *]*?(\w+)\(", sources.headers["machine.h"], re.M)
        exports = [f"-Wl,--export={name}" for name in (*offered, "__heap_base")]
        flags = ("-mexec-model=reactor", "-Wl,--no-entry", "-s", *exports)
    return Library("machine", lambda: sources, digest_of_texts(sources.files), (*_MACHINE_FLAGS, *flags))


# ---- laws and folds: one generated header on vectors ----------------------------------------------------------------


def law_library(function: Any) -> LanesLibrary:
    """The library of c/law for one traced law, a CasADi Function `law` of `memory`, with the output `next`."""
    from gough_stewart.fmu_build.codegen import in_lanes

    text = in_lanes(function, "static inline void ", exact=True, call="each_{}")
    sizes = defines({"N_MEMORY": function.numel_in(0), "N_NEXT": function.numel_out(0)})
    called = sorted(set(re.findall(r"\beach_(\w+)\(", text)))
    loops = "\n".join(f"{'OF_TWO' if name in _OF_TWO else 'OF_ONE'}({name})" for name in called)
    sources = _on_vectors("law", "law_step.h", f"{GENERATED}\n{sizes}\n\n{loops}\n{text}")
    return machine_code(
        vector_library("law", lambda: sources, sha256(sources.headers["law_step.h"].encode()).hexdigest())
    )


class FoldKernel(NamedTuple):
    """The states of a fold after a row, from those before."""

    # inputs: columns of the row, those of the row before in the same order, `index`, `parameters` and `state`;
    # output: `next`
    function: Any
    columns: int  # their number


def folds_sources(kernels: Sequence[FoldKernel]) -> Sources:
    """The C of c/folds: a function for each kernel, called with the columns of a row, and their table."""
    from gough_stewart.fmu_build.codegen import in_lanes

    steps, table, all_sizes = [], [], []
    for function, n_columns in kernels:
        name = function.name()
        *elements, _, n_parameters, n_states = (function.numel_in(i) for i in range(function.n_in()))
        all_sizes.append((sum(elements) // 2, n_states, n_parameters))
        columns = [f"{row} + places[{i}]" for row in ("row", "before") for i in range(n_columns)]
        steps.append(f"""{in_lanes(function, "static inline void fold_", exact=True)}
static void step_{name}(const lanes row[], const lanes before[], const int64_t places[], const lanes index[],
                        const lanes parameters[], const lanes state[], lanes next[])
{{
    fold_{name}({", ".join([*columns, "index", "parameters", "state", "next"])});
}}
""")
        table.append(f'    {{"{name}", {", ".join(map(str, all_sizes[-1]))}, step_{name}}},\n')
    _, n_states, n_parameters = map(max, zip(*all_sizes, strict=True))
    sizes = defines({"MOST_STATES": n_states, "MOST_PARAMETERS": max(1, n_parameters)})
    rows = f"static const kernel KERNELS[] = {{\n{''.join(table)}}};\n"
    return _on_vectors("folds", "fold_kernels.h", f"{GENERATED}\n\n{sizes}\n{''.join(steps)}\n{rows}")


def _on_vectors(folder: str, generated: str, text: str) -> Sources:
    """A folder of C that needs the vectors of c/lanes and one generated header."""
    vectors = {name: c_folder("lanes").headers[name] for name in ("elementary.h", "vectors.h")}
    return c_folder(folder) | Sources({}, {**vectors, generated: text})


# ---- the kernel, for Python -----------------------------------------------------------------------------------------


def kernel_code(variant: Variant = IDEAL) -> Library:
    """The description of the library of a variant."""
    return Library(
        "-".join(["kernel", *variant.parts]), lambda: kernel_sources(variant), state_of_sources(), _KERNEL_FLAGS
    )


def kernel_sources(variant: Variant = IDEAL) -> Sources:
    """The C of the plant's component with its stepper, and of the ideal plant the kernel's functions."""
    from gough_stewart.fmu_build.codegen import function_source
    from gough_stewart.fmu_build.plant.plant_component import plant_component, platform_of
    from gough_stewart.model.traced import traced_function

    component = plant_component(platform_of(variant))
    unit = sources(component)
    called = {name: unit.units[name] for name in (*component.code.units, "model.c", "component.c")}
    stepper = Sources(called, unit.headers) | c_folder("stepper")
    if variant.parts:
        return stepper
    block, parts = new_block()
    block[:] = range(len(block))
    places = {f"AT_{name.upper()}": int(part[0]) for name, part in parts.items()}
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
