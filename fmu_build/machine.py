"""C of one machine with its loop, as plain C99 in double precision: the sources of c/loop for one member.

c/machine/machine.h is its interface. It is compiled for any target, also to WebAssembly, with equal bits.
"""

import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gough_stewart.fmu_build.cache_files import cache_folder, digest_of, kept
from gough_stewart.fmu_build.cached import state_of_sources
from gough_stewart.fmu_build.errors import COMPILER, check_installed
from gough_stewart.fmu_build.lanes import loop_sources
from gough_stewart.fmu_build.targets import native
from gough_stewart.fmu_build.toolchain import compile_library, compiled
from gough_stewart.model.variant import IDEAL, Variant

# Of all compilers: no fused operations, which some processors lack.
FLAGS = ("-O2", "-std=c99", "-g0", "-fvisibility=hidden", "-ffp-contract=off", "-fno-math-errno")
_NATIVE = ("-s", "-shared")
_WASM = ("-target", "wasm32-wasi", "-mexec-model=reactor", "-Wl,--no-entry", "-s")
_OFFERED = re.compile(r"^MACHINE_OFFERED [\w *]*?(\w+)\(", re.M)

Sources = tuple[dict[str, str], dict[str, str]]


def machine_sources(
    components: str, fields: str, plan: str, design: str, law: Any = None, variant: Variant = IDEAL
) -> Sources:
    """Units and headers by file name.

    Parameters
    ----------
    components, fields, plan, design
        `components.h` of c/loop, `machine_fields.h`, `plan.h`, the motions, and `design.h`, what turned gains give.
    law
        A user's, see `law_library`.
    variant
        Of the plant.
    """
    from gough_stewart.fmu_build.sources import c_folder
    from gough_stewart.fmu_build.tables import GENERATED

    units, headers = loop_sources(components, variant)
    own = c_folder("machine")
    units = {**units, **own.units}
    # the kernel of single members with these functions, too
    units["legs.c"] = units["legs.c"].replace("#include <math.h>", '#include "elementary.h"')
    units["legs.c"] = re.sub(r"\nstatic double sq\(double x\)\n\{\n.*?\n\}\n", "\n", units["legs.c"], flags=re.S)
    headers = {**headers, **own.headers, "machine_fields.h": f"{GENERATED}\n{fields}"}
    headers["plan.h"], headers["design.h"] = f"{GENERATED}\n{plan}", f"{GENERATED}\n{design}"
    headers["vectors.h"] = headers["vectors.h"].replace("#ifndef WIDTH\n#define WIDTH 8\n#endif", "#define WIDTH 1")
    if law is not None:
        from gough_stewart.fmu_build.lanes import law_sources

        law_units, law_headers = law_sources(law)
        units = {**units, **law_units}
        headers = {
            **law_headers,
            **headers,
            "machine_fields.h": headers["machine_fields.h"] + "\n#define MACHINE_HAS_LAW\n",
        }
    return units, headers


def machine_library(sources: Sources) -> Path:
    """The library for this system, from the cache if it was built before.

    Raises
    ------
    BuildError, OSError
        As `machine_code`.
    """
    target = native()
    flags = (*FLAGS, *_NATIVE)
    return kept(
        _folder(sources, flags) / f"machine{target.suffix}",
        lambda: compile_library("machine", *sources, target, flags=flags),
    )


def kept_wasm(sources: Sources) -> Path:
    """The WebAssembly module, likewise."""
    return kept(_folder(sources, _WASM) / "machine.wasm", lambda: machine_wasm(sources))


def _folder(sources: Sources, flags: tuple[str, ...]) -> Path:
    texts = "\0".join(f"{name}\0{text}" for each in sources for name, text in sorted(each.items()))
    key = digest_of(f"{state_of_sources()}\n{flags}\n{texts}".encode())[:24]
    return cache_folder() / "machine" / key


def machine_wasm(sources: Sources) -> bytes:
    """The WebAssembly module, which imports nothing.

    Raises
    ------
    NotInstalledError
        The compiler (extra `compile`) is missing.
    BuildError
        It fails.
    """
    check_installed(COMPILER)
    units, headers = sources
    exports = [f"-Wl,--export={name}" for name in (*_OFFERED.findall(headers["machine.h"]), "__heap_base")]

    def commands(module: str, files: Sequence[str], include: str) -> Sequence[Sequence[str]]:
        command = (sys.executable, "-m", COMPILER, "cc", *_WASM, *FLAGS, *exports, "-I", include, *files)
        return [[*command, "-o", module]]

    return compiled("machine.wasm", units, headers, commands, "WebAssembly")
