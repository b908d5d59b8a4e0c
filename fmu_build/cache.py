"""The cache of what is built: each file is made once per state of the sources, and checked by its digest.

Also the errors of the build.
"""

import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from platformdirs import user_cache_path

from gough_stewart.model.errors import GoughStewartError, NotInstalledError
from gough_stewart.model.process import installed
from gough_stewart.model.process.files import write_whole
from gough_stewart.model.process.installed import TRACER, state_of_texts

RUNNER, COMPILER = "fmpy", "ziglang"
# Packages on which what is built depends, besides the files of this package.
_PACKAGES = ("gough-stewart", "casadi", RUNNER, "latex2mathml", "numpy", "scipy", COMPILER)
_USES = {TRACER: "to trace equations", COMPILER: "to compile"}


class BuildError(GoughStewartError):
    """An FMU cannot be built: a wrong option, a package that is not installed, or a compiler error."""


def check_installed(*packages: str) -> None:
    """Raise `BuildError` if one of these packages, `TRACER` or `COMPILER`, is missing; without importing them."""
    try:
        installed.check_installed({package: _USES[package] for package in packages})
    except NotInstalledError as error:
        raise BuildError(str(error)) from None


def cache_folder() -> Path:
    """Folder of sources, objects and libraries; inside zig's cache if that is set: both are cleared together."""
    zig = os.environ.get("ZIG_GLOBAL_CACHE_DIR")
    return Path(zig, "gough-stewart") if zig else user_cache_path("gough-stewart") / "build"


def kept(path: Path, make: Callable[[], bytes]) -> Path:
    """A file of the cache, created by `make` if it is missing or does not match its stored digest.

    Several processes may create it at the same time if its content is deterministic, since it is written atomically.
    `BuildError` if it differs from what was written, `OSError` if the cache cannot be written.
    """
    digest_file = path.with_name(f"{path.name}.sha256")
    for is_new in (False, True):
        with suppress(OSError):
            if digest_file.read_bytes() == sha256(path.read_bytes()).hexdigest().encode():
                return path
        if not is_new:
            content = make()
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                write_whole(path, content)
                write_whole(digest_file, sha256(content).hexdigest().encode())
            except OSError as error:
                raise type(error)(
                    error.errno,
                    f"the cache cannot be written ({error.strerror}); set XDG_CACHE_HOME to a writable folder",
                    str(path.parent),
                ) from error
    raise BuildError(f"{path} differs from what was written there; delete the folder {path.parent}, or free disk space")


def digest_of_texts(files: Mapping[str, str]) -> str:
    """Digest of files by name, such as the C of a library."""
    return sha256("".join(f"{name}\0{text}\0" for name, text in sorted(files.items())).encode()).hexdigest()


@cache
def state_of_sources() -> str:
    """Digest of all source files of FMUs and of the versions of the packages that build them."""
    installed = {name for name in _PACKAGES if find_spec(name.replace("-", "_")) is not None}
    versions = "".join(f"{name} {version(name) if name in installed else 'not installed'}\n" for name in _PACKAGES)
    return sha256(f"{versions}{state_of_texts()}".encode()).hexdigest()[:24]
