"""Slow evidence from hosts written in C: long random calls under sanitizers, threads, other systems."""

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from gough_stewart import load_preset
from gough_stewart.fmu_build.plant.plant_component import plant_component
from gough_stewart.fmu_build.sources import sources, standard_headers
from gough_stewart.fmu_build.toolchain import BY_NAME, Target, compile_library, native
from gough_stewart.harness.export.controller_units import component_of
from gough_stewart.harness.export.design import designed
from gough_stewart.harness.export.trace import traced
from gough_stewart.model.formulations.cases import paper_case
from tests.support.c_hosts import (
    FUZZ,
    HOSTS,
    INSTANCES,
    NEVER_OK,
    OF_STATES,
    TOKEN,
    ZIG,
    compile_host,
    functions_of_the_standards,
    fuzz,
    run_instances,
)
from tests.support.exported import PID, SINE, uneven_experiment

pytestmark = pytest.mark.evidence

# What runs programs of other systems, and where its libraries are.
RUNNERS = {"aarch64-linux": ("qemu-aarch64", "/usr/aarch64-linux-gnu"), "x86_64-windows": ("wine", "/")}
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")


def gcc_with(flags: Sequence[str], folder: Path) -> str:
    """The path of gcc; skips the test if it cannot make programs with these flags."""
    gcc = shutil.which("gcc")
    if gcc is None:
        pytest.skip("gcc is not installed")
    (folder / "empty.c").write_text("int main(void) { return 0; }\n")
    program = folder / "empty"
    made = subprocess.run([gcc, *flags, "empty.c", "-o", "empty"], cwd=folder, capture_output=True, check=False)
    if made.returncode != 0 or subprocess.run([str(program)], capture_output=True, check=False).returncode != 0:
        pytest.skip(f"this gcc has no {' '.join(flags)}")
    return gcc


@pytest.mark.parametrize("kind", ["plant", "controller"])
def test_100_000_sequences_of_calls_break_no_contract_and_no_rule_of_c(tmp_path: Path, kind: str) -> None:
    """Expected: what tests/support/hosts/fuzz_contract.c checks after every call; no word from the sanitizers."""
    gcc = gcc_with(SANITIZERS, tmp_path)
    controller = {**PID, "feedforward": "computed_torque"}
    experiment = uneven_experiment(reference=SINE, controller=controller, actuators={"force_limit": 75.0})
    law = designed(experiment, reference="inputs")
    component = None if kind == "plant" else component_of(law, traced(law))
    program = compile_host(FUZZ, tmp_path / "fuzz", (gcc, "-O1", "-g", *SANITIZERS), component)
    calls = fuzz(program, 100_000, seeds=(1, 2))
    print(f"\n{sum(sum(n.values()) for n in calls.values())} calls of {len(calls)} functions, no violation")
    assert set(calls) == functions_of_the_standards()
    assert {f for f, n in calls.items() if n["ok"] == 0} == NEVER_OK | (set() if kind == "plant" else OF_STATES)


@pytest.mark.skipif(sys.platform != "linux", reason="memory is measured by glibc's mallinfo2")
def test_instances_in_threads_have_the_bits_of_instances_in_turn(tmp_path: Path) -> None:
    """Expected: the same unit, stepped in another order. At most 16 KiB for an instance."""
    program = compile_host(INSTANCES, tmp_path / "instances", (*ZIG, "-O1"))
    assert run_instances(program, 100, 8)["bytes_per_instance"] <= 16 * 1024


def test_threads_do_not_race(tmp_path: Path) -> None:
    """Expected: no word from the thread sanitizer."""
    gcc = gcc_with(("-fsanitize=thread",), tmp_path)
    program = compile_host(INSTANCES, tmp_path / "instances", (gcc, "-O1", "-g", "-fsanitize=thread"))
    run_instances(program, 100, 8)


def trajectory(target: Target, folder: Path, runner: Sequence[str] = (), **variables: str) -> NDArray[np.float64]:
    """Poses (101, 6) of the paper's second from the library for a system, loaded by a host for the same system."""
    component = plant_component(load_preset("liu2000"))
    unit = sources(component, "2.0", (TOKEN, ""))
    # headers as in an FMU, which makes one compilation of the kernel for both
    library = compile_library("unit", unit.units, unit.headers | standard_headers("3.0"), target)
    folder.mkdir()
    (folder / f"unit{target.suffix}").write_bytes(library)
    for name, text in standard_headers("2.0").items():
        (folder / name).write_text(text)
    program = "trajectory.exe" if "windows" in target.name else "trajectory"
    command = [*ZIG, "-target", target.triple, "-std=c11", "-O1", "-I", ".", str(HOSTS / "trajectory.c"), "-o", program]
    if "linux" in target.name:
        command.append("-ldl")
    made = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr
    command, env = [*runner, f"./{program}", f"./unit{target.suffix}", TOKEN], {**os.environ, **variables}
    done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return np.array([line.split() for line in done.stdout.splitlines()], dtype=float)


@pytest.mark.parametrize("name", ["aarch64-linux", "x86_64-windows"])
def test_another_system_moves_as_this_one_does(name: str, tmp_path: Path) -> None:
    """Expected: the trajectory of this system's own library, relative to the largest coordinate in m and in rad."""
    program, root = RUNNERS[name]
    found = shutil.which(program)
    if found is None or not Path(root).is_dir():
        pytest.skip(f"{program} or {root} is not installed")
    runner = (found, "-L", root) if root != "/" else (found,)
    poses = trajectory(BY_NAME[name], tmp_path / "unit", runner, WINEDEBUG="-all", WINEPREFIX=str(tmp_path / "wine"))
    expected = trajectory(native(), tmp_path / "native")
    assert expected.shape == (101, 6)
    start = paper_case().start
    np.testing.assert_array_equal(expected[0], [*start.position, *start.orientation])
    scale = np.repeat([np.abs(expected[:, :3]).max(), np.abs(expected[:, 3:]).max()], 3)
    worst = (np.abs(poses - expected) / scale).max()
    print(f"\n{name}: largest relative difference {worst:.1e}")
    assert worst <= 1e-12
