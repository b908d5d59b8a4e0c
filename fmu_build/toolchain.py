"""Systems to compile for; C compilers: which one, with which commands, how it is run; a library, compiled once.

`$CC`, else zig, which compiles for every target and whose units also run on older systems, else one of the system's.
Each version of zig has a cache for its objects. It is emptied when the compiler fails for no reason in the sources:
with a damaged object every later build would fail, too.
"""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from threading import Event
from typing import IO, Any, NamedTuple

from gough_stewart.fmu_build.cache import COMPILER, BuildError, cache_folder, digest_of_texts, kept
from gough_stewart.fmu_build.component import Sources
from gough_stewart.model.process.files import write_whole
from gough_stewart.model.process.installed import NOT_INSTALLED, THIS_MACHINE

try:
    import fcntl
except ImportError:  # Windows, where files in use cannot be deleted
    fcntl = None  # type: ignore[assignment]

FLAGS = (
    *("-O3", "-std=c11", "-g0", "-s", "-shared", "-fvisibility=hidden"),
    # fused multiply-adds on one processor but not on another would change the results
    "-ffp-contract=off",
    # errno is not used; without it sqrt is one instruction
    "-fno-math-errno",
)
_SYSTEMS = ("cc", "gcc", "clang", "cl")
# zig's default order of instructions there, of a small processor, spills more: a quarter more code after deflate.
_UNORDERED = {"aarch64-linux": ("-mllvm", "-enable-misched=false")}
_REMEDY = "pip install 'gough-stewart[compile]' brings one for every target"
# Disk space for a library of a few hundred kilobytes and intermediate files [bytes].
_SPACE = 16_000_000


@dataclass(frozen=True)
class Target:
    """One operating system on one processor."""

    name: str  # FMI 3.0's platform tuple, and its folder under binaries/
    triple: str  # for zig, with the oldest supported C library or system
    fmi2_folder: str
    suffix: str


TARGETS = (
    Target("x86_64-linux", "x86_64-linux-gnu.2.17", "linux64", ".so"),
    Target("aarch64-linux", "aarch64-linux-gnu.2.17", "aarch64-linux", ".so"),
    Target("x86_64-windows", "x86_64-windows-gnu", "win64", ".dll"),
    Target("x86_64-darwin", "x86_64-macos.10.15", "darwin64", ".dylib"),
    Target("aarch64-darwin", "aarch64-macos.11.0", "darwin64", ".dylib"),
)
BY_NAME = {target.name: target for target in TARGETS}
# Of live pages; no units are built for it.
WEB_ASSEMBLY = Target("WebAssembly", "wasm32-wasi", "", ".wasm")


def native() -> Target:
    """The target of this machine; `BuildError` if it is not among the targets."""
    if THIS_MACHINE not in BY_NAME:
        raise BuildError(
            f"this machine is {THIS_MACHINE}; expected one of {', '.join(BY_NAME)}; choose targets by name"
        )
    return BY_NAME[THIS_MACHINE]


def chosen_targets(names: Iterable[str]) -> tuple[Target, ...]:
    """Targets by name, `native` or `all`, in the order of the table; `BuildError` for an unknown name, or none."""
    chosen = chosen_names("target", names, ("native", "all", *BY_NAME), f"native, all, or one of {', '.join(BY_NAME)}")
    here = native() if "native" in chosen else None
    return tuple(target for target in TARGETS if "all" in chosen or target is here or target.name in chosen)


def chosen_names(kind: str, names: Iterable[str], known: Sequence[str], expected: str = "") -> tuple[str, ...]:
    """The requested names, in the order of `known` and without duplicates; `BuildError` for another name, or none."""
    requested = [names] if isinstance(names, str) or not isinstance(names, Iterable) else list(names)
    expected = expected or " or ".join(map(repr, known))
    for name in requested:
        if name not in known:
            raise BuildError(f"no {kind} {name!r}; expected {expected}")
    if not requested:
        raise BuildError(f"no {kind}; expected {expected}")
    return tuple(name for name in known if name in requested)


