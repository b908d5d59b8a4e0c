"""C programs that link the unit or load its library (tests/support/hosts): sources, compilation."""

import json
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import fmpy

from gough_stewart import load_preset
from gough_stewart.fmu_build.component import UnitComponent
from gough_stewart.fmu_build.plant.plant_component import plant_component
from gough_stewart.fmu_build.sources import sources
from gough_stewart.fmu_build.toolchain import compiler_environment, compiling, place_of

HOSTS = Path(__file__).parent / "hosts"
FUZZ = tuple(sorted(HOSTS.glob("fuzz*.c")))
INSTANCES = (HOSTS / "instances.c",)
TOKEN = "host"  # what the hosts instantiate with
ZIG = (sys.executable, "-m", "ziglang", "cc")
# What has no right call in this unit: other kinds of variables and of execution, dependencies that change.
NEVER_OK = {
    *("fmi2CancelStep", "fmi2GetIntegerStatus", "fmi2GetStringStatus", "fmi3EnterStepMode"),
    *("fmi3EnterConfigurationMode", "fmi3ExitConfigurationMode", "fmi3ActivateModelPartition"),
    *("fmi3InstantiateScheduledExecution", "fmi3GetNumberOfVariableDependencies", "fmi3GetVariableDependencies"),
}

# What only units with continuous states have.
OF_STATES = {
    *("fmi2EnterEventMode", "fmi2NewDiscreteStates", "fmi2EnterContinuousTimeMode", "fmi2CompletedIntegratorStep"),
    *("fmi2SetTime", "fmi2SetContinuousStates", "fmi2GetDerivatives", "fmi2GetEventIndicators"),
    *("fmi2GetContinuousStates", "fmi2GetNominalsOfContinuousStates", "fmi2GetDirectionalDerivative"),
    *("fmi2GetRealOutputDerivatives", "fmi3GetOutputDerivatives", "fmi3GetDirectionalDerivative"),
    *("fmi3GetAdjointDerivative", "fmi3InstantiateModelExchange", "fmi3EnterEventMode", "fmi3UpdateDiscreteStates"),
    "fmi3EvaluateDiscreteStates",
    *("fmi3EnterContinuousTimeMode", "fmi3CompletedIntegratorStep", "fmi3SetTime", "fmi3SetContinuousStates"),
    *("fmi3GetContinuousStateDerivatives", "fmi3GetEventIndicators", "fmi3GetContinuousStates"),
    *("fmi3GetNominalsOfContinuousStates", "fmi3GetNumberOfEventIndicators", "fmi3GetNumberOfContinuousStates"),
}


def compile_host(
    host: Sequence[Path], program: Path, compiler: Sequence[str], component: UnitComponent | None = None
) -> Path:
    """A host linked with a whole unit, by default the paper's plant, both FMI versions in one; `compiler` has flags."""
    linked = plant_component(load_preset("liu2000")) if component is None else component
    units, headers = sources(linked, tokens=(TOKEN, TOKEN))
    # zig's cache knows a file by its place: what has not changed is not compiled again
    files = [str(place_of({name: text}) / name) for name, text in sorted(units.items())]
    with compiling():
        command = [*compiler, "-I", str(place_of(headers)), *files, "-std=c11", *map(str, host), "-lm", "-lpthread"]
        command += ["-o", str(program)]
        variables = compiler_environment()
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=program.parent, env=variables)
    assert done.returncode == 0, done.stderr
    return program


def fuzz(program: Path, sequences: int, seeds: Sequence[int] = (1,)) -> dict[str, dict[str, int]]:
    """Calls by function and status, of processes side by side that share the sequences; fails if one does."""
    command = [[str(program), str(seed), str(sequences // len(seeds))] for seed in seeds]
    running = [subprocess.Popen(c, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for c in command]
    total = dict[str, dict[str, int]]()
    for process in running:
        out, told = process.communicate()
        assert process.returncode == 0, told[-5000:]
        for function, counts in json.loads(out)["calls"].items():
            sums = total.setdefault(function, dict.fromkeys(counts, 0))
            for status, n in counts.items():
                sums[status] += n
    return total


def functions_of_the_standards() -> set[str]:
    """As the headers declare them, which FMPy's wheel carries."""
    folder = Path(fmpy.__file__).parent / "c-code"
    text = "".join((folder / f"fmi{version}Functions.h").read_text() for version in "23")
    return set(re.findall(r"^\s*FMI[23]_Export\s+\w+\s+(\w+);", text, re.M))


def run_instances(program: Path, number: int, threads: int) -> dict[str, Any]:
    """What the program prints; fails if it finds a difference."""
    done = subprocess.run([str(program), str(number), str(threads)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))
