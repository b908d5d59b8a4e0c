"""Make what the package carries ready to use: `python -m gough_stewart.harness.prebuilt`.

From the one description of the equations, for each target: the unit of the plant without its start values; the kernel;
the code that steps many members, their loop and their folds, for several levels of processors. With them the C of the
kernel and the table of dependencies, which units carry, and the WebAssembly of live pages, so that nothing has to be
traced. The wheel's build makes all;
`make` makes the kernel of the machine at hand, and what else it needs is compiled at first use and kept.
`gough_stewart.model.process.installed` finds the files.
"""

import argparse
import json
import lzma
import os
import shutil
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gough_stewart.fmu_build.build import unit_library
from gough_stewart.fmu_build.cache import COMPILER, check_installed
from gough_stewart.fmu_build.codegen import kernel_source
from gough_stewart.fmu_build.libraries import (
    VECTOR_FLAGS,
    flags_by_level,
    kernel_code,
    lanes_code,
    machine_library,
)
from gough_stewart.fmu_build.plant.plant_component import (
    DEPENDENCIES,
    KERNEL_SOURCE,
    plant_component,
    traced_dependencies,
)
from gough_stewart.fmu_build.toolchain import WEB_ASSEMBLY, Target, chosen_targets
from gough_stewart.harness.export.machine_c import MACHINE, machine_c, machine_texts
from gough_stewart.harness.loop.libraries import loop_code
from gough_stewart.harness.results.metric_folds import folds_code
from gough_stewart.model.kernel import FUNCTIONS, new_block, parameter_vector, traced_call
from gough_stewart.model.platform import load_preset
from gough_stewart.model.process.files import write_whole
from gough_stewart.model.process.installed import (
    MANIFEST,
    PACKED,
    PREBUILT,
    TRACER,
    manifest_line,
    state_of_texts,
)


class PrebuiltFile(NamedTuple):
    """One file."""

    file: str
    states: dict[str, str]  # of the sources, by its names in the manifest
    make: Callable[[], bytes]


def parts(targets: Iterable[Target], *, only_here: bool = False, only_kernel: bool = False) -> Iterator[PrebuiltFile]:
    """All files for some targets; with `only_here` for the processor at hand instead of several levels."""
    targets, texts = tuple(targets), state_of_texts()
    for target in targets:
        name = f"{target.name}/kernel"
        yield PrebuiltFile(name + target.suffix, {name: texts}, lambda target=target: kernel_code().compiled(target))  # type: ignore[misc]
    if only_kernel:
        return

    def not_loaded_in_place(file: str, states: dict[str, str], make: Callable[[], bytes]) -> PrebuiltFile:
        return PrebuiltFile(file + PACKED, states, lambda: lzma.compress(make(), preset=9))

    yield not_loaded_in_place(KERNEL_SOURCE, {KERNEL_SOURCE: texts}, lambda: kernel_source().encode())
    yield not_loaded_in_place(DEPENDENCIES, {DEPENDENCIES: texts}, lambda: json.dumps(traced_dependencies()).encode())
    yield not_loaded_in_place(
        MACHINE, {MACHINE: machine_texts()}, lambda: machine_library(machine_c(), WEB_ASSEMBLY).compiled(WEB_ASSEMBLY)
    )
    for target in targets:
        unit = unit_library(plant_component(load_preset("liu2000")))
        name = f"{target.name}/{unit.name}"
        yield not_loaded_in_place(name + target.suffix, {name: unit.state}, partial(unit.compiled, target))
        levels = {"": VECTOR_FLAGS} if only_here else flags_by_level(target)
        for level, flags in levels.items():
            for library in (loop_code(), folds_code()):
                name = f"{target.name}/{library.name}{level}"
                states = {name: library.state}
                if library.name == "loop":  # it contains the lanes
                    states[f"{target.name}/lanes{level}"] = lanes_code().state
                compiled = partial(replace(library, flags=flags).compiled, target)
                yield not_loaded_in_place(name + target.suffix, states, compiled)


def numbers() -> dict[str, list[float]]:
    """Parts of the kernel's block, evaluated by CasADi: a platform with friction, in motion, off its home pose."""
    platform = load_preset("desktop_hexapod")
    _, block = new_block()
    pose = np.concatenate([np.add(platform.home_position, [2e-3, -3e-3, 4e-3]), [0.02, -0.03, 0.05]])
    block["x"][:] = np.concatenate([pose, [0.02, -0.01, 0.03], [0.1, -0.2, 0.3]])
    block["u"][:6] = platform.home_actuator_force + np.linspace(-5.0, 7.0, 6)
    block["u"][6:] = np.linspace(-2.0, 1.0, block["u"].size - 6)
    block["p"][:] = parameter_vector(platform)
    for name in FUNCTIONS:
        traced_call(name, block)()
    return {name: part.tolist() for name, part in block.items()}


def write_prebuilt(
    folder: Path, targets: Iterable[Target], *, only_here: bool = False, only_kernel: bool = False
) -> None:
    """Write the files, then the manifest; after an error there is none, and so nothing that would be used."""
    check_installed(TRACER, COMPILER)
    files = tuple(parts(targets, only_here=only_here, only_kernel=only_kernel))
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        contents = [*pool.map(lambda part: part.make(), files)]
    shutil.rmtree(folder, ignore_errors=True)
    lines = dict[str, dict[str, str]]()
    for part, content in zip(files, contents, strict=True):
        path = folder / part.file
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, content)
        lines |= {name: manifest_line(part.file, content, state) for name, state in part.states.items()}
    manifest = {"files": dict(sorted(lines.items())), "numbers": numbers()}
    write_whole(folder / MANIFEST, f"{json.dumps(manifest, indent=1)}\n".encode())


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m gough_stewart.harness.prebuilt", description=__doc__)
    parser.add_argument("--out", type=Path, default=PREBUILT, help="folder; the package's by default")
    parser.add_argument("--target", action="append", help="native, all, or a name; native by default")
    parser.add_argument("--only-here", action="store_true", help="for the processor at hand")
    parser.add_argument("--only-kernel", action="store_true", help="without units and what steps many members")
    options = parser.parse_args()
    targets = chosen_targets(["native"] if options.only_here else options.target or ["native"])
    write_prebuilt(options.out, targets, only_here=options.only_here, only_kernel=options.only_kernel)


if __name__ == "__main__":
    main()
