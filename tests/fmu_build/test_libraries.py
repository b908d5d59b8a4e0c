"""Libraries: one for each thing on which bytes depend, what a processor takes of a package, and by which compiler."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from gough_stewart import GoughStewartError
from gough_stewart.fmu_build import libraries, toolchain
from gough_stewart.fmu_build.component import Sources
from gough_stewart.fmu_build.libraries import machine_code, vector_library
from gough_stewart.fmu_build.toolchain import BY_NAME, FLAGS, WEB_ASSEMBLY, Compiler, Library, compiler_of, native, zig
from gough_stewart.model.process.installed import CarriedFile

LINUX, WINDOWS = BY_NAME["x86_64-linux"], BY_NAME["x86_64-windows"]


@pytest.fixture
def compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of what is compiled, in an empty cache."""
    names: list[str] = []

    def compile_library(name: str, *_arguments: object, **_options: object) -> bytes:
        names.append(name)
        return b"compiled"

    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(toolchain, "compile_library", compile_library)
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


BOTH = {"loop-v3": b"level3", "loop-v4": b"level4"}


@pytest.mark.usefixtures("compiled")
@pytest.mark.parametrize(
    ("level", "carried", "expected"),
    [
        *((4, BOTH, b"level4"), (3, BOTH, b"level3"), (2, BOTH, b"compiled"), (None, BOTH, b"compiled")),
        (4, {**BOTH, "loop": b"here"}, b"here"),  # of a wheel that was made for this processor
        (4, {**BOTH, "loop-v4": b"broken"}, b"level3"),
        (4, {"loop-v4": b"broken"}, b"compiled"),
    ],
)
def test_a_processor_takes_the_highest_level_that_it_has_and_that_loads(
    level: int | None, carried: dict[str, bytes], expected: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: by hand; with AVX2 only, or without it, never the code for AVX-512."""
    library = vector_library("loop", lambda: Sources({}, {}), "own")
    by_name = {
        (f"x86_64-linux/{name}", library.state): CarriedFile(Path(name), content) for name, content in carried.items()
    }
    monkeypatch.setattr(libraries, "native", lambda: LINUX)
    monkeypatch.setattr(libraries, "_loads", lambda path: path.read_bytes() != b"broken")
    kernel = None if level is None else SimpleNamespace(processor_level=lambda: level)
    monkeypatch.setattr(libraries, "kernel_library", lambda: kernel)
    monkeypatch.setattr(libraries, "prebuilt", lambda name, state: by_name.get((name, state)))
    code = machine_code(library)
    assert code.path.read_bytes() == expected
    assert ("x86-64-v" in code.features) == expected.startswith(b"level")


def test_the_order_of_compilers_is_cc_zig_and_the_systems(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: of programs on an otherwise empty PATH; options of MSVC by its manual, and of Windows by hand."""

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
    (command,) = Compiler((r"cl.exe",), "").commands("unit.dll", ["a.c"], "include", WINDOWS, FLAGS)
    options = ["/nologo", "/LD", "/O2", "/std:c11", "/fp:precise", "/MT"]
    assert command == ["cl.exe", *options, "/I", "include", "a.c", "/Fe:unit.dll"]
    flags, compiler = ("-mcpu=x86_64_v3", "-O3", "-shared", "-s"), Compiler(("zig",), "", is_zig=True)
    *objects, last = compiler.commands("u.dll", ["a.c", "b.c"], "h", WINDOWS, flags)
    aim = ["zig", "-target", WINDOWS.triple]
    assert objects == [
        [*aim, "-mcpu=x86_64_v3", "-O3", "-I", "h", "-c", f"{name}.c", "-o", f"{k}.obj"] for k, name in enumerate("ab")
    ]
    stripped = ["-s" in Compiler(("cc",), "").commands("u", [], "h", each, FLAGS)[0] for each in BY_NAME.values()]
    assert stripped == [True, True, True, False, False]
    assert [[*libraries.flags_by_level(target)] for target in BY_NAME.values()] == [
        ["-v3", "-v4"],
        [""],
        ["-v3"],
        ["-v3"],
        [""],
    ]
    assert last == [*aim, "-O3", "-shared", "-s", "-I", "h", "0.obj", "1.obj", "-o", "u.dll", "-lm"]
