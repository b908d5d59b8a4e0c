"""What is installed where this runs: files made when the package was built, optional packages, environment variables.

A wheel carries compiled libraries and traced sources in the folder `prebuilt`, and `make` writes those of this machine
into a checkout. Each has a line in a manifest, and counts only if the sources here are those that it was made of, and
its digest is that of then. Packages of the extra `compile` are needed only where something new is traced or compiled.
"""

import json
import lzma
import os
import platform
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache, lru_cache
from hashlib import sha256
from importlib import resources
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from gough_stewart.model.errors import EnvironmentVariableError, NotInstalledError

TRACER = "casadi"
# Where the files are, if there are any.
PREBUILT = Path(str(resources.files("gough_stewart").joinpath("prebuilt")))
MANIFEST = "manifest.json"
# Ending of files that are not loaded where they are: xz makes them a fifth smaller than the wheel's deflate.
PACKED = ".xz"
_NOT_INSTALLED = "not installed: {}; install the extra: pip install 'gough-stewart[compile]'"
_PROCESSORS = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}


def this_machine() -> str:
    """Processor and system of this machine, such as `x86_64-linux`: FMI 3.0's platform tuple, if it is supported."""
    processor = platform.machine().lower()
    return f"{_PROCESSORS.get(processor, processor)}-{platform.system().lower()}"


def manifest_line(file: str, content: bytes, state: str) -> dict[str, str]:
    """The line of a file in the manifest."""
    return {"file": file, "state": state, "sha256": sha256(content).hexdigest()}


def prebuilt(name: str, state: str) -> Path | None:
    """The file of a name, made of sources of this state; None if there is none, with a warning if it is damaged."""
    line: Mapping[str, str] | None = manifest().get("files", {}).get(name)
    if line is None or line["state"] != state:
        return None
    path, is_whole = PREBUILT / line["file"], False
    with suppress(OSError):
        is_whole = sha256(path.read_bytes()).hexdigest() == line["sha256"]
    if not is_whole:
        warnings.warn(f"{path} is damaged and is not used; install the package again", stacklevel=2)
    return path if is_whole else None


def prebuilt_content(name: str, state: str) -> bytes | None:
    """The content of the packed file of a name, made of sources of this state; None if there is none."""
    path = prebuilt(name, state)
    return None if path is None else unpacked(path.read_bytes())


# the units of both FMI versions have the libraries of five targets in common
unpacked = lru_cache(maxsize=8)(lzma.decompress)


@cache
def state_of_texts() -> str:
    """Digest of all source files of the model and of its units."""
    folders = (Path(str(resources.files(f"gough_stewart.{name}"))) for name in ("fmu_build", "model"))
    paths = (path for folder in folders for path in folder.rglob("*"))
    return digest_of_files(path for path in paths if path.is_file() and path.parent.name != "__pycache__")


def digest_of_files(paths: Iterable[Path]) -> str:
    """Digest of names and contents, in an order that is the same on all systems."""
    digest = sha256()
    for path in sorted(paths, key=lambda path: path.as_posix()):
        content = path.read_bytes()
        digest.update(f"{path.name} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()


@cache
def manifest() -> Mapping[str, Any]:
    """`files`, a line for each by name, and `numbers`, arguments and results by which a library is tried; or {}."""
    try:
        lines: Mapping[str, Any] = json.loads((PREBUILT / MANIFEST).read_bytes())
    except (OSError, ValueError):
        return {}
    return lines


def check_installed(uses: Mapping[str, str]) -> None:
    """Raise `NotInstalledError` if one of these packages is missing, by name with what it is needed for."""
    missing = [package for package in uses if find_spec(package) is None]
    if missing:
        packages = " and ".join(f"{package} ({uses[package]})" for package in missing)
        raise NotInstalledError(_NOT_INSTALLED.format(packages))


@contextmanager
def tracer_is_named() -> Iterator[None]:
    """Context for what traces equations from its first line on: `NotInstalledError` if CasADi is missing."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name != TRACER:
            raise
        raise NotInstalledError(_NOT_INSTALLED.format(f"{TRACER} (to trace equations)")) from None


@cache
def check_environment() -> None:
    """Raise `EnvironmentVariableError` for values that Polars and NumPy cannot read; replace a missing backend."""
    for name, least, expected in (
        ("POLARS_MAX_THREADS", 1, "a number of threads of at least 1"),
        ("SOURCE_DATE_EPOCH", 0, "a whole number of seconds since 1970"),
    ):
        value = os.environ.get(name)
        if value is not None and not (value.isascii() and value.isdigit() and int(value) >= least):
            raise EnvironmentVariableError(
                f"the environment variable {name} is '{value}'; expected {expected}; unset it"
            )
    # a notebook names its own backend to all commands, which may run in another environment; no window is opened here
    backend = os.environ.get("MPLBACKEND", "")
    if backend.startswith("module://"):
        try:
            is_there = find_spec(backend.removeprefix("module://")) is not None
        except (ImportError, ValueError):
            is_there = False
        if not is_there:
            os.environ["MPLBACKEND"] = "agg"
