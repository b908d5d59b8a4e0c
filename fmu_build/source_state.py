"""The state of the sources of this package, on which what is built from them depends."""

import hashlib
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable

from gough_stewart.fmu_build.cache_files import digest_of


@cache
def state_of_texts() -> str:
    """Digest of all source files of the model and of its units."""
    state = hashlib.sha256()
    for package in ("gough_stewart.model", "gough_stewart.fmu_build"):
        for name, content in sorted(_files(resources.files(package), "")):
            state.update(f"{name} {len(content)}\n".encode())
            state.update(content)
    return state.hexdigest()


def state_of_files(*packages: tuple[str, ...]) -> str:
    """Digest of some source files: each package's name, followed by those of its files."""
    found = (resources.files(package).joinpath(name).read_bytes() for package, *names in packages for name in names)
    return digest_of(b"".join(found))


def _files(folder: Traversable, prefix: str) -> list[tuple[str, bytes]]:
    found = []
    for each in folder.iterdir():
        if each.is_dir() and each.name != "__pycache__":
            found += _files(each, f"{prefix}{each.name}/")
        elif each.is_file():
            found.append((prefix + each.name, each.read_bytes()))
    return found
