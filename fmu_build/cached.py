"""What is built once for a state of this package: a native FMU, for those who only want to run one."""

import hashlib
import tempfile
from collections.abc import Callable
from functools import cache
from importlib import resources
from importlib.metadata import version
from importlib.resources.abc import Traversable
from pathlib import Path

from gough_stewart.fmu_build.archive import file_name
from gough_stewart.fmu_build.compiler_cache import cache_folder
from gough_stewart.fmu_build.errors import BuildError
from gough_stewart.fmu_build.extra import COMPILER, RUNNER, check_installed
from gough_stewart.fmu_build.targets import native
from gough_stewart.model.files import write_whole
from gough_stewart.model.progress import StepProgress

# What the bytes of an FMU depend on beside this package's own files.
_PACKAGES = ("gough-stewart", "casadi", RUNNER, "latex2mathml", "numpy", "scipy", COMPILER)


def cached_build(fmi_version: str, progress: StepProgress | None = None) -> Path:
    """The FMU of the paper's platform for this machine, from the cache if it was built from the same sources before.

    Its digest lies beside it: a damaged one is built anew.

    Parameters
    ----------
    fmi_version
        "2.0" or "3.0".
    progress
        Called with what is being done, if anything is.

    Raises
    ------
    BuildError
        As `build`; or the cache does not keep what is written there.
    OSError
        The cache cannot be written.
    """

    def built() -> bytes:
        from gough_stewart.fmu_build.build import build  # CasADi, and all else that a unit of the cache needs no more

        with tempfile.TemporaryDirectory(prefix="gough-stewart-") as folder:
            return build(folder, fmi=[fmi_version], progress=progress)[0].read_bytes()

    return kept(cache_folder() / "fmus" / f"{state_of_sources()}-{native().name}" / file_name(fmi_version), built)


def kept(path: Path, make: Callable[[], bytes]) -> Path:
    """A file of the cache, made unless it is there; its digest lies beside it, and a damaged one is made anew.

    Several processes may make it at once, if the content depends on nothing else: each writes beside and renames, so
    that the file never goes while another one uses it.

    Raises
    ------
    BuildError
        The cache does not keep what is written there.
    OSError
        The cache cannot be written.
    """
    digest = path.with_name(f"{path.name}.sha256")
    if not _is_whole(path, digest):
        content = make()
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, content)
        write_whole(digest, digest_of(content).encode())
        if not _is_whole(path, digest):
            raise BuildError(f"{path} is not what was written there; delete the folder {path.parent}, or free its disk")
    return path


def digest_of(content: bytes) -> str:
    """SHA-256 in hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def _is_whole(path: Path, digest: Path) -> bool:
    try:
        return digest.read_bytes() == digest_of(path.read_bytes()).encode()
    except OSError:
        return False


@cache
def state_of_sources() -> str:
    """Digest of every file of the packages that FMUs are made from, and of the versions of what makes them.

    Raises
    ------
    BuildError
        What makes them is not installed.
    """
    check_installed(RUNNER, COMPILER)
    state = hashlib.sha256()
    for package in _PACKAGES:
        state.update(f"{package} {version(package)}\n".encode())
    for package in ("gough_stewart.model", "gough_stewart.fmu_build"):
        for name, content in sorted(_files(resources.files(package), "")):
            state.update(f"{name} {len(content)}\n".encode())
            state.update(content)
    return state.hexdigest()[:24]


def _files(folder: Traversable, prefix: str) -> list[tuple[str, bytes]]:
    found = []
    for each in folder.iterdir():
        if each.is_dir() and each.name != "__pycache__":
            found += _files(each, f"{prefix}{each.name}/")
        elif each.is_file():
            found.append((prefix + each.name, each.read_bytes()))
    return found
