"""The C compiler: `zig cc` from the ziglang wheel, the same for every target."""

import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from threading import Event
from typing import IO, Any

from gough_stewart.fmu_build.compiler_cache import (
    cache_folder,
    compiler_environment,
    compiling,
    empty_objects,
)
from gough_stewart.fmu_build.errors import BuildError
from gough_stewart.fmu_build.targets import Target
from gough_stewart.model.files import write_whole

FLAGS = (
    *("-O3", "-std=c11", "-g0", "-s", "-shared", "-fvisibility=hidden"),
    # a fused multiply-add on one processor and none on another would make two trajectories of one
    "-ffp-contract=off",
    # nobody reads errno; without it sqrt is one instruction
    "-fno-math-errno",
)
# For a library of a few hundred kilobytes and what is made on the way [bytes].
_ROOM = 16_000_000


def compile_library(
    name: str,
    units: Mapping[str, str],
    headers: Mapping[str, str],
    target: Target,
    stop: Event | None = None,
    flags: Sequence[str] = FLAGS,
) -> bytes:
    """The shared library `name` of some C files, the same bytes for the same sources.

    A damaged cache of the compiler is made anew. The compiler ends soon after `stop` is set, with all processes that it
    has started.

    Raises
    ------
    BuildError
        With what the compiler said.
    """
    # zig's cache knows a file by its place, so that every file gets one that goes with its content
    include = place_of(headers)
    files = [str(place_of({name: text}) / name) for name, text in sorted(units.items())]
    with compiling() as in_use, tempfile.TemporaryDirectory(prefix="gough-stewart-") as scratch:
        library = Path(scratch, name + target.suffix)
        command = [sys.executable, "-m", "ziglang", "cc", "-target", target.triple, *flags, *target.flags_of(name)]
        command += ["-I", str(include), *files, "-o", str(library), "-lm"]
        stop = stop or Event()
        code, message = _run(command, scratch, stop, in_use)
        if code != 0 and not stop.is_set() and _may_be_the_cache(message, scratch):
            empty_objects(in_use)
            code, message = _run(command, scratch, stop, in_use)
        if code != 0:
            raise BuildError(f"the compiler failed for {target.name}:\n{_complaint(code, message, scratch)}")
        return library.read_bytes()


def _is_about_sources(message: str) -> bool:
    """Whether it names a line of a file that it was given."""
    return re.search(re.escape(str(cache_folder())) + r".*?:\d+:\d+: (?:fatal )?error: ", message) is not None


def _nearly_full(scratch: str) -> Path | None:
    """The folder that has no room for a build, if there is one."""
    for folder in (Path(scratch), cache_folder()):
        if shutil.disk_usage(folder).free < _ROOM:
            return folder
    return None


def _may_be_the_cache(message: str, scratch: str) -> bool:
    return not _is_about_sources(message) and _nearly_full(scratch) is None


def _complaint(code: int, message: str, scratch: str) -> str:
    """What the compiler said, and what may help."""
    words = message.strip() or f"it ended with {code} and said nothing"
    full = _nearly_full(scratch)
    if full is not None:
        free = shutil.disk_usage(full).free / 1e6
        place = f"{full.parent}, set TMPDIR" if full == Path(scratch) else f"{full}, set ZIG_GLOBAL_CACHE_DIR"
        return f"{words}\nThere is room for {free:.3g} MB in {place} to a folder with {_ROOM / 1e6:.0f} MB or more."
    if _is_about_sources(message):
        return words
    return f"{words}\nA new cache did not help; if nothing else explains this, delete the folder {cache_folder()}"


def _run(command: Sequence[str], folder: str, stop: Event, in_use: IO[str]) -> tuple[int, str]:
    """Exit code of a command and what it said on its error stream; in a group of its own, to be ended as a whole."""
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
    """A folder that holds these files, and stays."""
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
            "set ZIG_GLOBAL_CACHE_DIR or XDG_CACHE_HOME to a folder that can"
        ) from error
    return folder


def universal_binary(libraries: Sequence[tuple[Target, bytes]]) -> bytes:
    """Mach-O file that holds the libraries of several processors (`lipo -create`).

    Header in big-endian: magic, number; per library processor, subtype, offset, size, alignment as a power of two.
    """
    processors = {"x86_64-darwin": (0x01000007, 3), "aarch64-darwin": (0x0100000C, 0)}
    power = 14  # 16 KiB, the pages of Apple's processors
    entries, content = b"", bytearray(1 << power)
    for target, library in libraries:
        content += bytes(-len(content) % (1 << power))
        entries += struct.pack(">IIIII", *processors[target.name], len(content), len(library), power)
        content += library
    header = struct.pack(">II", 0xCAFEBABE, len(libraries)) + entries
    content[: len(header)] = header
    return bytes(content)
