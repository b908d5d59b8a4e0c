"""Libraries: one for each thing on which bytes depend, what a processor takes of a package, and by which compiler.

Machine code of the package is bytes here, and the compiler is a function.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from gough_stewart import GoughStewartError
from gough_stewart.fmu_build import libraries, toolchain
from gough_stewart.fmu_build.component import Sources
from gough_stewart.fmu_build.libraries import (
    LanesLibrary,
    Library,
    flags_by_level,
    lanes_code,
    machine_code,
    vector_library,
)
from gough_stewart.fmu_build.toolchain import BY_NAME, FLAGS, WEB_ASSEMBLY, Compiler, compiler_of, native, zig
from gough_stewart.model.interface import Variant

LINUX, WINDOWS = BY_NAME["x86_64-linux"], BY_NAME["x86_64-windows"]
Carried = Callable[[int | None, dict[str, bytes]], LanesLibrary]


@pytest.fixture
def compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of what is compiled, in an empty cache."""
    names: list[str] = []

    def compile_library(name: str, *_arguments: object, **_options: object) -> bytes:
        names.append(name)
        return b"compiled"

    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(libraries, "compile_library", compile_library)
    return names


def test_a_library_is_compiled_again_if_anything_differs_on_which_its_bytes_depend(compiled: list[str]) -> None:
    """Expected: one file for equal descriptions, and another for each change of one thing."""
    library, first, second = Library("one", lambda: Sources({}, {}), "state"), Compiler((), "a"), Compiler((), "b")
    path = library.kept(LINUX, compiler=first)
    assert library.kept(LINUX, compiler=first) == path
    assert compiled == ["one"]
    others = [
        replace(library, name="other").kept(LINUX, compiler=first),
        replace(library, state="other").kept(LINUX, compiler=first),
        replace(library, flags=(*library.flags, "-O0")).kept(LINUX, compiler=first),
        library.kept(BY_NAME["aarch64-linux"], compiler=first),
        library.kept(WEB_ASSEMBLY, compiler=first),
        library.kept(LINUX, compiler=second),
        library.kept(LINUX, compiler=first, processor="this"),
    ]
    assert len({path, *others}) == len(compiled) == 8
    variants = (Variant(bristles, springs) for bristles in (False, True) for springs in (False, True))
    names = [lanes_code(variant).name for variant in variants]
    assert names == ["lanes", "lanes-springs", "lanes-bristles", "lanes-bristles-springs"]


# --- machine code that came with the package -------------------------------------------------------------------------


@pytest.fixture
def found(compiled: list[str], monkeypatch: pytest.MonkeyPatch) -> Carried:
    """The library that a processor of some level takes from a manifest; compiled, if that has none."""
    assert compiled == []
    monkeypatch.setattr(libraries, "native", lambda: LINUX)
    monkeypatch.setattr(libraries, "_loads", lambda path: path.read_bytes() != b"broken")

    def take(level: int | None, files: dict[str, bytes]) -> LanesLibrary:
        library = vector_library("loop", lambda: Sources({}, {}), "own")
        carried = {(f"x86_64-linux/{name}", library.state): content for name, content in files.items()}
        monkeypatch.setattr(libraries, "processor_level", lambda: level)
        monkeypatch.setattr(libraries, "prebuilt_content", lambda name, state: carried.get((name, state)))
        return machine_code(library)

    return take


def test_a_processor_takes_the_highest_level_that_it_has_and_that_loads(found: Carried) -> None:
    """Expected: by hand; with AVX2 only, or without it, never the code for AVX-512."""
    both = {"loop-v3": b"level3", "loop-v4": b"level4"}
    for level, files, expected in (
        *((4, both, b"level4"), (3, both, b"level3"), (2, both, b"compiled"), (None, both, b"compiled")),
        (4, {**both, "loop": b"here"}, b"here"),  # of a wheel that was made for this processor
        (4, {**both, "loop-v4": b"broken"}, b"level3"),
        (4, {"loop-v4": b"broken"}, b"compiled"),
    ):
        library = found(level, files)
        assert library.path.read_bytes() == expected, (level, files)
        assert ("x86-64-v" in library.features) == expected.startswith(b"level")


def test_every_target_has_code_for_its_processors() -> None:
    """Expected: AVX2 on x86-64, and AVX-512 on Linux; one kind elsewhere, for any processor of it."""
    levels = {"x86_64-linux": [3, 4], "x86_64-windows": [3], "x86_64-darwin": [3]}
    assert {name: [*flags_by_level(target)] for name, target in BY_NAME.items()} == {
        **levels,
        **{"aarch64-linux": [0], "aarch64-darwin": [0]},
    }
    assert [flags[0] for flags in flags_by_level(LINUX).values()] == ["-mcpu=x86_64_v3", "-mcpu=x86_64_v4"]
    assert not any("-mcpu=native" in flags for target in BY_NAME.values() for flags in flags_by_level(target).values())


# --- compilers -------------------------------------------------------------------------------------------------------


def test_the_order_of_compilers_is_cc_zig_and_the_systems(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: of programs on an otherwise empty PATH."""

    def program(name: str) -> str:
        (tmp_path / name).write_text("#!/bin/sh\n")
        (tmp_path / name).chmod(0o755)
        return str(tmp_path / name)

    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(toolchain, "find_spec", lambda _name: None)
    clang, gcc, cc, mine = map(program, ("clang", "gcc", "cc", "mine"))
    monkeypatch.setenv("CC", "mine -m64 '-DA=b c'")
    assert compiler_of(native()).command == (mine, "-m64", "-DA=b c")
    monkeypatch.setenv("CC", "")
    for expected in (cc, gcc, clang):
        assert compiler_of(native()).command == (expected,)
        Path(expected).unlink()
    with pytest.raises(
        GoughStewartError, match=r"^no C compiler for \S+ was found \(CC, zig, cc, .*gough-stewart\[compile\]"
    ):
        compiler_of(native())
    program("cc")
    monkeypatch.setattr(toolchain, "find_spec", lambda _name: object())
    assert compiler_of(native()) == zig()


def test_msvc_has_options_of_its_own() -> None:
    """Expected: by Microsoft's manual: a library, C11, no contraction of floating-point operations."""
    (command,) = Compiler((r"cl.exe",), "").commands("unit.dll", ["a.c"], "include", WINDOWS, FLAGS)
    options = ["/nologo", "/LD", "/O2", "/std:c11", "/fp:precise", "/MT"]
    assert command == ["cl.exe", *options, "/I", "include", "a.c", "/Fe:unit.dll"]


def test_only_files_are_compiled_for_a_processor_of_windows() -> None:
    """Expected: by hand; the library is linked as for any processor, from all objects."""
    flags, compiler = ("-mcpu=x86_64_v3", "-O3", "-shared", "-s"), Compiler(("zig",), "", is_zig=True)
    first, second, last = compiler.commands("u.dll", ["a.c", "b.c"], "h", WINDOWS, flags)
    aim = ["zig", "-target", WINDOWS.triple]
    assert first == [*aim, "-mcpu=x86_64_v3", "-O3", "-I", "h", "-c", "a.c", "-o", "0.obj"]
    assert second == [*aim, "-mcpu=x86_64_v3", "-O3", "-I", "h", "-c", "b.c", "-o", "1.obj"]
    assert last == [*aim, "-O3", "-shared", "-s", "-I", "h", "0.obj", "1.obj", "-o", "u.dll", "-lm"]
    assert len(compiler.commands("u.dll", ["a.c", "b.c"], "h", WINDOWS, flags[1:])) == 1
