"""Parts of the build by themselves: the compiler, caches, licenses, headers, targets, the vector library."""

import io
import os
import shutil
import subprocess
import sys
import threading
import time
import zipfile
from collections.abc import Iterator, Sequence
from hashlib import sha256
from importlib import metadata
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import SimpleNamespace
from typing import IO, Any

import pytest

from gough_stewart.fmu_build import binaries, errors, sources, targets, toolchain
from gough_stewart.fmu_build import cache as cache_files
from gough_stewart.fmu_build import cache as cached
from gough_stewart.fmu_build import documents as package
from gough_stewart.fmu_build import libraries as lanes
from gough_stewart.fmu_build.build import contents, unit_archives, unit_of
from gough_stewart.fmu_build.cache import state_of_texts
from gough_stewart.fmu_build.errors import BuildError
from gough_stewart.fmu_build.libraries import lanes_library, lanes_sources
from gough_stewart.fmu_build.sources import start_block
from gough_stewart.fmu_build.targets import BY_NAME, TARGETS, chosen_targets, native
from gough_stewart.fmu_build.toolchain import compile_library, place_of
from gough_stewart.model.process import installed
from tests.fmu_build.test_small_component import SMALL

KERNEL, HEADER = {"b.c": "int b;", "a.c": "int a;"}, {"a.h": "int a;"}


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The compiler's cache, empty, as a new process finds it; its parent is the cache of sources."""
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(tmp_path / "zig"))
    return tmp_path / "zig" / "gough-stewart" / f"zig-{metadata.version('ziglang')}"


class Compiler:
    """In the place of the compiler: keeps its commands, ends as it is told, and writes what it links."""

    def __init__(self, *ends: tuple[int, str]) -> None:
        self.ends, self.commands = list(ends), list[Sequence[str]]()
        self.folders, self.stops = list[str](), list[threading.Event]()

    def __call__(self, command: Sequence[str], folder: str, stop: threading.Event, _in_use: IO[str]) -> tuple[int, str]:
        self.commands.append(command)
        self.folders.append(folder)
        self.stops.append(stop)
        Path(command[command.index("-o") + 1]).write_bytes(b"linked")
        return self.ends.pop(0) if self.ends else (0, "")


