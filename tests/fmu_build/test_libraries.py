"""What is built is kept once for each thing on which its bytes depend, and found again."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from gough_stewart.fmu_build import codegen, libraries
from gough_stewart.fmu_build.cached import platform_of
from gough_stewart.fmu_build.component import Sources
from gough_stewart.fmu_build.libraries import Library
from gough_stewart.fmu_build.plant import component
from gough_stewart.fmu_build.toolchain import BY_NAME, WEB_ASSEMBLY, Compiler
from gough_stewart.model.interface import IDEAL, Variant

STICKING = Variant(bristles=True)


@pytest.fixture(autouse=True)
def fresh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """An empty cache, for this process too."""
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(tmp_path))
    for function in (component._code, component.slot_dependencies):
        function.cache_clear()
    yield
    for function in (component._code, component.slot_dependencies):
        function.cache_clear()


def test_a_library_is_compiled_again_if_anything_differs_on_which_its_bytes_depend(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Expected: one file for equal descriptions, and another for each change of one thing."""
    compiled: list[str] = []

    def compile_library(name: str, *_arguments: object, **_options: object) -> bytes:
        compiled.append(name)
        return b"machine code"

    monkeypatch.setattr(libraries, "compile_library", compile_library)
    library, target, compiler = (
        Library("one", lambda: Sources({}, {}), "state"),
        BY_NAME["x86_64-linux"],
        Compiler((), "a"),
    )
    first = library.kept(target, compiler=compiler)
    assert library.kept(target, compiler=compiler) == first
    assert compiled == ["one"]
    others = [
        replace(library, name="other").kept(target, compiler=compiler),
        replace(library, state="other").kept(target, compiler=compiler),
        replace(library, flags=(*library.flags, "-O0")).kept(target, compiler=compiler),
        library.kept(BY_NAME["aarch64-linux"], compiler=compiler),
        library.kept(WEB_ASSEMBLY, compiler=compiler),
        library.kept(target, compiler=Compiler((), "b")),
        library.kept(target, compiler=compiler, processor="this"),
    ]
    assert len({first, *others}) == 1 + len(others)
    assert len(compiled) == 1 + len(others)


def test_each_variant_has_a_library_of_its_own() -> None:
    """Expected: names by hand, under which the files are kept and carried."""
    variants = (Variant(bristles, springs) for bristles in (False, True) for springs in (False, True))
    names = [libraries.lanes_code(variant).name for variant in variants]
    assert names == ["lanes", "lanes-springs", "lanes-bristles", "lanes-bristles-springs"]


def test_each_variants_equations_are_traced_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: what was traced, where nothing can be traced any more; only bristles have a decay."""
    variants = (IDEAL, STICKING)
    codes = [component.plant_component(platform_of(variant)).code for variant in variants]
    dependencies = [component.slot_dependencies(variant) for variant in variants]
    assert ["void kernel_decays(" in code.units["kernel.c"] for code in codes] == [False, True]
    assert [len(table) for table in dependencies] == [62, 74]

    def refuse(*_arguments: object) -> str:
        raise AssertionError("traced again")

    for function in (component._code, component.slot_dependencies):
        function.cache_clear()
    monkeypatch.setattr(codegen, "kernel_source", refuse)
    monkeypatch.setattr(component, "traced_dependencies", refuse)
    assert [component.plant_component(platform_of(variant)).code for variant in variants] == codes
    assert [component.slot_dependencies(variant) for variant in variants] == dependencies
