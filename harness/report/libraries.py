"""JavaScript libraries of the page, taken from installed wheels: three.js from trimesh's, BokehJS from Bokeh's."""

import re
from functools import cache
from importlib.metadata import files, version
from importlib.util import find_spec
from pathlib import Path
from zipfile import BadZipFile, ZipFile

from gough_stewart.model.errors import GoughStewartError

_ARCHIVE, _PAGE = "resources/templates/viewer.zip", "viewer.html.template"
# The script starts with three.js; trimesh's own lines follow.
_LIBRARY = re.compile(r"<script>\s*(/\*\*\s+\* @license.*?Three\.js Authors.*?\*/\s*\n[^\n]+)\n", re.DOTALL)
_BOKEH = "server/static/js"
# The library, and its part that makes figures.
_BOKEH_FILES = ("bokeh.min.js", "bokeh-api.min.js")


@cache
def three() -> str:
    """three.js, from the mesh viewer page of trimesh; defines the name THREE. Its first lines name its holders.

    Raises
    ------
    GoughStewartError
        The package trimesh is missing, or has no three.js in the expected place.
    """
    try:
        with ZipFile(_folder("trimesh") / _ARCHIVE) as archive:
            found = _LIBRARY.search(archive.read(_PAGE).decode())
    except (OSError, KeyError, BadZipFile):
        found = None
    if found is None:
        raise GoughStewartError(f"trimesh {version('trimesh')} has no three.js in {_ARCHIVE}; install trimesh 5.2.0")
    return found[1]


@cache
def bokeh() -> str:
    """BokehJS without its widgets and tables; defines the name Bokeh.

    Raises
    ------
    GoughStewartError
        The package bokeh is missing, or has no such scripts.
    """
    folder = _folder("bokeh") / _BOKEH
    try:
        return "\n".join((folder / name).read_text(encoding="utf-8") for name in _BOKEH_FILES)
    except OSError:
        raise GoughStewartError(
            f"bokeh {version('bokeh')} has no {' or '.join(_BOKEH_FILES)} in {_BOKEH}; install bokeh 3.9.2"
        ) from None


def three_licence() -> str:
    """The copyright and permission notices that the MIT licence requires, from trimesh's copy."""
    holders = three().partition("*/")[0].lstrip("/").replace("*", "").strip()
    licence = _licence_of("trimesh")
    return f"{holders}\n\n{licence[licence.index('Permission is hereby granted') :]}"


def bokeh_licence() -> str:
    """The notices that Bokeh's licence (BSD, three clauses) requires."""
    return f"BokehJS\n{_licence_of('bokeh')}"


@cache
def _licence_of(package: str) -> str:
    return next(file.read_text() for file in files(package) or () if file.name.startswith("LICENSE"))


def _folder(package: str) -> Path:
    """The folder of a package, without importing it, which would take a second."""
    spec = find_spec(package)
    if spec is None or spec.submodule_search_locations is None:
        raise GoughStewartError(f"the package '{package}' is missing; install gough-stewart with its dependencies")
    return Path(spec.submodule_search_locations[0])
