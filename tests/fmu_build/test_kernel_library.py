"""The kernel and the stepper as machine code: CasADi's evaluation, what is refused, what is compiled and kept."""

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from ctypes import PyDLL
from importlib import resources
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gough_stewart.fmu_build.toolchain import native
from gough_stewart.harness.prebuilt import numbers, write_prebuilt
from gough_stewart.model import kernel
from gough_stewart.model.kernel import FUNCTIONS, PREFIX, Kernel, Linearisation, kernel_library, processor_level
from gough_stewart.model.process import installed
from gough_stewart.model.process.installed import MANIFEST, state_of_texts
from tests.support.uneven import UNEVEN


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of prebuilt files, with the kernel for this machine."""
    folder = tmp_path_factory.mktemp("prebuilt")
    write_prebuilt(folder, [native()], only_kernel=True)
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A copy of it, which the package takes for its own."""
    monkeypatch.setattr(installed, "PREBUILT", tmp_path)
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    forget()
    yield tmp_path
    forget()


def forget() -> None:
    """What this process has loaded."""
    for cached in (installed._manifest, kernel_library):
        cached.cache_clear()


def change(folder: Path, **changes: Any) -> None:
    """The manifest, with other numbers, or with other entries of its one file."""
    manifest = json.loads((folder / MANIFEST).read_text())
    manifest["numbers"] = changes.pop("numbers", manifest["numbers"])
    ((name, line),) = manifest["files"].items()
    manifest["files"][name] = {**line, **changes}
    (folder / MANIFEST).write_text(json.dumps(manifest))
    forget()


@pytest.mark.usefixtures("folder")
def test_it_evaluates_as_casadi(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: CasADi's interpreter of the same equations, but for reciprocals and the Jacobians' columns.

    Then the numbers with which the library was shipped, from a Kernel that cannot call CasADi.
    """
    rng, library = np.random.default_rng(8), kernel_library()
    assert library is not None
    for _ in range(40):
        (block, ours), (_, theirs) = kernel.new_block(), kernel.new_block()
        ours["x"][:6] = np.concatenate([UNEVEN.home_position, UNEVEN.home_orientation])
        ours["x"] += 0.1 * rng.normal(size=12)
        ours["u"][:], ours["p"][:] = 50 * rng.normal(size=12), kernel.parameter_vector(UNEVEN)
        for part in "xup":
            theirs[part][:] = ours[part]
        for name in FUNCTIONS:
            getattr(library, PREFIX + name)(kernel.address_of(block))
            kernel.traced_call(name, theirs)()
        for name, values in theirs.items():
            np.testing.assert_allclose(ours[name], values, rtol=0, atol=1e-13 * np.abs(values).max(), err_msg=name)
    shipped = {name: np.array(values) for name, values in numbers().items()}
    monkeypatch.setattr("gough_stewart.model.kernel.traced_call", None)
    taken, point = Kernel(), [shipped[name] for name in "xup"]
    found = {"xdot": taken.derivatives(*point), "y": taken.outputs(*point)}
    found |= dict(zip(Linearisation._fields, taken.jacobians(*point), strict=True))
    for name, values in found.items():
        expected = shipped[name].reshape(values.shape, order="F")
        np.testing.assert_allclose(values, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_a_library_that_differs_from_its_numbers_or_does_not_load_is_named_and_not_used(folder: Path) -> None:
    """Expected: also of a file with the right digest that no system loads."""
    shipped = json.loads((folder / MANIFEST).read_text())["numbers"]
    shipped["y"][20] *= 1 + 1e-6
    change(folder, numbers=shipped)
    with pytest.warns(UserWarning, match=r"kernel\.\w+ differs by .* and CasADi evaluates the equations"):
        assert kernel_library() is None
    (folder / "kernel.other").write_bytes(b"no library")
    change(folder, **installed.manifest_line("kernel.other", b"no library", state_of_texts()))
    with pytest.warns(UserWarning, match=r"kernel\.\w+ does not load here, and CasADi evaluates the equations"):
        assert kernel_library() is None
    assert processor_level() is None


@pytest.mark.usefixtures("folder")
def test_the_level_of_the_processor_is_what_the_system_tells() -> None:
    """Expected: the flags that Linux lists, which leaves out what it has switched off."""
    path = Path("/proc/cpuinfo")
    if not path.exists() or not native().name.startswith("x86_64"):
        pytest.skip("Linux on x86-64 lists the flags")
    flags = set(next(line for line in path.read_text().splitlines() if line.startswith("flags")).split())
    needs = (
        {"cx16", "lahf_lm", "popcnt", "pni", "sse4_1", "sse4_2", "ssse3"},
        {"avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe", "xsave"},
        {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"},
    )
    expected = 1
    while expected < 4 and needs[expected - 1] <= flags:
        expected += 1
    assert processor_level() == expected


def test_an_interrupted_build_leaves_nothing_that_is_used(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: files of before are gone with their manifest, and the new one has not come."""

    def interrupted() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("gough_stewart.harness.prebuilt.numbers", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_prebuilt(folder, [native()], only_kernel=True)
    assert not (folder / MANIFEST).exists()


def test_a_library_counts_only_for_its_sources(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: none with the digest of other sources; among them are those of the stepper in C."""
    assert kernel_library() is not None
    state = state_of_texts()
    change(folder, state="0" * 64)
    assert kernel_library() is None
    copy = folder / "sources"
    for room in ("fmu_build", "model"):
        shutil.copytree(str(files(f"gough_stewart.{room}")), copy / room)
    monkeypatch.setattr(resources, "files", lambda package: copy / package.rpartition(".")[2])
    states = {state}
    for source in ("c/stepper/stepper.c", "c/plant/step.c", "c/unit/component.c", "codegen.py", "plant/layout.py"):
        path = copy / "fmu_build" / source
        path.write_text(f"{path.read_text()}\n")
        state_of_texts.cache_clear()
        states.add(state_of_texts())
    state_of_texts.cache_clear()
    assert len(states) == 6


def test_the_command_prints_one_path_that_is_kept() -> None:
    """Expected: the same file twice, with the stepper of a variant."""
    command = [sys.executable, "-m", "gough_stewart.fmu_build.kernel_library", "bristles"]
    paths = {subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip() for _ in range(2)}
    (path,) = paths
    assert hasattr(PyDLL(path), "stepper_step")