# --- the compiler ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "triple", "suffix", "own"),
    [
        ("x86_64-linux", "x86_64-linux-gnu.2.17", ".so", ["-fPIC"]),
        ("x86_64-windows", "x86_64-windows-gnu", ".dll", []),
        ("aarch64-darwin", "aarch64-macos.11.0", ".dylib", ["-Wl,-install_name,@rpath/unit.dylib"]),
    ],
)
def test_the_compiler_is_called_with_each_option_in_its_place(
    name: str, triple: str, suffix: str, own: list[str], cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: the options of `zig cc`, by hand; sources by content, in the order of their names."""
    compiler = Compiler()
    monkeypatch.setattr(toolchain, "_run", compiler)
    assert compile_library("unit", KERNEL, HEADER, BY_NAME[name]) == b"linked"
    ((program, *command),) = compiler.commands
    assert program == sys.executable
    assert command[:5] == ["-m", "ziglang", "cc", "-target", triple]
    tail = command[-7:]
    flags = command[5:-7]
    assert sorted(flags) == sorted(
        ["-O3", "-std=c11", "-g0", "-s", "-shared", "-fvisibility=hidden", "-ffp-contract=off", "-fno-math-errno", *own]
    )
    assert tail[0] == "-I"
    assert (Path(tail[1]) / "a.h").read_text() == "int a;"
    assert [Path(each).name for each in tail[2:4]] == ["a.c", "b.c"]
    assert [Path(each).read_text() for each in tail[2:4]] == ["int a;", "int b;"]
    assert tail[4:] == ["-o", str(Path(compiler.folders[0], f"unit{suffix}")), "-lm"]
    # short, for systems with short paths
    places = [Path(tail[1]), *(Path(each).parent for each in tail[2:4])]
    assert {(each.parent, len(each.name)) for each in places} == {(cache.parent, 24)}
    assert not Path(compiler.folders[0]).exists()
    other = Compiler()
    monkeypatch.setattr(toolchain, "_run", other)
    compile_library("unit", KERNEL, HEADER, BY_NAME[name], flags=["-O1"])
    assert other.commands[0][6 : -7 - len(own)] == ["-O1"]


def test_a_file_in_the_cache_that_differs_is_written_again_and_a_sound_one_stays(cache: Path) -> None:
    """Expected: by content, name by name; the same files have one place, others have another."""
    folder = place_of(KERNEL)
    before = (folder / "a.c").stat().st_mtime_ns, (folder / "a.c").stat().st_ino
    (folder / "b.c").write_text("int c;")
    assert place_of(dict(reversed(KERNEL.items()))) == folder
    assert (folder / "b.c").read_text() == "int b;"
    assert ((folder / "a.c").stat().st_mtime_ns, (folder / "a.c").stat().st_ino) == before
    assert len({folder, place_of(HEADER), place_of({"b.h": "int a;"}), place_of({"a.h": "int b;"})}) == 4
    assert folder.parent == cache.parent


def test_what_was_told_to_stop_is_not_tried_again(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: one run, in a cache that stays; the event goes on to the compiler."""
    (cache / "o" / "1").mkdir(parents=True)
    stop = threading.Event()
    stop.set()
    compiler = Compiler((-9, "killed"), (0, ""))
    monkeypatch.setattr(toolchain, "_run", compiler)
    with pytest.raises(BuildError, match="the compiler failed for x86_64-linux:\nkilled"):
        compile_library("unit", KERNEL, HEADER, BY_NAME["x86_64-linux"], stop)
    assert compiler.stops == [stop]
    assert (cache / "o" / "1").exists()


@pytest.mark.parametrize("full", ["temporary", "cache", "both", "neither"])
def test_a_full_disk_is_named_with_the_variable_that_helps(
    full: str, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: the folder that has no 16 MB left, the temporary one first; else, after another try, the cache."""
    compiler = Compiler(*[(1, "  no luck\n")] * 2)
    monkeypatch.setattr(toolchain, "_run", compiler)

    def usage(folder: Path) -> SimpleNamespace:
        is_cache = Path(folder) == cache.parent
        is_full = full in {"both", "cache" if is_cache else "temporary"}
        return SimpleNamespace(free=1_500_000 + is_cache * 1_000_000 if is_full else 16_000_000)

    monkeypatch.setattr(shutil, "disk_usage", usage)
    with pytest.raises(BuildError) as caught:
        compile_library("unit", KERNEL, HEADER, native())
    place = Path(compiler.folders[0]).parent
    remedy = {
        "temporary": f"Only 1.5 MB are free in {place}, set TMPDIR to a folder with at least 16 MB.",
        "cache": f"Only 2.5 MB are free in {cache.parent}, set ZIG_GLOBAL_CACHE_DIR to a folder with at least 16 MB.",
        "both": f"Only 1.5 MB are free in {place}, set TMPDIR to a folder with at least 16 MB.",
        "neither": "Emptying the cache did not help; if there is no other explanation, delete the folder "
        f"{cache.parent}",
    }
    assert str(caught.value) == f"the compiler failed for {native().name}:\nno luck\n{remedy[full]}"
    assert len(compiler.commands) == (2 if full == "neither" else 1)


@pytest.mark.parametrize("kind", ["error", "fatal error", "warning"])
def test_a_fault_of_a_source_is_shown_as_it_is(kind: str, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: one run and the compiler's words alone; a warning is not why it failed."""
    words = f"{cache.parent}/0123/a.c:3:14: {kind}: expected ';'"
    compiler = Compiler(*[(1, words)] * 2)
    monkeypatch.setattr(toolchain, "_run", compiler)
    with pytest.raises(BuildError) as caught:
        compile_library("unit", KERNEL, HEADER, native())
    alone = f"the compiler failed for {native().name}:\n{words}"
    assert (str(caught.value) == alone) == (kind != "warning")
    assert len(compiler.commands) == (2 if kind == "warning" else 1)


@pytest.mark.skipif(sys.platform == "win32", reason="processes have no groups there")
def test_a_process_is_read_to_its_end_and_ended_with_its_children(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: its error output, whatever the bytes, and no other; its code; its folder and environment."""
    monkeypatch.setenv("OWN", "kept")
    script = (
        "import os, sys; print('out'); sys.stderr.buffer.write(b'caf\\xc3\\xa9 \\xff '); "
        "sys.stderr.write(' '.join([os.getcwd(), os.environ['OWN'], os.environ['ZIG_GLOBAL_CACHE_DIR'], "
        "os.environ['ZIG_LOCAL_CACHE_DIR']])); sys.exit(3)"
    )
    with (tmp_path / "lock").open("w") as in_use:
        code, message = toolchain._run([sys.executable, "-c", script], str(tmp_path), threading.Event(), in_use)
        assert (code, message) == (3, f"caf\N{LATIN SMALL LETTER E WITH ACUTE} \ufffd {tmp_path} kept {cache} {cache}")
        stop = threading.Event()
        mark = tmp_path / "child"
        parent = (
            "import subprocess, sys, time; "
            "p = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'], "
            f"pass_fds=({in_use.fileno()},)); "
            f"open({str(mark)!r}, 'w').write(str(p.pid)); time.sleep(60)"
        )

        def stop_when_it_runs() -> None:
            while not (mark.exists() and mark.read_text()):
                time.sleep(0.02)
            stop.set()

        threading.Thread(target=stop_when_it_runs, daemon=True).start()
        code, _ = toolchain._run([sys.executable, "-c", parent], str(tmp_path), stop, in_use)
    assert code == -9
    if sys.platform == "linux":
        child = Path("/proc", mark.read_text(), "status")

        def has_ended() -> bool:
            try:
                return "State:\tZ" in child.read_text()
            except (FileNotFoundError, ProcessLookupError):
                return True

        # it may take a moment to die, and init to bury it; by itself it would sleep for a minute
        given_up = time.monotonic() + 20
        while not has_ended() and time.monotonic() < given_up:
            time.sleep(0.02)
        assert has_ended()


def test_a_universal_binary_begins_with_processors_and_their_kinds() -> None:
    """Expected: <mach/machine.h>: x86_64 is 7 and arm64 is 12, both with 64 bits; kinds 3 and 0."""
    both = binaries.universal_binary([(BY_NAME["x86_64-darwin"], b"x" * 20_000), (BY_NAME["aarch64-darwin"], b"a" * 5)])
    words = [int.from_bytes(both[4 * k : 4 * k + 4], "big") for k in range(12)]
    first = [0x01000007, 3, 0x4000, 20_000, 14]
    second = [0x0100000C, 0, 0xC000, 5, 14]
    assert words == [0xCAFEBABE, 2, *first, *second]
    assert both[0x4000:0x8E20] == b"x" * 20_000
    assert both[0xC000:] == b"a" * 5
    unit = unit_of(SMALL, "2.0")
    alone = contents(unit, {BY_NAME["aarch64-darwin"]: b"only"})
    assert alone["binaries/darwin64/small.dylib"] == b"only"
    two = contents(unit, {BY_NAME[f"{p}-darwin"]: p.encode() for p in ("x86_64", "aarch64")})
    assert two["binaries/darwin64/small.dylib"][:4] == b"\xca\xfe\xba\xbe"


# --- several at once -------------------------------------------------------------------------------------------------


def test_both_versions_share_a_library_and_are_told_step_by_step(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Expected: one compilation, with the layers and headers of both standards, and each unit with its own token."""
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(tmp_path))
    seen: list[tuple[str, set[str], str]] = []
    headers: list[dict[str, str]] = []

    def compiled(
        name: str, units: dict[str, str], includes: dict[str, str], target: targets.Target, *_: Any, **__: Any
    ) -> bytes:
        seen.append((name, {unit for unit in units if unit.startswith("fmi")}, target.name))
        headers.append(includes)
        return target.name.encode() + start_block(SMALL, None)

    monkeypatch.setattr(lanes, "compile_library", compiled)
    told: list[str] = []
    chosen = chosen_targets(["x86_64-windows"])
    archives = unit_archives(SMALL, ["2.0", "3.0"], iter(chosen), told.append)
    assert list(archives) == ["small_one_fmi2.fmu", "small_one_fmi3.fmu"]
    assert seen == [("small", {"fmi2.c", "fmi3.c"}, "x86_64-windows")]
    for version, archive in zip(("2.0", "3.0"), archives.values(), strict=True):
        with zipfile.ZipFile(io.BytesIO(archive)) as unit:
            (library,) = [unit.read(name) for name in unit.namelist() if name.endswith(".dll")]
        token = unit_of(SMALL, version).token
        tokens = (token, "") if version == "2.0" else ("", token)
        assert library == b"x86_64-windows" + start_block(SMALL, tokens)
    assert {"own.h", "model.h", "fmi2Functions.h", "fmi3Functions.h"} < set(headers[0])
    assert told == [
        "FMI 2.0: sources and documents",
        "FMI 2.0: x86_64-windows",
        "FMI 3.0: sources and documents",
        "FMI 3.0: x86_64-windows",
    ]


def test_after_a_failure_the_others_are_stopped_and_what_waits_is_not_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: one worker for three: the first fails, the second is told to stop, the third never begins."""
    begun: list[str] = []
    stopped: list[bool] = []

    def compiled(_name: str, _u: object, _h: object, target: targets.Target, stop: threading.Event, **_k: Any) -> bytes:
        begun.append(target.name)
        if len(begun) == 1:
            raise BuildError("first")
        stopped.append(stop.wait(10))
        raise BuildError("later")

    monkeypatch.setattr(lanes, "compile_library", compiled)
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    with pytest.raises(BuildError, match="first"):
        unit_archives(SMALL, ["3.0"], TARGETS[:3])
    assert begun in (["x86_64-linux"], ["x86_64-linux", "aarch64-linux"])
    assert all(stopped)


# --- caches ----------------------------------------------------------------------------------------------------------


def test_the_cache_is_the_users_unless_zig_has_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(tmp_path / "own"))
    assert cache_files.cache_folder() == tmp_path / "own" / "gough-stewart"
    monkeypatch.delenv("ZIG_GLOBAL_CACHE_DIR")
    monkeypatch.setattr(cache_files, "user_cache_path", lambda name: tmp_path / "user" / name)
    assert cache_files.cache_folder() == tmp_path / "user" / "gough-stewart" / "build"
    assert toolchain.object_cache().parent == cache_files.cache_folder()


@pytest.fixture
def _forgotten() -> Iterator[None]:
    """No state of sources is kept from before, nor after."""
    state_of_texts.cache_clear()
    yield
    state_of_texts.cache_clear()


@pytest.mark.usefixtures("_forgotten")
def test_the_state_of_the_sources_depends_on_each_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: another state for another version of each package that makes the bytes, and for each of our folders."""
    versions = dict.fromkeys(["gough-stewart", "casadi", "fmpy", "latex2mathml", "numpy", "scipy", "ziglang"], "1")
    asked: list[str] = []

    def version(name: str) -> str:
        asked.append(name)
        return versions[name]

    for name in ("model", "fmu_build"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.py").write_text("x")
    monkeypatch.setattr(cached, "version", version)
    monkeypatch.setattr("importlib.resources.files", lambda name: tmp_path / name.removeprefix("gough_stewart."))
    states = [cached.state_of_sources.__wrapped__()]
    assert sorted(asked) == sorted(versions)
    for name in versions:
        versions[name] = "2"
        states.append(cached.state_of_sources.__wrapped__())
    for name in ("model", "fmu_build"):
        (tmp_path / name / "a.py").write_text("y")
        state_of_texts.cache_clear()
        states.append(cached.state_of_sources.__wrapped__())
    assert len(set(states)) == 1 + 7 + 2
    assert {len(state) for state in states} == {24}


# --- licenses, headers, packages -------------------------------------------------------------------------------------


def test_the_license_is_that_of_the_first_distribution_that_has_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: a checkout beside the installed package has none; without any, an error that says what helps."""

    class Installed:
        def __init__(self, text: str | None) -> None:
            self.metadata, self.text = {"Version": str(text)}, text

        def read_text(self, name: str) -> str | None:
            assert name == "licenses/LICENSE"
            return self.text

    def found(*texts: str | None) -> None:
        package._installed.cache_clear()
        monkeypatch.setattr(package, "distributions", lambda name: [Installed(t) for t in texts if name])

    try:
        found(None, "", "BSD", "MIT")
        assert package.package_license() == "BSD"
        assert package.package_metadata()["Version"] == "BSD"
        found(None, "")
        with pytest.raises(
            BuildError, match=r"^gough-stewart is installed without its license; reinstall it with pip$"
        ):
            package.package_license()
    finally:
        package._installed.cache_clear()


def test_headers_that_are_missing_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "c-code").mkdir()
    for name in ("fmi3Functions.h", "fmi3FunctionTypes.h"):
        (tmp_path / "c-code" / name).write_text(
            f"/* {name}\n   Copyright (C) of {name}\n   --- \n*/ int x; /* other */\n"
        )
    spec = ModuleSpec("fmpy", None, origin=str(tmp_path / "__init__.py"))
    monkeypatch.setattr(sources, "find_spec", lambda _name: spec)
    monkeypatch.setattr(sources, "version", lambda name: f"0.3.1 of {name}")
    expected = "^FMPy 0.3.1 of fmpy has no fmi3PlatformTypes.h; install FMPy 0.3.28 or later$"
    with pytest.raises(BuildError, match=expected):
        sources.standard_headers("3.0")
    (tmp_path / "c-code" / "fmi3PlatformTypes.h").write_text("types")
    assert list(sources.standard_headers("3.0")) == ["fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"]
    # the notice alone, of the functions
    assert sources.standard_license("3.0") == "Copyright (C) of fmi3Functions.h\n"


def test_missing_packages_are_named_with_their_use(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: those that are missing, in the order in which they are asked for."""
    remedy = "; install the extra: pip install 'gough-stewart[compile]'"
    for missing, words in (
        ({"casadi"}, "casadi (to trace equations)"),
        ({"ziglang"}, "ziglang (to compile)"),
        ({"casadi", "ziglang"}, "casadi (to trace equations) and ziglang (to compile)"),
    ):
        monkeypatch.setattr(installed, "find_spec", lambda name, missing=missing: None if name in missing else object())
        with pytest.raises(BuildError) as caught:
            errors.check_installed("casadi", "ziglang")
        assert str(caught.value) == f"not installed: {words}{remedy}"
        errors.check_installed(*({"casadi", "ziglang"} - missing))


def test_targets_have_the_names_of_both_standards_and_of_the_compiler() -> None:
    """Expected: FMI 3.0's platform tuples, FMI 2.0's folders, and zig's triples with the oldest system."""
    assert [(t.name, t.triple, t.fmi2_folder, t.suffix) for t in TARGETS] == [
        ("x86_64-linux", "x86_64-linux-gnu.2.17", "linux64", ".so"),
        ("aarch64-linux", "aarch64-linux-gnu.2.17", "aarch64-linux", ".so"),
        ("x86_64-windows", "x86_64-windows-gnu", "win64", ".dll"),
        ("x86_64-darwin", "x86_64-macos.10.15", "darwin64", ".dylib"),
        ("aarch64-darwin", "aarch64-macos.11.0", "darwin64", ".dylib"),
    ]
    names = "x86_64-linux, aarch64-linux, x86_64-windows, x86_64-darwin, aarch64-darwin"
    with pytest.raises(BuildError, match=f"^no target 'vax'; expected native, all, or one of {names}$"):
        chosen_targets(["native", "vax"])
    assert chosen_targets("x86_64-darwin") == (TARGETS[3],)
    assert chosen_targets(["x86_64-darwin", "all"]) == TARGETS


@pytest.mark.parametrize(
    ("machine", "system", "name"),
    [("x86_64", "Linux", "x86_64-linux"), ("amd64", "Linux", "x86_64-linux"), ("ARM64", "Darwin", "aarch64-darwin")],
)
def test_the_machine_is_found_by_processor_and_system(
    machine: str, system: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("platform.machine", lambda: machine)
    monkeypatch.setattr("platform.system", lambda: system)
    assert native().name == name
    monkeypatch.setattr("platform.system", lambda: "Plan9")
    processor = name.split("-", maxsplit=1)[0]
    with pytest.raises(BuildError, match=f"^this machine is {processor}-plan9; expected one of x86_64-linux, aarch64-"):
        native()


# --- the vector library ----------------------------------------------------------------------------------------------

CPU = """processor\t: 0
vendor_id\t: Maker
cpu family\t: 6
model\t\t: 85
model name\t: Name: of it
stepping\t: 7
cpu MHz\t\t: 2599.998
flags\t\t: fma sse2 avx2 asimd avx512f
"""


def test_the_processor_is_its_first_core_without_what_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: Linux's own lines by hand, for x86 and ARM; the clock and the second core are of no account."""
    arm = "processor : 0\nBogoMIPS : 50\nFeatures : asimd fp\nCPU implementer : 0x41\nCPU part : 0xd\nCPU variant : 3\n"
    monkeypatch.setattr(Path, "read_text", lambda *_, **__: CPU + "\n" + CPU.replace("Maker", "Other"))
    assert lanes._processor.__wrapped__() == (
        "vendor_id: Maker\ncpu family: 6\nmodel: 85\nflags: fma sse2 avx2 asimd avx512f"
    )
    monkeypatch.setattr(Path, "read_text", lambda *_, **__: arm)
    assert lanes._processor.__wrapped__() == (
        "Features: asimd fp\nCPU implementer: 0x41\nCPU part: 0xd\nCPU variant: 3"
    )

    def missing(*_: object, **__: object) -> str:
        raise FileNotFoundError

    monkeypatch.setattr(Path, "read_text", missing)
    monkeypatch.setattr("platform.system", lambda: "Windows")
    monkeypatch.setattr("platform.machine", lambda: "AMD64")
    monkeypatch.setattr("platform.processor", lambda: "Family 6")
    assert lanes._processor.__wrapped__() == "AMD64 Family 6"
    monkeypatch.setattr("platform.system", lambda: "Darwin")
    asked: list[list[str]] = []

    def run(command: list[str], **_: object) -> SimpleNamespace:
        asked.append(command)
        return SimpleNamespace(stdout="Apple M2")

    monkeypatch.setattr(subprocess, "run", run)
    assert lanes._processor.__wrapped__() == "Apple M2"
    assert asked == [["sysctl", "-n", "machdep.cpu.brand_string"]]


def test_a_vector_library_is_named_by_target_instructions_and_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: the sets that the processor has, the widest first, and half a digest; folders with short names."""
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(lanes, "compile_library", lambda *_, **__: b"code")
    monkeypatch.setattr(lanes, "_processor", lambda: "flags: fma sse2 avx2 asimd avx512f")
    target = native()
    found = lanes_library()
    digest = sha256(b"code").hexdigest()[:16]
    assert found.features == f"{target.name} avx512f avx2 fma asimd {digest}"
    assert found.path.name == f"lanes{target.suffix}"
    key, _, name = found.path.parent.name.partition("-")
    assert (len(key), name) == (24, target.name)
    assert found.path.parent.parent == tmp_path / "gough-stewart" / "lanes"
    monkeypatch.setattr(lanes, "_processor", lambda: "flags: avx512fish fma")
    assert lanes_library().features == f"{target.name} fma {digest}"


@pytest.mark.usefixtures("cache")
def test_the_vector_library_is_compiled_for_this_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: its options by hand; its sources are those of the folder and of the unit, with these numbers."""
    compiler = Compiler()
    monkeypatch.setattr(toolchain, "_run", compiler)
    assert toolchain.compile_library("lanes", *lanes_sources(), native(), flags=lanes.VECTOR_FLAGS) == b"linked"
    (command,) = compiler.commands
    options = {each for each in command if each.startswith("-") and each not in ("-m", "-target", "-I", "-o", "-lm")}
    assert options - {"-fPIC"} == {
        *("-O3", "-mcpu=native", "-std=c11", "-g0", "-s", "-shared", "-fvisibility=hidden"),
        *("-ffp-contract=fast-honor-pragmas", "-fno-math-errno", "-fno-signed-zeros"),
    }
    units, headers = lanes_sources()
    assert {Path(each).name for each in command if each.endswith(".c")} == set(units)
    words = [line.split() for line in headers["lanes_table.h"].splitlines()]
    assert {line[1]: float(line[2]) for line in words if line[:1] == ["#define"] and len(line) > 2} == {
        **{"N_STATES": 12, "N_INPUTS": 12, "N_PARAMETERS": 74, "N_RESULTS": 50, "N_SIGNALS": 24, "N_SHARED": 72},
        **{"MOST_LANE_STEPS": 10_000, "SMALLEST_SHARE": 1e-9, "SMALLEST_RATE": 1e-200, "FAILURE_TOO_MANY_STEPS": 11},
        **{"FAILURE_GOES_ON": 0, "FAILURE_NOT_FINITE": 1, "FAILURE_PITCHED": 2, "FAILURE_SINGULAR": 3},
        **{"FAILURE_PASSED_SINGULAR": 4, "FAILURE_COLLAPSED": 5},
        **{"FAILURE_COMMAND": 12, "FAILURE_STROKE": 13, "FAILURE_AWAY": 14, "FAILURE_NOT_STARTED": 15},
    }
    kernels = headers["lanes_kernel.h"]
    names = ["kernel_derivatives", "kernel_outputs", "kernel_signals", "kernel_margins"]
    places = [kernels.index(f"static __attribute__((noinline)) void {name}(const lanes ") for name in names]
    assert places == sorted(places)
    # divisions are multiplications with reciprocals
    code = kernels[places[0] :]
    assert "/" not in code
    assert "reciprocal(" in code
    assert "double" not in code
    folder = Path(lanes.__file__).parent / "c"
    assert units["conditioning.c"] == (folder / "plant/conditioning.c").read_text()
    assert headers["conditioning.h"] == (folder / "plant/conditioning.h").read_text()
    assert headers["internal.h"] == (folder / "unit/internal.h").read_text()
    assert units["lanes.c"] == (folder / "lanes/lanes.c").read_text()
