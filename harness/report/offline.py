"""An HTML file that makes no requests: its policy forbids them, and admits no script but its own.

Its JavaScript libraries are taken from installed wheels: three.js from trimesh's, BokehJS from Bokeh's.
"""

import base64
import hashlib
import json
import re
from collections.abc import Sequence
from functools import cache
from importlib.metadata import files as distributed
from importlib.metadata import version
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from gough_stewart.model.errors import GoughStewartError

_ARCHIVE, _PAGE = "resources/templates/viewer.zip", "viewer.html.template"
# The script starts with three.js; trimesh's own lines follow.
_LIBRARY = re.compile(r"<script>\s*(/\*\*\s+\* @license.*?Three\.js Authors.*?\*/\s*\n[^\n]+)\n", re.DOTALL)
_BOKEH = "server/static/js"
# The library, and its part that makes figures.
_BOKEH_FILES = ("bokeh.min.js", "bokeh-api.min.js")


def document(title: str, body: str, style: str, data: Any, scripts: Sequence[str], computes: bool = False) -> bytes:
    """A complete page.

    The title is plain text; in the body, HTML, all texts from users must be escaped. `data` becomes JSON in the element
    `data`; scripts run in their order. With `computes`, the policy admits WebAssembly, and workers from the page.
    """
    # browsers normalise line endings before they hash a script
    scripts = [script.replace("\r\n", "\n").replace("\r", "\n") for script in scripts]
    digests = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts)
    allowed = {
        "default-src": "'none'",
        "script-src": " ".join(f"'sha256-{digest}'" for digest in digests),
        "style-src": "'unsafe-inline'",
        "img-src": "data: blob:",
        "base-uri": "'none'",
        "form-action": "'none'",
    }
    if computes:
        allowed["script-src"] += " 'wasm-unsafe-eval'"
        allowed["worker-src"] = "blob:"
    written = json.dumps(data, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    page = TEMPLATES.get_template("page.html").render(
        title=title,
        policy=Markup("; ".join(f"{kind} {source}" for kind, source in allowed.items())),
        style=Markup(style),
        body=Markup(body),
        # so that no text in it can close the element
        data=Markup(written.replace("<", "\\u003c")),
        scripts=[Markup(script) for script in scripts],
    )
    # the name of a folder may not be UTF-8
    return page.encode(errors="replace")


def asset(name: str) -> str:
    """A file of the folder `web`."""
    return (files("gough_stewart.harness.report") / "web" / name).read_text(encoding="utf-8")


@cache
def three() -> str:
    """three.js, from the mesh viewer page of trimesh; defines the name THREE. Its first lines name its holders."""
    try:
        with ZipFile(_folder("trimesh") / _ARCHIVE) as archive:
            library = _LIBRARY.search(archive.read(_PAGE).decode())
    except (OSError, KeyError, BadZipFile):
        library = None
    if library is None:
        raise GoughStewartError(f"trimesh {version('trimesh')} has no three.js in {_ARCHIVE}; install trimesh 5.2.0")
    return library[1]


@cache
def bokeh() -> str:
    """BokehJS without its widgets and tables; defines the name Bokeh."""
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
    licence = licence_of("trimesh")
    return f"{holders}\n\n{licence[licence.index('Permission is hereby granted') :]}"


@cache
def licence_of(package: str) -> str:
    """The licence in a package's wheel; Bokeh's (BSD, three clauses) is the notice that it requires."""
    return next(file.read_text() for file in distributed(package) or () if file.name.startswith("LICENSE"))


def _folder(package: str) -> Path:
    """The folder of a package, without importing it, which would take a second."""
    spec = find_spec(package)
    if spec is None or spec.submodule_search_locations is None:
        raise GoughStewartError(f"the package '{package}' is missing; install gough-stewart with its dependencies")
    return Path(spec.submodule_search_locations[0])


TEMPLATES = Environment(
    loader=FunctionLoader(asset), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
)
