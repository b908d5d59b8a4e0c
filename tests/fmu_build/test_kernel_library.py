"""The kernel as machine code, against CasADi's evaluation of the same traced functions."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from gough_stewart.fmu_build.targets import native
from gough_stewart.harness.prebuilt import numbers, write_prebuilt
from gough_stewart.model.compiled_kernel import PREFIX, address_of, kernel_library, processor_level
from gough_stewart.model.kernel import Kernel, Linearisation, parameter_vector, traced_call
from gough_stewart.model.kernel_block import BLOCK, FUNCTIONS, new_block
from gough_stewart.model.process import prebuilt
from gough_stewart.model.process.prebuilt import MANIFEST
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
    monkeypatch.setattr(prebuilt, "prebuilt_folder", lambda: tmp_path)
    for path in (path for path in made.rglob("*") if path.is_file()):
        (tmp_path / path.relative_to(made)).parent.mkdir(exist_ok=True)
        (tmp_path / path.relative_to(made)).write_bytes(path.read_bytes())
    for cached in (prebuilt._manifest, kernel_library):
        cached.cache_clear()
    yield tmp_path
    for cached in (prebuilt._manifest, kernel_library):
        cached.cache_clear()


@pytest.mark.usefixtures("folder")
def test_it_has_the_bits_of_casadi() -> None:
    """Expected: CasADi's interpreter of the same operations; the Jacobians' columns are operations of their own."""
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
        for name in BLOCK:
            tolerance = 1e-13 * np.abs(theirs[name]).max() if name in "ABCD" else 0
            np.testing.assert_allclose(ours[name], theirs[name], rtol=0, atol=tolerance, err_msg=name)


@pytest.mark.usefixtures("folder")
def test_a_kernel_takes_it_and_needs_no_casadi(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: CasADi's numbers, with which the library was shipped, from a Kernel that cannot call CasADi."""
    shipped = numbers()
    monkeypatch.setattr("gough_stewart.model.kernel.traced_call", None)
    kernel, (x, u, p) = Kernel(), (np.array(shipped[name]) for name in "xup")
    assert kernel.derivatives(x, u, p).tolist() == shipped["xdot"]
    assert kernel.outputs(x, u, p).tolist() == shipped["y"]
    square, determinant, size = kernel.margins(x, p)
    assert [square.tolist(), [determinant], [size]] == [shipped[name] for name in ("square", "determinant", "size")]
    found = kernel.jacobians(x, u, p)
    for name, matrix in zip(Linearisation._fields, found, strict=True):
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
    manifest["files"][name] = prebuilt.manifest_line(line["file"], b"no library", line["state"])
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
