"""The installed package: version, summary, license."""

from functools import cache
from importlib.metadata import Distribution, PackageMetadata, distributions

from gough_stewart.fmu_build.errors import BuildError

_NAME, _LICENSE = "gough-stewart", "licenses/LICENSE"


def package_metadata() -> PackageMetadata:
    """The metadata from pyproject.toml."""
    return _distribution().metadata


def package_license() -> str:
    """The text of LICENSE."""
    return _distribution().read_text(_LICENSE) or ""


@cache
def _distribution() -> Distribution:
    """The installed distribution; a checkout has another of the same name, without license."""
    for found in distributions(name=_NAME):
        if found.read_text(_LICENSE):
            return found
    raise BuildError(f"{_NAME} is installed without its license; reinstall it with pip")
