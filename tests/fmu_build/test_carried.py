"""Machine code that came with the package: which one a processor takes, and what if it does not load."""

from collections.abc import Callable
from pathlib import Path

import pytest

from gough_stewart.fmu_build import libraries as lanes
from gough_stewart.fmu_build.component import Sources
from gough_stewart.fmu_build.libraries import (
    LanesLibrary,
    carried_name,
    flags_of_level,
    levels_of,
    machine_code,
    vector_library,
)
from gough_stewart.fmu_build.toolchain import BY_NAME, native

LINUX = BY_NAME["x86_64-linux"]
Carried = Callable[[int | None, dict[str, bytes]], LanesLibrary]


@pytest.fixture
def found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Carried:
    """The library that a processor of some level takes from a manifest; compiled, if that has none."""
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(lanes, "native", lambda: LINUX)
    monkeypatch.setattr(lanes, "compile_library", lambda *_, **__: b"compiled")
    monkeypatch.setattr(lanes, "_loads", lambda path: path.read_bytes() != b"broken")

    def take(level: int | None, files: dict[str, bytes]) -> LanesLibrary:
        monkeypatch.setattr(lanes, "processor_level", lambda: level)
        library = vector_library("loop", lambda: Sources({}, {}), "own")
        monkeypatch.setattr(lanes, "prebuilt_content", lambda name, s: files.get(name) if s == library.state else None)
        return machine_code(library)

    return take


def test_a_processor_takes_the_highest_level_that_it_has(found: Carried) -> None:
    """Expected: by hand; with AVX2 only, or without it, never the code for AVX-512."""
    files = {f"x86_64-linux/loop-v{k}": b"level%d" % k for k in (3, 4)}
    for level, expected in ((4, b"level4"), (3, b"level3"), (2, b"compiled"), (None, b"compiled")):
        library = found(level, files)
        assert library.path.read_bytes() == expected, level
        assert ("x86-64-v" in library.features) == expected.startswith(b"level")
    # of a wheel that was made for this processor
    files["x86_64-linux/loop"] = b"here"
    assert found(4, files).path.read_bytes() == b"here"


def test_code_that_does_not_load_is_followed_by_the_next(found: Carried) -> None:
    files = {"x86_64-linux/loop-v4": b"broken", "x86_64-linux/loop-v3": b"level3"}
    assert found(4, files).path.read_bytes() == b"level3"
    del files["x86_64-linux/loop-v3"]
    assert found(4, files).path.read_bytes() == b"compiled"


def test_code_that_came_with_the_package_needs_no_cache(found: Carried, tmp_path: Path) -> None:
    """Expected: the same code where the cache's folder is a file, which keeps even root from writing there."""
    (tmp_path / "cache").write_text("a file")
    library = found(3, {"x86_64-linux/loop-v3": b"level3"})
    assert (library.path.read_bytes(), library.path.suffix) == (b"level3", ".so")
    assert not library.path.is_relative_to(tmp_path / "cache")


def test_a_file_that_is_no_library_is_named(tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    broken.write_bytes(b"broken")
    with pytest.warns(UserWarning, match=r"broken does not load here, and is compiled instead: "):
        assert not lanes._loads(broken)


def test_every_target_has_code_for_its_processors() -> None:
    """Expected: AVX2 on x86-64, and AVX-512 on Linux; one kind elsewhere, for any processor of it."""
    assert {name: levels_of(target) for name, target in BY_NAME.items()} == {
        "x86_64-linux": (3, 4),
        "x86_64-windows": (3,),
        "x86_64-darwin": (3,),
        "aarch64-linux": (0,),
        "aarch64-darwin": (0,),
    }
    assert [flags_of_level(k)[0] for k in (0, 3, 4)] == ["-O3", "-mcpu=x86_64_v3", "-mcpu=x86_64_v4"]
    assert not any("-mcpu=native" in flags_of_level(k) for k in (0, 3, 4))
    assert carried_name(native(), "loop", 0) == f"{native().name}/loop"