class Compiler(NamedTuple):
    """A command, and what the bytes of its output depend on."""

    command: tuple[str, ...]
    identity: str
    is_zig: bool = False

    def commands(
        self, library: str, files: Sequence[str], include: str, target: Target, flags: Sequence[str]
    ) -> list[list[str]]:
        """The commands that compile files to a library, each run in the same folder.

        zig builds the C library of Windows anew for each kind of processor, in minutes; so only the files are compiled
        for that.
        """
        by_suffix = {".dylib": [f"-Wl,-install_name,@rpath/{Path(library).stem}.dylib"], ".so": ["-fPIC"]}
        of_system, ending = by_suffix.get(target.suffix, []), ["-I", include, *files, "-o", library, "-lm"]
        if not self.is_zig:
            if Path(self.command[0]).stem.lower() == "cl":
                options = ("/nologo", "/LD", "/O2", "/std:c11", "/fp:precise", "/MT")
                return [[*self.command, *options, "/I", include, *files, f"/Fe:{library}"]]
            accepted = (flag for flag in flags if not (flag == "-s" and target.suffix == ".dylib"))
            return [[*self.command, *accepted, *of_system, *ending]]
        aim = [*self.command, "-target", target.triple]
        general = [flag for flag in flags if not flag.startswith("-mcpu=")]
        if target.suffix != ".dll" or len(general) == len(flags):
            return [[*aim, *flags, *_UNORDERED.get(target.name, ()), *of_system, *ending]]
        plain = [flag for flag in flags if flag not in ("-shared", "-s")]
        objects = [f"{k}.obj" for k in range(len(files))]
        compiled = [
            [*aim, *plain, "-I", include, "-c", file, "-o", object_file]
            for file, object_file in zip(files, objects, strict=True)
        ]
        return [*compiled, [*aim, *general, *of_system, "-I", include, *objects, "-o", library, "-lm"]]


def zig() -> Compiler:
    """The compiler of the extra `compile`; `BuildError` if it is not installed."""
    if find_spec(COMPILER) is None:
        raise BuildError(NOT_INSTALLED.format(f"{COMPILER} (to compile)"))
    command = (sys.executable, "-m", COMPILER, "cc")
    return Compiler(command, f"{COMPILER} {version(COMPILER)} {_UNORDERED}", is_zig=True)


def compiler_of(target: Target) -> Compiler:
    """The compiler of a unit for a target; `BuildError` if `CC` names no program, or there is none."""
    words, is_here = shlex.split(os.environ.get("CC", "")), target.name == THIS_MACHINE
    if is_here and words:
        path = shutil.which(words[0])
        if path is None:
            raise BuildError(f"the environment variable CC is '{' '.join(words)}'; expected a C compiler, or unset it")
    elif find_spec(COMPILER) is not None:
        return zig()
    else:
        path = next(filter(None, map(shutil.which, _SYSTEMS if is_here else ())), None)
    if path is None:
        looked = f"CC, zig, {', '.join(_SYSTEMS)}" if is_here else "zig"
        raise BuildError(f"no C compiler for {target.name} was found ({looked}); {_REMEDY}")
    # known by size and time of its program
    program, options = Path(path).resolve().stat(), words[1:]
    return Compiler((path, *options), f"{path} {' '.join(options)} {program.st_size} {program.st_mtime_ns}")


def compile_library(
    name: str,
    units: Mapping[str, str],
    headers: Mapping[str, str],
    target: Target,
    stop: Event | None = None,
    flags: Sequence[str] = FLAGS,
    compiler: Compiler | None = None,
) -> bytes:
    """Compile C files to the library `name`, by zig if no other is given; the same sources give the same bytes.

    When `stop` is set, the compiler ends soon, with all processes that it has started. A damaged compiler cache is made
    anew. `BuildError` with the compiler's message if it failed.
    """
    # zig's cache identifies a file by its path, so every file gets a path that depends on its content
    include = str(place_of(headers))
    files = [str(place_of({unit: text}) / unit) for unit, text in sorted(units.items())]
    with compiling() as in_use, tempfile.TemporaryDirectory(prefix="gough-stewart-") as scratch:
        library, stop = Path(scratch, name + target.suffix), stop or Event()
        commands = (compiler or zig()).commands(str(library), files, include, target, flags)
        for is_last in (False, True):
            for command in commands:
                code, message = _run(command, scratch, stop, in_use)
                if code != 0:
                    break
            else:
                return library.read_bytes()
            line_of_a_source = re.escape(str(cache_folder())) + r".*?:\d+:\d+: (?:fatal )?error: "
            is_about_sources = re.search(line_of_a_source, message) is not None
            places = {"TMPDIR": Path(scratch), "ZIG_GLOBAL_CACHE_DIR": cache_folder()}
            full = next((name for name, place in places.items() if shutil.disk_usage(place).free < _SPACE), None)
            # an error that neither the sources nor a full disk explain may be of the cache
            if stop.is_set() or is_about_sources or full:
                break
            if not is_last:  # empty the cache as soon as no other compiler works in it
                # release the shared lock first: two processes waiting for each other would deadlock
                _flock(in_use, "LOCK_UN")
                _flock(in_use, "LOCK_EX")
                objects = Path(compiler_environment()["ZIG_GLOBAL_CACHE_DIR"])
                if objects.is_dir() and not objects.is_symlink():
                    shutil.rmtree(objects, ignore_errors=True)
                else:
                    objects.unlink(missing_ok=True)
                _flock(in_use, "LOCK_SH")
        text, cache = message.strip() or f"exit code {code} without a message", cache_folder()
        if full:
            free, place = shutil.disk_usage(places[full]).free, Path(scratch).parent if full == "TMPDIR" else cache
            text += f"\nOnly {free / 1e6:.3g} MB are free in {place}, "
            text += f"set {full} to a folder with at least {_SPACE / 1e6:.0f} MB."
        elif not is_about_sources:
            text += f"\nEmptying the cache did not help; if there is no other explanation, delete the folder {cache}"
    raise BuildError(f"the compiler failed for {target.name}:\n{text}")


