"""The library that steps many platforms at once: kernels with eight members per vector, compiled for this processor.

It is built once and cached; c/lanes/lanes.h is its interface.
"""

import ctypes
import platform
import re
import subprocess
import tempfile
import warnings
from collections.abc import Callable
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from gough_stewart.fmu_build.cache_files import cache_folder, digest_of, kept
from gough_stewart.fmu_build.cached import state_of_sources
from gough_stewart.fmu_build.errors import COMPILER, check_installed
from gough_stewart.fmu_build.source_state import state_of_texts
from gough_stewart.fmu_build.targets import Target, native
from gough_stewart.fmu_build.toolchain import compile_library
from gough_stewart.model import interface
from gough_stewart.model.compiled_kernel import processor_level
from gough_stewart.model.process.files import write_whole
from gough_stewart.model.process.prebuilt import prebuilt_content
from gough_stewart.model.variant import IDEAL, Variant

# Members per vector: the number of doubles in an AVX-512 register; other processors use several registers.
WIDTH = 8
_NATIVE = "-mcpu=native"
# Of x86-64 [x86-64 psABI, 3.1.1], by level: with AVX2, as nearly all since 2013, and with AVX-512.
_LEVELS = {3: "-mcpu=x86_64_v3", 4: "-mcpu=x86_64_v4"}
FLAGS = (
    *("-O3", _NATIVE, "-std=c11", "-g0", "-s", "-shared", "-fvisibility=hidden"),
    # fused operations are the same for all members; NaN is kept, since the checks look for it
    *("-ffp-contract=fast-honor-pragmas", "-fno-math-errno", "-fno-signed-zeros"),
)
# Limits of error-controlled steps: internal steps of a plant step, and the smallest one as a share of it.
CONTROLLED = {"MOST_LANE_STEPS": 10_000.0, "SMALLEST_SHARE": 1e-9, "SMALLEST_RATE": 1e-200}
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
    # of c/loop
    COMMAND = 12
    STROKE = 13
    AWAY = 14
    NOT_STARTED = 15


class LanesLibrary(NamedTuple):
    """A library that has been built for this processor."""

    path: Path
    # processor, its vector instructions, and a digest of the machine code: equal texts mean identical bits
    features: str


class MachineCode(NamedTuple):
    """The arguments of `machine_code`."""

    name: str
    sources: Callable[[], tuple[dict[str, str], dict[str, str]]]
    state: str = ""


def lanes_library(variant: Variant = IDEAL) -> LanesLibrary:
    """The library of c/lanes for this processor and plants of a variant; see `machine_code`."""
    return machine_code(named(_NAME, variant), lambda: lanes_sources(variant))


def named(name: str, variant: Variant) -> str:
    """The name of machine code for a variant: the parts of its plant follow."""
    return "-".join([name, *variant.parts])


def machine_code(
    name: str, sources: Callable[[], tuple[dict[str, str], dict[str, str]]], state: str = ""
) -> LanesLibrary:
    """A library for this processor: the one that came with the package, else from the cache, else compiled.

    Parameters
    ----------
    sources
        Gives units and headers by file name.
    state
        Digest of sources outside of this package.

    Raises
    ------
    BuildError
        The compiler (extra `compile`) is missing or fails, or the machine is not supported.
    OSError
        The cache cannot be written.
    """
    target = native()
    carried = _carried(name, state, target)
    if carried is not None:
        return carried
    check_installed(COMPILER)
    processor = _processor()
    key = digest_of(f"{state_of_sources()}\n{state}\n{FLAGS}\n{processor}".encode())[:24]
    path = kept(
        cache_folder() / name / f"{key}-{target.name}" / f"{name}{target.suffix}",
        lambda: compile_library(name, *sources(), native(), flags=FLAGS),
    )
    words = set(processor.split())
    sets = [name for name in _VECTOR_SETS if name in words]
    return LanesLibrary(path, " ".join([target.name, *sets, digest_of(path.read_bytes())[:16]]))


def machine_state(state: str) -> str:
    """The state of the sources of machine code, from the digest of those outside of this package."""
    return digest_of(f"{state_of_texts()}\n{state}".encode())


def levels_of(target: Target) -> tuple[int, ...]:
    """The levels of processors of a target for which a wheel has machine code, see `compiled_kernel.processor_level`.

    Level 0 is for all processors of a target. Those that compute ensembles with AVX-512 run Linux; Apple's systems
    enable it late in a process, if at all.
    """
    if not target.name.startswith("x86_64"):
        return (0,)
    return (3, 4) if target.suffix == ".so" else (3,)


