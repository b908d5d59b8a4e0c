"""The installed package: version, summary, license."""

from functools import cache
from importlib.metadata import Distribution, PackageMetadata, distributions

from gough_stewart.fmu_build.errors import BuildError

_NAME, _LICENSE = "gough-stewart", "licenses/LICENSE"


def package_metadata() -> PackageMetadata:
    """The metadata from pyproject.toml."""
    return _installed()[0].metadata


def package_license() -> str:
    """The text of LICENSE."""
    return _installed()[1]


@cache
def _installed() -> tuple[Distribution, str]:
    """The installed distribution and its license; a checkout has another of the same name, without license."""
    for found in distributions(name=_NAME):
        text = found.read_text(_LICENSE)
        if text:
            return found, text
    raise BuildError(f"{_NAME} is installed without its license; reinstall it with pip")
