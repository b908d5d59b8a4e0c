"""Running a C compiler.

Each version of zig has a cache for its objects. It is emptied when the compiler fails for no reason in the sources:
with a damaged object every later build would fail, too.
"""

import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from hashlib import sha256
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from threading import Event
from typing import IO, Any

from gough_stewart.fmu_build.cache_files import cache_folder
from gough_stewart.fmu_build.compilers import Compiler, zig
from gough_stewart.fmu_build.errors import COMPILER, BuildError
from gough_stewart.fmu_build.targets import Target
from gough_stewart.model.process.files import write_whole

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
# Disk space for a library of a few hundred kilobytes and intermediate files [bytes].
_SPACE = 16_000_000


def compile_library(
    name: str,
    units: Mapping[str, str],
    headers: Mapping[str, str],
    target: Target,
    stop: Event | None = None,
    flags: Sequence[str] = FLAGS,
    compiler: Compiler | None = None,
) -> bytes:
    """Compile C files to the shared library `name`, by zig if no other is given; the same sources give the same bytes.

    When `stop` is set, the compiler ends soon, with all processes that it has started.

    Raises
    ------
    BuildError
        The compiler failed; contains its message.
    """

    def commands(library: str, files: Sequence[str], include: str) -> Sequence[Sequence[str]]:
        return (compiler or zig()).commands(library, files, include, target, flags)

    return compiled(name + target.suffix, units, headers, commands, target.name, stop)


def compiled(
    name: str,
    units: Mapping[str, str],
    headers: Mapping[str, str],
    commands: Callable[[str, Sequence[str], str], Sequence[Sequence[str]]],
    system: str,
    stop: Event | None = None,
) -> bytes:
    """The file `name` that the commands write, from its path, those of the C files and the folder of the headers.

    A damaged compiler cache is made anew. See `compile_library` for `stop` and errors.
    """
    # zig's cache identifies a file by its path, so every file gets a path that depends on its content
    include = str(place_of(headers))
    files = [str(place_of({unit: text}) / unit) for unit, text in sorted(units.items())]
    with compiling() as in_use, tempfile.TemporaryDirectory(prefix="gough-stewart-") as scratch:
        library, stop = Path(scratch, name), stop or Event()
        to_run = commands(str(library), files, include)
        code, message = _run_all(to_run, scratch, stop, in_use)
        # an error that neither the sources nor a full disk explain may be of the cache
        if code != 0 and not (stop.is_set() or _is_about_sources(message) or _nearly_full(scratch)):
            _empty_objects(in_use)
            code, message = _run_all(to_run, scratch, stop, in_use)
        if code != 0:
            raise BuildError(f"the compiler failed for {system}:\n{_complaint(code, message, scratch)}")
        return library.read_bytes()


def object_cache() -> Path:
    """The folder where zig stores its objects; there is one for each version of zig."""
    return cache_folder() / f"zig-{version(COMPILER) if find_spec(COMPILER) else 'none'}"


def compiler_environment() -> dict[str, str]:
    """The environment of the process, with the compiler's caches in `object_cache`."""
    folder = str(object_cache())
    return {**os.environ, "ZIG_GLOBAL_CACHE_DIR": folder, "ZIG_LOCAL_CACHE_DIR": folder}


@contextmanager
def compiling() -> Iterator[IO[str]]:
    """Context for running the compiler: nobody empties its cache meanwhile, since without it a compiler never ends.

    The compiler inherits the lock file, since it may outlive this process.
    """
    cache_folder().mkdir(parents=True, exist_ok=True)
    with (cache_folder() / "zig.lock").open("a") as in_use:
        _flock(in_use, "LOCK_SH")
        yield in_use


def _empty_objects(in_use: IO[str]) -> None:
    """Empty the cache as soon as no other compiler works in it."""
    # release the shared lock first: two processes waiting for each other would deadlock
    _flock(in_use, "LOCK_UN")
    _flock(in_use, "LOCK_EX")
    folder = object_cache()
    if folder.is_dir() and not folder.is_symlink():
        shutil.rmtree(folder, ignore_errors=True)
    else:
        folder.unlink(missing_ok=True)
    _flock(in_use, "LOCK_SH")


def _flock(in_use: IO[str], how: str) -> None:
    if fcntl is not None:
        fcntl.flock(in_use, getattr(fcntl, how))


def _is_about_sources(message: str) -> bool:
    """Whether the message refers to a line of a source file."""
    return re.search(re.escape(str(cache_folder())) + r".*?:\d+:\d+: (?:fatal )?error: ", message) is not None


def _nearly_full(scratch: str) -> Path | None:
    """A folder without enough space for a build, if there is one."""
    for folder in (Path(scratch), cache_folder()):
        if shutil.disk_usage(folder).free < _SPACE:
            return folder
    return None


def _complaint(code: int, message: str, scratch: str) -> str:
    """The compiler's message and a remedy."""
    text = message.strip() or f"exit code {code} without a message"
    full = _nearly_full(scratch)
    if full is not None:
        free = shutil.disk_usage(full).free / 1e6
        place = f"{full.parent}, set TMPDIR" if full == Path(scratch) else f"{full}, set ZIG_GLOBAL_CACHE_DIR"
        return f"{text}\nOnly {free:.3g} MB are free in {place} to a folder with at least {_SPACE / 1e6:.0f} MB."
    if _is_about_sources(message):
        return text
    return (
        f"{text}\nEmptying the cache did not help; if there is no other explanation, delete the folder {cache_folder()}"
    )


def _run_all(commands: Sequence[Sequence[str]], folder: str, stop: Event, in_use: IO[str]) -> tuple[int, str]:
    """Exit code and error output of the first command that fails, or of the last one."""
    code, message = 0, ""
    for command in commands:
        code, message = _run(command, folder, stop, in_use)
        if code != 0:
            break
    return code, message


def _run(command: Sequence[str], folder: str, stop: Event, in_use: IO[str]) -> tuple[int, str]:
    """Exit code and error output of a command, run in its own process group so that it can be ended as a whole."""
    own: dict[str, Any] = {} if sys.platform == "win32" else {"process_group": 0, "pass_fds": (in_use.fileno(),)}
    with subprocess.Popen(
        command,
        cwd=folder,
        env=compiler_environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        errors="replace",
        **own,
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
    content = sha256()
    for name, text in sorted(files.items()):
        content.update(f"{name}\0{text}\0".encode())
    folder = cache_folder() / content.hexdigest()[:24]
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


def universal_binary(libraries: Sequence[tuple[Target, bytes]]) -> bytes:
    """Mach-O file with the libraries of several processors (as from `lipo -create`).

    The header is big-endian: magic, count; per library: processor, subtype, offset, size, alignment as a power of two.
    """
    processors = {"x86_64-darwin": (0x01000007, 3), "aarch64-darwin": (0x0100000C, 0)}
    power = 14  # 16 KiB, the page size of Apple's processors
    entries, content = b"", bytearray(1 << power)
    for target, library in libraries:
        content += bytes(-len(content) % (1 << power))
        entries += struct.pack(">IIIII", *processors[target.name], len(content), len(library), power)
        content += library
    header = struct.pack(">II", 0xCAFEBABE, len(libraries)) + entries
    content[: len(header)] = header
    return bytes(content)
