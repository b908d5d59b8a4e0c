"""Caches that are damaged heal; a full disk and a fault of the sources are said in the compiler's words."""

import shutil
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from hashlib import sha256
from pathlib import Path
from threading import Event
from typing import IO, Any, NamedTuple

import pytest

from gough_stewart.fmu_build import cache as cache_files
from gough_stewart.fmu_build import cached, targets, toolchain
from gough_stewart.fmu_build import libraries as lanes
from gough_stewart.fmu_build.build import build, build_units
from gough_stewart.fmu_build.cache import kept
from gough_stewart.fmu_build.cached import cached_build
from gough_stewart.fmu_build.errors import BuildError
from gough_stewart.fmu_build.sources import start_block
from gough_stewart.fmu_build.toolchain import compile_library
from tests.fmu_build.test_small_component import SMALL

OBJECT = "o/0123/kernel.o"
LINKER = "ld.lld: error: o/0123/kernel.o: section header table goes past the end of the file"


class Usage(NamedTuple):
    """As `shutil.disk_usage` answers."""

    total: int
    used: int
    free: int


class Compiler:
    """In the place of the compiler: links the object in its cache, which it makes if there is none."""

    def __init__(self, refuses: Callable[[bytes], str | None] = lambda _content: None) -> None:
        self.refuses = refuses
        self.runs = 0

    def __call__(self, command: Sequence[str], _folder: str, _stop: Event, _in_use: IO[str]) -> tuple[int, str]:
        self.runs += 1
        kernel = toolchain.object_cache() / OBJECT
        if not kernel.exists():
            kernel.parent.mkdir(parents=True)
            kernel.write_bytes(b"right")
        words = self.refuses(kernel.read_bytes())
        if words is not None:
            return 1, words
        Path(command[command.index("-o") + 1]).write_bytes(b"linked " + kernel.read_bytes())
        return 0, ""


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the objects, empty, as a new process finds it."""
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(tmp_path))
    return toolchain.object_cache()


def compiled(monkeypatch: pytest.MonkeyPatch, compiler: Compiler) -> bytes:
    monkeypatch.setattr(toolchain, "_run", compiler)
    return compile_library("unit", {"kernel.c": "int x;"}, {"kernel.h": ""}, targets.native())


@pytest.mark.skipif(sys.platform == "win32", reason="there is no lock")
def test_a_cache_is_not_emptied_while_a_compiler_works_in_it(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: who stumbles waits; a compiler whose cache disappears never ends."""
    (cache / OBJECT).parent.mkdir(parents=True)
    (cache / OBJECT).write_bytes(b"cut")
    with ThreadPoolExecutor() as pool:
        with toolchain.compiling():
            other = pool.submit(compiled, monkeypatch, Compiler(lambda content: LINKER if content == b"cut" else None))
            assert wait([other], 0.3).not_done
            assert (cache / OBJECT).read_bytes() == b"cut"
        assert other.result(10) == b"linked right"


