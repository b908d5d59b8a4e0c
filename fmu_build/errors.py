"""Errors of the build."""

from gough_stewart.model.errors import GoughStewartError


class BuildError(GoughStewartError):
    """An FMU cannot be built: a wrong option, a package that is not installed, or a compiler error."""
