"""The installed package: version, summary, license."""

from functools import cache
from importlib.metadata import Distribution, PackageMetadata, distributions

from gough_stewart.fmu_build.errors import BuildError

_NAME, _LICENSE = "gough-stewart", "licenses/LICENSE"


def package_metadata() -> PackageMetadata:
    """What pyproject.toml says."""
    return _distribution().metadata


def package_license() -> str:
    """The text of LICENSE."""
    return _distribution().read_text(_LICENSE) or ""


@cache
def _distribution() -> Distribution:
    """The installed one: a checkout has a second of the same name beside it, left there by the installation."""
    for found in distributions(name=_NAME):
        if found.read_text(_LICENSE):
            return found
    raise BuildError(f"{_NAME} is not installed with its license; install it again with pip")
