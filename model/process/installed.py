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
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache, lru_cache
from hashlib import sha256
from importlib import resources
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from gough_stewart.model.errors import EnvironmentVariableError, NotInstalledError

TRACER = "casadi"
# The software that computes a result, beside Python.
PACKAGES = ("gough-stewart", "numpy", "scipy", "casadi", "control", "fmpy", "ziglang", "polars", "matplotlib")
# Where the files are, if there are any.
PREBUILT = Path(str(resources.files("gough_stewart").joinpath("prebuilt")))
MANIFEST = "manifest.json"
# Ending of files that are not loaded where they are: xz makes them a fifth smaller than the wheel's deflate.
PACKED = ".xz"
NOT_INSTALLED = "not installed: {}; install the extra: pip install 'gough-stewart[compile]'"
# Processor and system of this machine, such as `x86_64-linux`: FMI 3.0's platform tuple, if it is supported.
_PROCESSOR = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
THIS_MACHINE = f"{_PROCESSOR}-{platform.system().lower()}"


class CarriedFile(NamedTuple):
    """A file that came with the package."""

    path: Path
    content: bytes  # unpacked


def manifest_line(file: str, content: bytes, state: str) -> dict[str, str]:
    """The line of a file in the manifest."""
    return {"file": file, "state": state, "sha256": sha256(content).hexdigest()}


def prebuilt(name: str, state: str) -> CarriedFile | None:
    """The file of a name, made of sources of this state; None if there is none, with a warning if it is damaged."""
    line: Mapping[str, str] | None = manifest().get("files", {}).get(name)
    if line is None or line["state"] != state:
        return None
    path, content = PREBUILT / line["file"], b""
    with suppress(OSError):
        content = path.read_bytes()
    if sha256(content).hexdigest() != line["sha256"]:
        warnings.warn(f"{path} is damaged and is not used; install the package again", stacklevel=2)
        return None
    return CarriedFile(path, _unpacked(content) if path.suffix == PACKED else content)


# the units of both FMI versions have the libraries of five targets in common
_unpacked = lru_cache(maxsize=8)(lzma.decompress)


@cache
def state_of_texts(*packages: str) -> str:
    """Digest of names and contents of all source files of some packages, by default `model` and `fmu_build`."""
    folders = (Path(str(resources.files(f"gough_stewart.{name}"))) for name in packages or ("fmu_build", "model"))
    paths = (path for folder in folders for path in folder.rglob("*"))
    files = (path for path in paths if path.is_file() and path.parent.name != "__pycache__")
    digest = sha256()
    # in an order that is the same on all systems
    for path in sorted(files, key=lambda path: path.as_posix()):
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


@cache
def versions() -> Mapping[str, str]:
    """Versions of Python and of relevant packages, and the type of machine; reading them takes longer than a run."""
    installed = {"python": platform.python_version()}
    for package in PACKAGES:
        with suppress(PackageNotFoundError):  # such as those of the extra `fmu`
            installed[package] = version(package)
    return {**installed, "machine": f"{platform.system()} {platform.machine()}"}


def check_installed(uses: Mapping[str, str]) -> None:
    """Raise `NotInstalledError` if one of these packages is missing, by name with what it is needed for."""
    missing = [package for package in uses if find_spec(package) is None]
    if missing:
        packages = " and ".join(f"{package} ({uses[package]})" for package in missing)
        raise NotInstalledError(NOT_INSTALLED.format(packages))


@contextmanager
def environment(*, of_harness: bool = True) -> Iterator[None]:
    """Context for what traces equations from its first line on: `NotInstalledError` if CasADi is missing.

    That of the harness is checked first: `EnvironmentVariableError` for values that Polars and NumPy cannot read, and a
    missing backend is replaced.
    """
    for name, least, expected in (
        ("POLARS_MAX_THREADS", 1, "a number of threads of at least 1"),
        ("SOURCE_DATE_EPOCH", 0, "a whole number of seconds since 1970"),
    ):
        value = os.environ.get(name) if of_harness else None
        if value is not None and not (value.isascii() and value.isdigit() and int(value) >= least):
            raise EnvironmentVariableError(
                f"the environment variable {name} is '{value}'; expected {expected}; unset it"
            )
    # a notebook names its own backend to all commands, which may run in another environment; no window is opened here
    backend = os.environ.get("MPLBACKEND", "") if of_harness else ""
    if backend.startswith("module://"):
        try:
            is_there = find_spec(backend.removeprefix("module://")) is not None
        except (ImportError, ValueError):
            is_there = False
        if not is_there:
            os.environ["MPLBACKEND"] = "agg"
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name != TRACER:
            raise
        raise NotInstalledError(NOT_INSTALLED.format(f"{TRACER} (to trace equations)")) from None
