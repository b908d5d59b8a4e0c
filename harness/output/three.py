"""three.js, taken from the mesh viewer page of trimesh: a wheel of under a megabyte that needs only NumPy."""

import re
from functools import cache
from importlib.metadata import files, version
from zipfile import BadZipFile, ZipFile

from gough_stewart.harness.output.pages import place_of
from gough_stewart.model.errors import GoughStewartError

_ARCHIVE, _PAGE = "resources/templates/viewer.zip", "viewer.html.template"
# The script starts with three.js; trimesh's own lines follow.
_LIBRARY = re.compile(r"<script>\s*(/\*\*\s+\* @license.*?Three\.js Authors.*?\*/\s*\n[^\n]+)\n", re.DOTALL)


@cache
def three() -> str:
    """The minified library, which defines the global name THREE; its first lines name the copyright holders.

    Raises
    ------
    GoughStewartError
        The package trimesh is missing, or has no three.js in the expected place.
    """
    try:
        with ZipFile(place_of("trimesh") / _ARCHIVE) as archive:
            found = _LIBRARY.search(archive.read(_PAGE).decode())
    except (OSError, KeyError, BadZipFile):
        found = None
    if found is None:
        raise GoughStewartError(f"trimesh {version('trimesh')} has no three.js in {_ARCHIVE}; install trimesh 5.2.0")
    return found[1]


def three_licence() -> str:
    """The copyright and permission notices that the MIT licence requires, from trimesh's copy."""
    holders = three().partition("*/")[0].lstrip("/").replace("*", "").strip()
    licence = next(file.read_text() for file in files("trimesh") or () if file.name.startswith("LICENSE"))
    return f"{holders}\n\n{licence[licence.index('Permission is hereby granted') :]}"
