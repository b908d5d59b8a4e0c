"""Make what the package carries ready to use: `python -m gough_stewart.harness.prebuilt`.

From the one description of the equations, for each target: the unit of the plant without its start values; the kernel;
the code that steps many members, their loop and their folds, for several levels of processors. With them the C of the
kernel and the table of dependencies, which units carry, and the WebAssembly of live pages, so that nothing has to be
traced. The wheel's build makes all;
`make` makes the kernel of the machine at hand, and what else it needs is compiled at first use and kept.
`gough_stewart.model.process.prebuilt` finds the files.
"""

import argparse
import json
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
from gough_stewart.fmu_build.codegen import kernel_source
from gough_stewart.fmu_build.errors import COMPILER, check_installed
from gough_stewart.fmu_build.kernel_library import kernel_code
from gough_stewart.fmu_build.libraries import (
    VECTOR_FLAGS,
    carried_name,
    flags_of_level,
    lanes_code,
    levels_of,
    machine_library,
)
from gough_stewart.fmu_build.plant.component import DEPENDENCIES, KERNEL_SOURCE, plant_component, traced_dependencies
from gough_stewart.fmu_build.targets import WEB_ASSEMBLY, Target, chosen_targets
from gough_stewart.harness.export.machine import MACHINE, machine_c, machine_texts
from gough_stewart.harness.loop.libraries import loop_code
from gough_stewart.harness.results.metric_folds import folds_code
from gough_stewart.model.kernel import FUNCTIONS, new_block, parameter_vector, traced_call
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.process.files import write_whole
from gough_stewart.model.process.installed import TRACER
from gough_stewart.model.process.prebuilt import (
    MANIFEST,
    PACKED,
    manifest_line,
    packed,
    prebuilt_folder,
    state_of_texts,
)


class Part(NamedTuple):
    """One file."""

    file: str
    states: dict[str, str]  # of the sources, by its names in the manifest
    make: Callable[[], bytes]


def parts(targets: Iterable[Target], *, only_here: bool = False, only_kernel: bool = False) -> Iterator[Part]:
    """All files for some targets; with `only_here` for the processor at hand instead of several levels."""
    targets = tuple(targets)
    for target in targets:
        yield _kernel(target)
    if only_kernel:
        return
    texts = state_of_texts()
    yield _packed(KERNEL_SOURCE, {KERNEL_SOURCE: texts}, lambda: kernel_source().encode())
    yield _packed(DEPENDENCIES, {DEPENDENCIES: texts}, lambda: json.dumps(traced_dependencies()).encode())
    yield _packed(
        MACHINE, {MACHINE: machine_texts()}, lambda: machine_library(machine_c(), WEB_ASSEMBLY).compiled(WEB_ASSEMBLY)
    )
    for target in targets:
        yield _unit(target)
        yield from _machine_code(target, only_here)


def _packed(file: str, states: dict[str, str], make: Callable[[], bytes]) -> Part:
    """A file that is not loaded where it is."""
    return Part(file + PACKED, states, lambda: packed(make()))


def _kernel(target: Target) -> Part:
    state = {f"{target.name}/kernel": state_of_texts()}
    return Part(f"{target.name}/kernel{target.suffix}", state, lambda: kernel_code().compiled(target))


def _unit(target: Target) -> Part:
    library = unit_library(plant_component(load_preset("liu2000")))
    name = f"{target.name}/{library.name}"
    return _packed(name + target.suffix, {name: library.state}, lambda: library.compiled(target))


def _machine_code(target: Target, only_here: bool) -> Iterator[Part]:
    levels = {level: flags_of_level(level) for level in levels_of(target)}
    for level, flags in {0: VECTOR_FLAGS}.items() if only_here else levels.items():
        for library in (loop_code(), folds_code()):
            name = carried_name(target, library.name, level)
            states = {name: library.state}
            if library.name == "loop":  # it contains the lanes
                states[carried_name(target, "lanes", level)] = lanes_code().state
            yield _packed(name + target.suffix, states, partial(replace(library, flags=flags).compiled, target))


def numbers() -> dict[str, list[float]]:
    """Parts of the kernel's block, evaluated by CasADi: a platform with friction, in motion, off its home pose."""
    platform = load_preset("desktop_hexapod")
    _, found = new_block()
    pose = np.concatenate([np.add(platform.home_position, [2e-3, -3e-3, 4e-3]), [0.02, -0.03, 0.05]])
    found["x"][:] = np.concatenate([pose, [0.02, -0.01, 0.03], [0.1, -0.2, 0.3]])
    found["u"][:6] = platform.home_actuator_force + np.linspace(-5.0, 7.0, 6)
    found["u"][6:] = np.linspace(-2.0, 1.0, found["u"].size - 6)
    found["p"][:] = parameter_vector(platform)
    for name in FUNCTIONS:
        traced_call(name, found)()
    return {name: part.tolist() for name, part in found.items()}


def write_prebuilt(
    folder: Path, targets: Iterable[Target], *, only_here: bool = False, only_kernel: bool = False
) -> None:
    """Write the files, then the manifest; after an error there is none, and so nothing that would be used.

    Raises
    ------
    BuildError
        A package of the extra `compile` is not installed, or the compiler fails.
    OSError
        The folder cannot be written.
    """
    check_installed(TRACER, COMPILER)
    made = tuple(parts(targets, only_here=only_here, only_kernel=only_kernel))
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        contents = [*pool.map(lambda part: part.make(), made)]
    shutil.rmtree(folder, ignore_errors=True)
    lines = dict[str, dict[str, str]]()
    for part, content in zip(made, contents, strict=True):
        path = folder / part.file
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, content)
        lines |= {name: manifest_line(part.file, content, state) for name, state in part.states.items()}
    manifest = {"files": dict(sorted(lines.items())), "numbers": numbers()}
    write_whole(folder / MANIFEST, f"{json.dumps(manifest, indent=1)}\n".encode())


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m gough_stewart.harness.prebuilt", description=__doc__)
    parser.add_argument("--out", type=Path, default=prebuilt_folder(), help="folder; the package's by default")
    parser.add_argument("--target", action="append", help="native, all, or a name; native by default")
    parser.add_argument("--only-here", action="store_true", help="for the processor at hand")
    parser.add_argument("--only-kernel", action="store_true", help="without units and what steps many members")
    options = parser.parse_args()
    targets = chosen_targets(["native"] if options.only_here else options.target or ["native"])
    write_prebuilt(options.out, targets, only_here=options.only_here, only_kernel=options.only_kernel)


if __name__ == "__main__":
    main()
