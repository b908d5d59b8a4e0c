"""Versions that must be the same wherever chunks are computed."""

import hashlib
import platform
from functools import cache
from importlib.metadata import version
from pathlib import Path

import numpy as np

import gough_stewart

_SOURCES = ("*.py", "*.c", "*.h", "*.toml")
_ROOMS = ("model", "fmu_build", "harness")


@cache
def exact_versions() -> dict[str, str]:
    """Versions of this project, its sources, Python and NumPy in this process."""
    return {
        "gough-stewart": version("gough-stewart"),
        "sources": _sources(),
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


def difference(here: dict[str, str], there: dict[str, str]) -> str:
    """Which versions differ, as text; empty if none."""
    names = [name for name in here if here[name] != there.get(name)]
    return ", ".join(f"{name} {here[name]} here and {there.get(name, 'unknown')} there" for name in names)


def _sources() -> str:
    root = Path(gough_stewart.__file__).parent
    files = sorted(
        (path.relative_to(root).as_posix(), path)
        for room in _ROOMS
        for kind in _SOURCES
        for path in (root / room).rglob(kind)
    )
    digest = hashlib.sha256()
    for name, path in files:
        digest.update(name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]
