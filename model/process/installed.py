"""Packages of the extra `compile`, which are needed only where something new is traced or compiled."""

from collections.abc import Mapping
from importlib.util import find_spec

from gough_stewart.model.errors import NotInstalledError

TRACER = "casadi"


def check_installed(uses: Mapping[str, str]) -> None:
    """Check that packages are installed, without importing them.

    Parameters
    ----------
    uses
        What each is needed for, by its name.

    Raises
    ------
    NotInstalledError
        One is missing; the message tells what for, and how to install it.
    """
    missing = [package for package in uses if find_spec(package) is None]
    if missing:
        packages_and_uses = " and ".join(f"{package} ({uses[package]})" for package in missing)
        raise NotInstalledError(
            f"not installed: {packages_and_uses}; install the extra: pip install 'gough-stewart[compile]'"
        )
