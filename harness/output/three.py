"""three.js, out of the page in which trimesh shows meshes: a wheel of under a megabyte that needs NumPy only."""

import re
from functools import cache
from importlib.metadata import files, version
from zipfile import BadZipFile, ZipFile

from gough_stewart.harness.output.pages import place_of
from gough_stewart.model.errors import GoughStewartError

_ARCHIVE, _PAGE = "resources/templates/viewer.zip", "viewer.html.template"
# The script begins with it; what follows in it are trimesh's own lines.
_LIBRARY = re.compile(r"<script>\s*(/\*\*\s+\* @license.*?Three\.js Authors.*?\*/\s*\n[^\n]+)\n", re.DOTALL)


@cache
def three() -> str:
    """The library, minified, which makes the global name THREE; its first lines name the holders of its copyright.

    Raises
    ------
    GoughStewartError
        The package trimesh is missing, or has it elsewhere.
    """
    try:
        with ZipFile(place_of("trimesh") / _ARCHIVE) as archive:
            found = _LIBRARY.search(archive.read(_PAGE).decode())
    except (OSError, KeyError, BadZipFile):
        found = None
    if found is None:
        raise GoughStewartError(f"trimesh {version('trimesh')} has no three.js in {_ARCHIVE}; expected that of 5.2.0")
    return found[1]


def three_licence() -> str:
    """What the MIT licence wants to go along: the holders of the copyright, and the permission, in trimesh's copy."""
    holders = three().partition("*/")[0].lstrip("/").replace("*", "").strip()
    licence = next(file.read_text() for file in files("trimesh") or () if file.name.startswith("LICENSE"))
    return f"{holders}\n\n{licence[licence.index('Permission is hereby granted') :]}"