def flags_of_level(level: int) -> tuple[str, ...]:
    """The compiler's flags for machine code of a level."""
    own = (_LEVELS[level],) if level else ()
    return (*own, *(flag for flag in FLAGS if flag != _NATIVE))


def carried_name(target: Target, name: str, level: int) -> str:
    """The name of machine code in the manifest of prebuilt files."""
    return f"{target.name}/{name}{f'-v{level}' if level else ''}"


def _carried(name: str, state: str, target: Target) -> LanesLibrary | None:
    """The machine code that came with the package, of the highest level that this processor has; None if none."""
    most = processor_level() or 0
    # level 0: also of a wheel that was made for the processor at hand
    for level in (0, *(level for level in sorted(_LEVELS, reverse=True) if level <= most)):
        content = prebuilt_content(carried_name(target, name, level), machine_state(state))
        if content is None:
            continue
        path = _unpacked(content, name, target)
        if _loads(path):
            words = [target.name, *([f"x86-64-v{level}"] if level else []), digest_of(content)[:16]]
            return LanesLibrary(path, " ".join(words))
    return None


def _unpacked(content: bytes, name: str, target: Target) -> Path:
    """A file that can be loaded: in the cache, or of this process alone if that cannot be written."""
    digest = digest_of(content)[:24]
    try:
        return kept(cache_folder() / "unpacked" / digest / f"{name}{target.suffix}", lambda: content)
    except OSError:
        path = Path(_own_folder().name, f"{name}-{digest}{target.suffix}")
        write_whole(path, content)
        return path


@cache
def _own_folder() -> tempfile.TemporaryDirectory[str]:
    """It is removed when the process ends."""
    return tempfile.TemporaryDirectory(prefix="gough-stewart-", ignore_cleanup_errors=True)


@cache
def _loads(path: Path) -> bool:
    """Whether a library loads on this machine; if not, a warning says why."""
    try:
        ctypes.CDLL(str(path))
    except OSError as error:
        warnings.warn(f"{path} does not load here, and is compiled instead: {error}", stacklevel=4)
        return False
    return True


def lanes_sources(variant: Variant = IDEAL) -> tuple[dict[str, str], dict[str, str]]:
    """Units and headers by file name, for plants of a variant."""
    from gough_stewart.fmu_build.codegen import function_source  # imports CasADi, which a cached library does not need
    from gough_stewart.fmu_build.plant.tables import plant_header
    from gough_stewart.fmu_build.sources import c_folder
    from gough_stewart.fmu_build.tables import GENERATED
    from gough_stewart.model import traced

    own, plant, unit = c_folder("lanes"), c_folder("plant"), c_folder("unit")
    scalar = function_source(traced.legs_function(variant))
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
        "plant_table.h": plant_header(variant),
        "lanes_table.h": _table(scalar, variant),
        "lanes_kernel.h": f"{GENERATED}\n" + "".join(in_lanes(f) for f in _vector_kernels(variant)),
    }
    return units, headers


def loop_sources(components: str, variant: Variant = IDEAL) -> tuple[dict[str, str], dict[str, str]]:
    """Units and headers of c/loop and c/lanes, with the components of the loop as `components.h`."""
    from gough_stewart.fmu_build.sources import c_folder

    units, headers = lanes_sources(variant)
    own = c_folder("loop")
    return {**units, **own.units}, {**headers, **own.headers, "components.h": components}


def law_library(function: Any) -> LanesLibrary:
    """The library of c/law for one traced law, a CasADi Function `law` of `memory`, with the output `next`.

    Raises
    ------
    BuildError, OSError
        As `lanes_library`.
    RuntimeError
        As `in_lanes`.
    """
    units, headers = law_sources(function)
    return machine_code("law", lambda: (units, headers), state=digest_of(headers["law_step.h"].encode()))


def law_sources(function: Any) -> tuple[dict[str, str], dict[str, str]]:
    """Units and headers of c/law for a traced law."""
    from gough_stewart.fmu_build.sources import c_folder
    from gough_stewart.fmu_build.tables import GENERATED, defines

    text = in_lanes(function, "static inline void ", exact=True, call="each_{}")
    own, lanes = c_folder("law"), c_folder("lanes")
    sizes = defines({"N_MEMORY": function.numel_in(0), "N_NEXT": function.numel_out(0)})
    called = sorted(set(re.findall(r"\beach_(\w+)\(", text)))
    several = {name: "OF_TWO" if name in _OF_TWO else "OF_ONE" for name in called}
    made = "\n".join(f"{of}({name})" for name, of in several.items())
    header = f"{GENERATED}\n{sizes}\n\n{made}\n{text}"
    headers = {name: lanes.headers[name] for name in ("elementary.h", "vectors.h")}
    return dict(own.units), {**own.headers, **headers, "law_step.h": header}


