"""Code that came with the package: it counts for its sources only, bit by bit, and if it computes what it should."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from ctypes import PyDLL, c_void_p
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gough_stewart.fmu_build.toolchain import native
from gough_stewart.harness.prebuilt import write_prebuilt
from gough_stewart.model import kernel
from gough_stewart.model.kernel import FUNCTIONS, PREFIX, kernel_library
from gough_stewart.model.process import installed
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
    for cached in (installed.manifest, kernel_library):
        cached.cache_clear()


@pytest.mark.usefixtures("folder")
def test_it_evaluates_as_casadi() -> None:
    """Expected: CasADi's interpreter, but for reciprocals and Jacobians' columns; the level by Linux's flags."""
    rng, library = np.random.default_rng(8), kernel_library()
    assert library is not None
    for _ in range(20):
        (block, ours), (_, theirs) = kernel.new_block(), kernel.new_block()
        ours["x"][:6] = np.concatenate([UNEVEN.home_position, UNEVEN.home_orientation])
        ours["x"] += 0.1 * rng.normal(size=12)
        ours["u"][:], ours["p"][:] = 50 * rng.normal(size=12), kernel.parameter_vector(UNEVEN)
        for part in "xup":
            theirs[part][:] = ours[part]
        for name in FUNCTIONS:
            getattr(library, PREFIX + name)(block.ctypes.data_as(c_void_p))
            kernel.traced_call(name, theirs)()
        for name, values in theirs.items():
            np.testing.assert_allclose(ours[name], values, rtol=0, atol=1e-13 * np.abs(values).max(), err_msg=name)
    path = Path("/proc/cpuinfo")
    if path.exists() and native().name.startswith("x86_64"):
        flags = set(next(line for line in path.read_text().splitlines() if line.startswith("flags")).split())
        needs = (
            {"cx16", "lahf_lm", "popcnt", "pni", "sse4_1", "sse4_2", "ssse3"},
            {"avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe", "xsave"},
            {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"},
        )
        assert library.processor_level() == 1 + next((k for k in range(3) if not needs[k] <= flags), 3)


def _other_number(_folder: Path, manifest: dict[str, Any]) -> None:
    manifest["numbers"]["y"][20] *= 1 + 1e-6


def _no_library(folder: Path, manifest: dict[str, Any]) -> None:
    ((name, line),) = manifest["files"].items()
    (folder / "kernel.other").write_bytes(b"no library")
    manifest["files"][name] = installed.manifest_line("kernel.other", b"no library", line["state"])


def _file_of(manifest: dict[str, Any]) -> str:
    (line,) = manifest["files"].values()
    return str(line["file"])


# What is done to the files or the manifest, and the warning; none where the code is of other sources, or not whole.
DAMAGES: dict[str, tuple[Callable[[Path, dict[str, Any]], object], str]] = {
    "other numbers": (_other_number, r"kernel\.\w+ differs by .* and CasADi evaluates the equations"),
    "no library": (_no_library, r"kernel\.\w+ does not load here, and CasADi evaluates the equations"),
    "short": (
        lambda folder, m: (folder / _file_of(m)).write_bytes(b"x"),
        "is damaged and is not used; install",
    ),
    "gone": (lambda folder, m: (folder / _file_of(m)).unlink(), "is damaged and is not used"),
    "other sources": (lambda _, m: next(iter(m["files"].values())).update(state="0" * 64), ""),
    "no manifest": (lambda folder, _: (folder / installed.MANIFEST).unlink(), ""),
}


@pytest.mark.parametrize("case", DAMAGES)
def test_code_that_is_not_what_it_should_be_is_named_and_not_used(case: str, folder: Path) -> None:
    """Expected: a warning, once; none of code of other sources, or after a build that was interrupted."""
    change, warning = DAMAGES[case]
    assert kernel_library() is not None
    manifest = json.loads((folder / installed.MANIFEST).read_text())
    change(folder, manifest)
    if (folder / installed.MANIFEST).exists():
        (folder / installed.MANIFEST).write_text(json.dumps(manifest))
    forget()
    if warning:
        with pytest.warns(UserWarning, match=warning):
            assert kernel_library() is None
    assert kernel_library() is None


def test_the_command_prints_one_path_that_is_kept() -> None:
    """Expected: the same file twice, with the stepper of a variant."""
    command = [sys.executable, "-m", "gough_stewart.fmu_build.libraries", "bristles"]
    paths = {subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip() for _ in range(2)}
    (path,) = paths
    assert hasattr(PyDLL(path), "stepper_step")


def test_without_library_and_compiler_the_error_names_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: the extra that brings a compiler, and the other integrator, which steps."""
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("CC", "nowhere")
    program = """
import gough_stewart as gs
sticking = gs.load_preset("motion_base_screws")
gs.SteppingModel(sticking, integrator="scipy").do_step(0.0, 1e-4)
gs.SteppingModel(sticking)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.stderr.strip().endswith('expected a C compiler, or unset it; or choose integrator="scipy"')
