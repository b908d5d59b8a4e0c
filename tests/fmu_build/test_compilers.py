"""Which compiler makes a unit, and how it is called."""

from pathlib import Path

import pytest

from gough_stewart.fmu_build import toolchain as compilers
from gough_stewart.fmu_build.cache import BuildError
from gough_stewart.fmu_build.toolchain import BY_NAME, FLAGS, Compiler, compiler_of, native, zig

OTHER = next(target for target in BY_NAME.values() if target != native())


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty PATH, and no zig."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(compilers, "find_spec", lambda _name: None)
    return tmp_path


def program(folder: Path, name: str) -> str:
    """An empty program there."""
    file = folder / name
    file.write_text("#!/bin/sh\n")
    file.chmod(0o755)
    return str(file)


def test_the_order_is_cc_zig_and_the_systems(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clang, gcc, cc = (program(path, name) for name in ("clang", "gcc", "cc"))
    own = program(path, "mine")
    monkeypatch.setenv("CC", "mine -m64 '-DA=b c'")
    assert compiler_of(native()).command == (own, "-m64", "-DA=b c")
    monkeypatch.setenv("CC", "")
    for expected in (cc, gcc, clang):
        assert compiler_of(native()).command == (expected,)
        Path(expected).unlink()
    with pytest.raises(BuildError, match=r"^no C compiler for \S+ was found \(CC, zig, cc, .*gough-stewart\[compile\]"):
        compiler_of(native())
    program(path, "cc")
    monkeypatch.setattr(compilers, "find_spec", lambda _name: object())
    assert compiler_of(native()) == zig()


def test_msvc_has_options_of_its_own() -> None:
    """Expected: by Microsoft's manual: a library, C11, no contraction of floating-point operations."""
    (command,) = Compiler((r"cl.exe",), "").commands("unit.dll", ["a.c"], "include", BY_NAME["x86_64-windows"], FLAGS)
    options = ["/nologo", "/LD", "/O2", "/std:c11", "/fp:precise", "/MT"]
    assert command == ["cl.exe", *options, "/I", "include", "a.c", "/Fe:unit.dll"]


def test_only_files_are_compiled_for_a_processor_of_windows() -> None:
    """Expected: by hand; the library is linked as for any processor, from all objects."""
    target, flags = BY_NAME["x86_64-windows"], ("-mcpu=x86_64_v3", "-O3", "-shared", "-s")
    first, second, last = Compiler(("zig",), "", is_zig=True).commands("u.dll", ["a.c", "b.c"], "h", target, flags)
    aim = ["zig", "-target", target.triple]
    assert first == [*aim, "-mcpu=x86_64_v3", "-O3", "-I", "h", "-c", "a.c", "-o", "0.obj"]
    assert second == [*aim, "-mcpu=x86_64_v3", "-O3", "-I", "h", "-c", "b.c", "-o", "1.obj"]
    assert last == [*aim, "-O3", "-shared", "-s", "-I", "h", "0.obj", "1.obj", "-o", "u.dll", "-lm"]
    assert len(Compiler(("zig",), "", is_zig=True).commands("u.dll", ["a.c", "b.c"], "h", target, flags[1:])) == 1