def test_a_cache_that_the_compiler_stumbles_over_is_made_anew(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: a second run in an empty cache, as often as it is damaged; what lies beside it stays."""
    beside = cache.parent / "fmus"
    beside.mkdir(parents=True)
    for _ in range(2):
        (cache / OBJECT).parent.mkdir(parents=True, exist_ok=True)
        (cache / OBJECT).write_bytes(b"cut")
        compiler = Compiler(lambda content: LINKER if content == b"cut" else None)
        assert compiled(monkeypatch, compiler) == b"linked right"
        assert compiler.runs == 2
        assert beside.exists()


@pytest.mark.skipif(sys.platform == "win32", reason="links need a right there")
def test_a_linked_cache_loses_its_link_and_nothing_behind_it(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = tmp_path / "elsewhere"
    (elsewhere / OBJECT).parent.mkdir(parents=True)
    (elsewhere / OBJECT).write_bytes(b"cut")
    cache.parent.mkdir(parents=True)
    cache.symlink_to(elsewhere)
    assert compiled(monkeypatch, Compiler(lambda content: LINKER if content == b"cut" else None)) == b"linked right"
    assert not cache.is_symlink()
    assert (elsewhere / OBJECT).read_bytes() == b"cut"


def test_each_version_of_zig_has_a_cache(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: what another version has left is neither used nor removed."""
    compiled(monkeypatch, Compiler())
    monkeypatch.setattr(toolchain, "version", lambda _package: "99.1")
    other = Compiler(lambda _content: LINKER)
    with pytest.raises(BuildError):
        compiled(monkeypatch, other)
    assert toolchain.object_cache() == cache.parent / "zig-99.1"
    assert (cache / OBJECT).read_bytes() == b"right"


def test_a_cache_that_does_not_heal_is_named(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler = Compiler(lambda _content: LINKER)
    with pytest.raises(BuildError) as caught:
        compiled(monkeypatch, compiler)
    assert LINKER in str(caught.value)
    assert f"delete the folder {cache.parent}" in str(caught.value)
    assert compiler.runs == 2


def test_a_cache_that_is_a_file_is_made_anew(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache.parent.mkdir(parents=True)
    cache.write_text("")

    def stumble(_command: Sequence[str], _folder: str, _stop: Event, _in_use: IO[str]) -> tuple[int, str]:
        return (1, f'error: failed to create output directory "{cache}": NotDir') if cache.is_file() else sound()

    def sound() -> tuple[int, str]:
        return 1, "now it is a folder's turn"

    monkeypatch.setattr(toolchain, "_run", stumble)
    with pytest.raises(BuildError, match="now it is a folder's turn"):
        compile_library("unit", {"kernel.c": "int x;"}, {}, targets.native())


def test_a_fault_of_the_sources_is_shown_and_leaves_the_cache(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = f"{cache.parent}/4711/kernel.c:3:7: error: expected ';' after top level declarator"
    compiler = Compiler(lambda _content: words)
    with pytest.raises(BuildError) as caught:
        compiled(monkeypatch, compiler)
    assert str(caught.value).endswith(words)
    assert compiler.runs == 1
    assert (cache / OBJECT).exists()


@pytest.mark.parametrize("words", ["", "ld.lld: error: failed to write output: No space left on device"])
def test_a_full_temporary_folder_is_named_with_the_compilers_words(
    words: str, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: the linker aborts without a word where its output does not fit; the cache is not to blame."""
    compiler = Compiler(lambda _content: words)
    monkeypatch.setattr(shutil, "disk_usage", lambda _folder: Usage(64_000, 0, 64_000))
    with pytest.raises(BuildError) as caught:
        compiled(monkeypatch, compiler)
    assert (words or "exit code 1 without a message") in str(caught.value)
    assert "Only 0.064 MB are free" in str(caught.value)
    assert "set TMPDIR" in str(caught.value)
    assert compiler.runs == 1
    assert (cache / OBJECT).exists()


# --- finished files --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("damaged", [0, -1])
def test_a_library_with_a_flipped_bit_is_compiled_anew(
    damaged: int, cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: the bytes that the compiler wrote, in both units; a sound library is taken as it is."""
    compiled_for: list[str] = []

    def quick(_name: str, _units: object, _headers: object, target: targets.Target, *_a: Any, **_k: Any) -> bytes:
        compiled_for.append(target.name)
        return b"before " + start_block(SMALL, None) + b" after"

    monkeypatch.setattr(lanes, "compile_library", quick)
    first = [path.read_bytes() for path in build_units(SMALL, tmp_path / "first")]
    assert len(compiled_for) == 1
    (library,) = (cache.parent / SMALL.identifier).rglob(f"*{targets.native().suffix}")
    content = bytearray(library.read_bytes())
    content[damaged] ^= 1
    library.write_bytes(content)
    assert [path.read_bytes() for path in build_units(SMALL, tmp_path / "second")] == first
    assert len(compiled_for) == 2


@pytest.fixture
def builds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A cache of units of its own; what is built for it, which takes no compiler."""
    made: list[str] = []

    def quick(folder: Path, fmi: list[str], **_: Any) -> list[Path]:
        made.append(fmi[0])
        path = Path(folder, f"gough_stewart_fmi{fmi[0][0]}.fmu")
        path.write_bytes(b"a unit")
        return [path]

    monkeypatch.setattr(cached, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(f"{build.__module__}.build", quick)
    return made


@pytest.mark.parametrize("content", [b"", b"a umit", b"a uni"])
def test_a_damaged_unit_is_built_anew(builds: list[str], content: bytes) -> None:
    path = cached_build("3.0")
    path.write_bytes(content)
    assert cached_build("3.0") == path
    assert path.read_bytes() == b"a unit"
    assert cached_build("3.0") == path
    assert builds == ["3.0", "3.0"]


def test_a_unit_without_its_digest_is_built_anew(builds: list[str]) -> None:
    path = cached_build("2.0")
    path.with_name(f"{path.name}.sha256").unlink()
    cached_build("2.0")
    assert builds == ["2.0", "2.0"]
    assert path.with_name(f"{path.name}.sha256").read_text() == sha256(b"a unit").hexdigest()


def test_units_of_two_systems_lie_apart(builds: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: a home on a network that machines of two kinds share."""
    paths = set()
    for name in ("x86_64-linux", "aarch64-linux"):
        monkeypatch.setattr(cached, "native", lambda name=name: targets.BY_NAME[name])
        paths.add(cached_build("2.0"))
    assert len(paths) == 2
    assert len(builds) == 2


def test_a_disk_that_does_not_keep_a_unit_is_an_error_that_names_the_folder(
    builds: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def forget(path: Path, content: bytes) -> None:
        path.write_bytes(content[:3])

    monkeypatch.setattr(cache_files, "write_whole", forget)
    with pytest.raises(BuildError, match="delete the folder") as caught:
        cached_build("2.0")
    assert str(tmp_path) in str(caught.value)
    assert builds == ["2.0"]


def test_a_cache_that_cannot_be_written_is_named_with_a_remedy(tmp_path: Path) -> None:
    """Expected: where a file is in the place of its folder, which keeps even root from writing there."""
    (tmp_path / "cache").write_text("a file")
    with pytest.raises(OSError, match="set XDG_CACHE_HOME to a writable folder") as found:
        kept(tmp_path / "cache" / "fmus" / "unit.fmu", lambda: b"unit")
    assert found.value.filename == str(tmp_path / "cache" / "fmus")
