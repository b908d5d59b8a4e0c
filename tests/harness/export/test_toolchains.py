"""Exported C under the compilers that are there: the standards of C, C++, microcontrollers; no warning is allowed."""

import re
import shutil
import subprocess
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from gough_stewart import experiment_names, load_experiment
from gough_stewart.harness.export.choices import ReferenceFrom, faults_of
from gough_stewart.harness.export.design import designed
from gough_stewart.harness.export.write import controller_sources
from tests.support.c_hosts import ZIG
from tests.support.exported import Exported, compiled, write_sources

STRICT = ("-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wdouble-promotion")
IN_C99, IN_C11, IN_C17 = ("-std=c99",), ("-std=c11",), ("-std=c17",)
IN_CPP = ("-x", "c++", "-std=c++11")
M4F = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")
M7 = ("-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-d16")
COMPILERS: dict[str, tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]] = {
    "gcc": (("gcc",), (IN_C99, IN_C11, IN_C17, IN_CPP)),
    "clang": (("clang",), (IN_C99, IN_C11, IN_C17, IN_CPP)),
    "arm-none-eabi-gcc for Cortex-M4F": (("arm-none-eabi-gcc", *M4F), (IN_C99, IN_C11, IN_C17, IN_CPP)),
    "arm-none-eabi-gcc for Cortex-M7": (("arm-none-eabi-gcc", *M7), (IN_C99, IN_CPP)),
    "zig": (ZIG, (IN_C99, IN_C17)),
}
# Together they have every part of the template: a law in leg and in task space, integrals and limits, a table, both
# kinds of feedforward and none, a reference that comes in, and measurements that are watched.
COVERING = ("saturation", "pitch_sine", "fastest_path", "circle from inputs")
FEW = ("saturation", "pitch_sine", "circle from inputs")
EXPORTABLE = tuple(name for name in experiment_names() if name != "paper_open_loop")


@cache
def written(name: str, folder: Path) -> str:
    """The files of an experiment, and the prefix of their names."""
    experiment, _, inputs = name.partition(" from ")
    faults = faults_of(frozen=(50, 1e-3)) if inputs or experiment == "saturation" else faults_of()
    reference: ReferenceFrom = "inputs" if inputs else "inside"
    prefix = f"{experiment}_{inputs or 'inside'}"
    write_sources(controller_sources(designed(load_experiment(experiment), None, reference, faults), prefix), folder)
    return prefix


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("sources")


def compile_with(compiler: str, names: tuple[str, ...], folder: Path) -> None:
    """All sources, with both real types, in every language."""
    command, languages = COMPILERS[compiler]
    if shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} is not installed")
    for name in names:
        prefix = written(name, folder)
        for k, language in enumerate(languages):
            # the first language with both real types and to the end, others with one of them and for the warnings
            for real in ("float", "double") if k == 0 else (("double", "float")[k % 2],):
                to_the_end = ("-c", "-o", "object.o") if k == 0 or command == ZIG else ("-fsyntax-only",)
                defined = f"-D{prefix.upper()}_REAL={real}"
                compiled([*command, *STRICT, *language, defined, *to_the_end, f"{prefix}.c"], folder)


@pytest.mark.parametrize(
    "compiler", ["gcc", "clang", "arm-none-eabi-gcc for Cortex-M4F", "arm-none-eabi-gcc for Cortex-M7"]
)
def test_sources_compile_without_a_warning(compiler: str, folder: Path) -> None:
    compile_with(compiler, COVERING if compiler == "gcc" else FEW, folder)


def test_zig_compiles_sources_without_a_warning(folder: Path) -> None:
    """Clang's warnings and C library; slower than the others."""
    compile_with("zig", ("fastest_path",), folder)


@pytest.mark.evidence
@pytest.mark.parametrize("compiler", COMPILERS)
def test_sources_of_every_shipped_experiment_compile_without_a_warning(compiler: str, folder: Path) -> None:
    compile_with(compiler, (*EXPORTABLE, "circle from inputs"), folder)


def test_a_program_in_c_plus_plus_calls_a_controller_in_c(tmp_path: Path) -> None:
    """Expected: it links with the object that a C compiler made, and prints the forces of the example in C.

    The first are those of a sample exactly on the reference.
    """
    if shutil.which("g++") is None:
        pytest.skip("g++ is not installed")
    folder = tmp_path
    prefix = written("saturation", folder)
    compiled(["gcc", *STRICT, "-c", f"{prefix}.c", "-o", "law.o"], folder)
    compiled(["gcc", "example_main.c", "law.o", "-lm", "-o", "in_c"], folder)
    strict = [flag for flag in STRICT if flag != "-Wconversion"]
    compiled(["g++", *strict, *IN_CPP, "example_main.c", "-x", "none", "law.o", "-lm", "-o", "in_cpp"], folder)
    printed = [
        subprocess.run([str(folder / program)], capture_output=True, text=True, check=True).stdout
        for program in ("in_c", "in_cpp")
    ]
    assert printed[0] == printed[1]
    assert printed[0].count(" N") == 30
    first = [float(value) for value in re.findall(r"(\S+) N", printed[0].splitlines()[0])]
    made = designed(load_experiment("saturation"), faults=faults_of(frozen=(50, 1e-3)))
    np.testing.assert_allclose(first, Exported(made).start().step(made.first_measured)[0], rtol=1e-5)


def test_two_controllers_of_different_precision_link_into_one_program(tmp_path: Path) -> None:
    """Expected: no name that both have; each prepares with its own parameters, one in float and one in double."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    names = [written(name, tmp_path) for name in ("saturation", "circle from inputs")]
    lines = [f'#include "{name}.h"' for name in names] + ["int main(void)", "{", "    int wrong = 0;"]
    for name in names:
        lines.append(f"    {name}_coefficients {name} = {{0}};")
        lines.append(f"    wrong += {name}_prepare(&{name.upper()}_DEFAULTS, &{name});")
    sizes = " ".join(f"!(sizeof({name}_real) == {size}) ||" for name, size in zip(names, (4, 8), strict=True))
    (tmp_path / "main.c").write_text("\n".join([*lines, f"    return {sizes} wrong != 0;", "}", ""]))
    single = f"-D{names[0].upper()}_REAL=float"
    compiled(["gcc", "-std=c99", single, "-Wall", "-Werror", "main.c", *(f"{n}.c" for n in names), "-lm"], tmp_path)
    assert subprocess.run([str(tmp_path / "a.out")], check=False).returncode == 0
