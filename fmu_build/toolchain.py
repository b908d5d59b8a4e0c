"""The C compiler: `zig cc` from the ziglang wheel, the same for every target."""

import os
import signal
import struct
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from threading import Event
from typing import Any

from platformdirs import user_cache_path

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
LIBRARY = "gough_stewart"


def compile_library(
    units: Mapping[str, str], headers: Mapping[str, str], target: Target, stop: Event | None = None
) -> bytes:
    """The shared library of some C files, the same bytes for the same sources.

    The compiler ends soon after `stop` is set, with all processes that it has started.

    Raises
    ------
    BuildError
        With what the compiler said.
    """
    # zig's cache knows a file by its place, so that every file gets one that goes with its content
    include = place_of(headers)
    files = [str(place_of({name: text}) / name) for name, text in sorted(units.items())]
    with tempfile.TemporaryDirectory(prefix="gough-stewart-") as scratch:
        library = Path(scratch, LIBRARY + target.suffix)
        command = [sys.executable, "-m", "ziglang", "cc", "-target", target.triple, *FLAGS, *target.flags]
        command += ["-I", str(include), *files, "-o", str(library), "-lm"]
        code, message = _run(command, scratch, stop or Event())
        if code != 0:
            raise BuildError(f"the compiler failed for {target.name}:\n{message.strip()}")
        return library.read_bytes()


def _run(command: Sequence[str], folder: str, stop: Event) -> tuple[int, str]:
    """Exit code of a command and what it said on its error stream; in a group of its own, to be ended as a whole."""
    group: dict[str, Any] = {} if sys.platform == "win32" else {"process_group": 0}
    with subprocess.Popen(
        command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, **group
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


def cache_folder() -> Path:
    """Where sources lie for the compiler; inside zig's cache if its place is set, so that both are cleared at once."""
    zig = os.environ.get("ZIG_GLOBAL_CACHE_DIR")
    return Path(zig, "gough-stewart") if zig else user_cache_path("gough-stewart") / "build"


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