@dataclass(frozen=True)
class Library:
    """The description of a library."""

    name: str  # of the file, without suffix
    sources: Callable[[], Sources]  # called to compile it; tracing takes seconds
    state: str  # digest of what the sources are made of
    flags: tuple[str, ...] = FLAGS

    def compiled(self, target: Target, stop: Event | None = None, compiler: Compiler | None = None) -> bytes:
        """The library for a target; see `compile_library` for arguments and errors."""
        return compile_library(self.name, *self.sources(), target, stop, flags=self.flags, compiler=compiler)

    def kept(
        self, target: Target, stop: Event | None = None, compiler: Compiler | None = None, processor: str = ""
    ) -> Path:
        """The file of the library, cached or compiled, see `cache.kept`; `processor` if it is for one only."""
        compiler = compiler or zig()
        key = sha256("\n".join([self.state, *self.flags, compiler.identity, processor]).encode()).hexdigest()[:24]
        path = cache_folder() / self.name / f"{key}-{target.name}" / f"{self.name}{target.suffix}"
        return kept(path, lambda: self.compiled(target, stop, compiler))


def compiler_environment() -> dict[str, str]:
    """The environment of the process, with zig's objects in our cache, in a folder for each version of zig."""
    folder = str(cache_folder() / f"zig-{version(COMPILER) if find_spec(COMPILER) else 'none'}")
    return {**os.environ, "ZIG_GLOBAL_CACHE_DIR": folder, "ZIG_LOCAL_CACHE_DIR": folder}


@contextmanager
def compiling() -> Iterator[IO[str]]:
    """Context for a compiler, which inherits its lock file and may outlive this process: nobody empties its cache."""
    cache_folder().mkdir(parents=True, exist_ok=True)
    with (cache_folder() / "zig.lock").open("a") as in_use:
        _flock(in_use, "LOCK_SH")
        yield in_use


def _flock(in_use: IO[str], how: str) -> None:
    if fcntl is not None:
        fcntl.flock(in_use, getattr(fcntl, how))


def _run(command: Sequence[str], folder: str, stop: Event, in_use: IO[str]) -> tuple[int, str]:
    """Exit code and error output of a command, run in its own process group so that it can be ended as a whole."""
    group: dict[str, Any] = {} if sys.platform == "win32" else {"process_group": 0, "pass_fds": (in_use.fileno(),)}
    with subprocess.Popen(
        command,
        cwd=folder,
        env=compiler_environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        errors="replace",
        **group,
    ) as compiler:
        while True:
            try:
                message = compiler.communicate(timeout=0.1)[1]
            except subprocess.TimeoutExpired:
                if stop.is_set():
                    compiler.kill() if sys.platform == "win32" else os.killpg(compiler.pid, signal.SIGKILL)
            else:
                return compiler.returncode, message


def place_of(files: Mapping[str, str]) -> Path:
    """A permanent folder with these files."""
    folder = cache_folder() / digest_of_texts(files)[:24]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            file, data = folder / name, text.encode()
            if not file.exists() or file.read_bytes() != data:
                write_whole(file, data)
    except OSError as error:
        raise BuildError(
            f"the compiler's cache cannot be written: {folder}: {error.strerror}; "
            "set ZIG_GLOBAL_CACHE_DIR or XDG_CACHE_HOME to a writable folder"
        ) from error
    return folder