# Functions of the C library with two arguments.
_OF_TWO = ("atan2", "copysign", "fmax", "fmin", "fmod", "hypot", "pow", "remainder")


def _vector_kernels(variant: Variant) -> tuple[Any, ...]:
    from gough_stewart.model import traced

    return (
        traced.derivatives_function(variant),
        traced.outputs_function(variant),
        traced.signals_function(variant),
        traced.margins_function(variant),
        traced.posed_function(variant),
        *([] if variant.parts else [traced.motion_function()]),
    )


# Divisors are inverted by a function of c/lanes/elementary.h, faster than a division, for finite numbers.
_RECIPROCALS = (
    (r"=1/(\w+);", r"=reciprocal(\1);"),
    (r"=\((\w+)/(\w+)\);", r"=(\1*reciprocal(\2));"),
)
_ROOTS = ((r"\bsqrt\(", "rounded_square_root("),)
# What vectors cannot do by operators is done by functions there.
_ON_VECTORS = (
    (r"=\((\w+)!=0\?(\w+):0\);", r"=if_so(\1,\2);"),
    (r"=\((\w+)==0\);", r"=is_not(\1);"),
    (r"=\((\w+)!=0&&(\w+)!=0\);", r"=both(\1,\2);"),
    (r"=\((\w+)!=0\|\|(\w+)!=0\);", r"=either(\1,\2);"),
    (r"=\((\w+)<=(\w+)\);", r"=is_at_most(\1,\2);"),
    (r"=\((\w+)<(\w+)\);", r"=is_less(\1,\2);"),
    (r"=\((\w+)==(\w+)\);", r"=is_equal(\1,\2);"),
    (r"=\((\w+)!=(\w+)\);", r"=is_other(\1,\2);"),
)


_KERNEL = "static __attribute__((noinline)) void kernel_"


def in_lanes(function: Any, declarator: str = _KERNEL, *, exact: bool = False, call: str = "{}") -> str:
    """The C source of a CasADi Function on vectors of members.

    Parameters
    ----------
    declarator
        The text before its name.
    exact
        Whether divisions and roots are rounded as NumPy's; without it divisors must be finite.
    call
        How a function of the C library is called, from its name.

    Raises
    ------
    RuntimeError
        CasADi's code has a construct that is not known.
    """
    from gough_stewart.fmu_build.codegen import Types, function_source

    text = function_source(function, declarator, Types("lanes", call=call), conditions=True, reciprocals=not exact)
    for scalar, vector in (*(_ROOTS if exact else _RECIPROCALS), *_ON_VECTORS):
        text = re.sub(scalar, vector, text)
    if left := re.search(r".*(\?|[<>!=]=|[<>]|&&|\|\|).*", text):
        raise RuntimeError(f"{function.name()}: unknown construct '{left[0].strip()}' in the generated code")
    return text


def _table(scalar_kernel: str, variant: Variant) -> str:
    """`lanes_table.h`: sizes of the kernels' vectors, and the kernel of single members."""
    from gough_stewart.fmu_build.tables import GENERATED, defines
    from gough_stewart.model import traced

    sizes = {
        "N_STATES": interface.size_of(variant.states),
        "N_INPUTS": interface.N_INPUTS,
        "N_PARAMETERS": interface.size_of(variant.parameters),
        "N_RESULTS": interface.size_of(variant.results),
        "N_SIGNALS": interface.N_SIGNALS,
    }
    if not variant.parts:
        sizes["N_SHARED"] = traced.motion_function().numel_in(0)
    values = ", ".join(f"{each:g}" for each in variant.scales)
    scales = f"\n/* of absolute tolerances, by state */\n#define SCALES {{{values}}}" if variant.bristles else ""
    declaration = scalar_kernel[: scalar_kernel.index("\n{")].strip()
    return f"""{GENERATED}
#ifndef LANES_TABLE_H
#define LANES_TABLE_H

#include "internal.h"
#include "plant_table.h"

{defines(sizes)}
{defines(CONTROLLED)}{scales}

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
