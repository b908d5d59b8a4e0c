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

import numpy as np
import pytest

from gough_stewart.fmu_build.toolchain import native
from gough_stewart.harness.prebuilt import numbers, write_prebuilt
from gough_stewart.model.kernel import (
    FUNCTIONS,
    PREFIX,
    Kernel,
    Linearisation,
    address_of,
    kernel_library,
    new_block,
    parameter_vector,
    processor_level,
    traced_call,
)
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
    for path in (path for path in made.rglob("*") if path.is_file()):
        (tmp_path / path.relative_to(made)).parent.mkdir(exist_ok=True)
        (tmp_path / path.relative_to(made)).write_bytes(path.read_bytes())
    for cached in (installed._manifest, kernel_library):
        cached.cache_clear()
    yield tmp_path
    for cached in (installed._manifest, kernel_library):
        cached.cache_clear()


@pytest.mark.usefixtures("folder")
def test_it_evaluates_as_casadi() -> None:
    """Expected: CasADi's interpreter of the same equations, but for reciprocals and the Jacobians' columns."""
    rng, library = np.random.default_rng(8), kernel_library()
    assert library is not None
    p = parameter_vector(UNEVEN)
    for _ in range(40):
        (block, ours), (_, theirs) = new_block(), new_block()
        x = np.concatenate([UNEVEN.home_position, UNEVEN.home_orientation, np.zeros(6)])
        for parts in (ours, theirs):
            parts["x"][:], parts["u"][:], parts["p"][:] = x, 0, p
        ours["x"] += 0.1 * rng.normal(size=12)
        ours["u"][:] = 50 * rng.normal(size=12)
        theirs["x"][:], theirs["u"][:] = ours["x"], ours["u"]
        for name in FUNCTIONS:
            getattr(library, PREFIX + name)(address_of(block))
            traced_call(name, theirs)()
        for name, part in theirs.items():
            np.testing.assert_allclose(ours[name], part, rtol=0, atol=1e-13 * np.abs(part).max(), err_msg=name)


@pytest.mark.usefixtures("folder")
def test_a_kernel_takes_it_and_needs_no_casadi(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: CasADi's numbers, with which the library was shipped, from a Kernel that cannot call CasADi."""
    shipped = numbers()
    monkeypatch.setattr("gough_stewart.model.kernel.traced_call", None)
    kernel, (x, u, p) = Kernel(), (np.array(shipped[name]) for name in "xup")
    for found, name in ((kernel.derivatives(x, u, p), "xdot"), (kernel.outputs(x, u, p), "y")):
        np.testing.assert_allclose(found, shipped[name], rtol=0, atol=1e-13 * np.abs(shipped[name]).max())
    for name, matrix in zip(Linearisation._fields, kernel.jacobians(x, u, p), strict=True):
        expected = np.reshape(shipped[name], matrix.shape, order="F")
        np.testing.assert_allclose(matrix, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_a_library_that_differs_from_its_numbers_is_named_and_not_used(folder: Path) -> None:
    manifest = json.loads((folder / MANIFEST).read_text())
    manifest["numbers"]["y"][20] *= 1 + 1e-6
    (folder / MANIFEST).write_text(json.dumps(manifest))
    with pytest.warns(UserWarning, match=r"kernel\.\w+ differs by .* and CasADi evaluates the equations"):
        assert kernel_library() is None


def test_a_library_that_does_not_load_is_named_and_not_used(folder: Path) -> None:
    """Expected: of a file with the right digest that no system loads."""
    manifest = json.loads((folder / MANIFEST).read_text())
    ((name, line),) = manifest["files"].items()
    (folder / line["file"]).write_bytes(b"no library")
    manifest["files"][name] = installed.manifest_line(line["file"], b"no library", line["state"])
    (folder / MANIFEST).write_text(json.dumps(manifest))
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


def test_an_interrupted_build_leaves_nothing_that_is_used(
    tmp_path: Path, made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: files of before are gone with their manifest, and the new one has not come."""
    for path in (path for path in made.rglob("*") if path.is_file()):
        (tmp_path / path.relative_to(made)).parent.mkdir(exist_ok=True)
        (tmp_path / path.relative_to(made)).write_bytes(path.read_bytes())

    def interrupted() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("gough_stewart.harness.prebuilt.numbers", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_prebuilt(tmp_path, [native()], only_kernel=True)
    assert not (tmp_path / MANIFEST).exists()


def test_a_library_counts_only_for_its_sources(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: none with the digest of other sources; among them are those of the stepper in C."""
    assert kernel_library() is not None
    manifest = json.loads((folder / MANIFEST).read_text())
    ((name, line),) = manifest["files"].items()
    assert line["state"] == state_of_texts()
    manifest["files"][name] = {**line, "state": "0" * 64}
    (folder / MANIFEST).write_text(json.dumps(manifest))
    for cached in (installed._manifest, kernel_library):
        cached.cache_clear()
    assert kernel_library() is None
    copy = folder / "sources"
    shutil.copytree(str(files("gough_stewart.fmu_build")), copy / "fmu_build")
    shutil.copytree(str(files("gough_stewart.model")), copy / "model")
    monkeypatch.setattr(resources, "files", lambda package: copy / package.rpartition(".")[2])
    states = set()
    for source in (
        "c/stepper/stepper.c",
        "c/plant/step.c",
        "c/unit/component.c",
        "codegen.py",
        "plant/layout.py",
    ):
        path = copy / "fmu_build" / source
        path.write_text(f"{path.read_text()}\n")
        state_of_texts.cache_clear()
        states.add(state_of_texts())
    state_of_texts.cache_clear()
    assert len(states - {line["state"]}) == 5


def test_the_command_prints_one_path_that_is_kept() -> None:
    """Expected: the same file twice, with the stepper of a variant."""
    command = [sys.executable, "-m", "gough_stewart.fmu_build.kernel_library", "bristles"]
    paths = {subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip() for _ in range(2)}
    (path,) = paths
    assert hasattr(PyDLL(path), "stepper_step")
