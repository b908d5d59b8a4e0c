"""Building blocks of self-contained pages: own web files, libraries from wheels, packed numbers."""

import base64
import hashlib
import html
import json
from collections.abc import Sequence
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.vectors import Array


def document(title: str, body: str, style: str, data: Any, scripts: Sequence[str]) -> bytes:
    """A complete page that makes no requests; its policy forbids them, and allows only these scripts to run.

    Parameters
    ----------
    title
        Plain text.
    body
        HTML; all texts from users must be escaped.
    style
        CSS, in addition to the CSS of all pages.
    data
        Data for the scripts, as JSON in the element `data`.
    scripts
        JavaScript, in the order of execution.
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
    page = Template(asset("output", "page.html")).substitute(
        title=html.escape(title),
        policy="; ".join(f"{what} {source}" for what, source in allowed.items()),
        style=asset("output", "page.css") + style,
        body=body,
        # so that no text in it can close the element
        data=json.dumps(data, allow_nan=False, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c"),
        scripts="\n".join(f"<script>{script}</script>" for script in scripts),
    )
    # the name of a folder may not be UTF-8
    return page.encode(errors="replace")


def asset(room: str, name: str) -> str:
    """A file of the folder `web` of a room."""
    return (files(f"gough_stewart.harness.{room}") / "web" / name).read_text(encoding="utf-8")


def plotly() -> str:
    """plotly.js."""
    return (place_of("plotly") / "package_data/plotly.min.js").read_text(encoding="utf-8")


def place_of(package: str) -> Path:
    """The folder of a package, without importing it, which would take a second.

    Raises
    ------
    GoughStewartError
        The package is missing.
    """
    spec = find_spec(package)
    if spec is None or spec.submodule_search_locations is None:
        raise GoughStewartError(f"the package '{package}' is missing; install gough-stewart with its dependencies")
    return Path(spec.submodule_search_locations[0])


def packed(values: Array, kind: str = "f8") -> dict[str, str]:
    """Numbers of any shape as base64, in C order and little-endian: plotly.js reads it as an array.

    `kind` is a NumPy type: "f8" keeps all bits, "f4" seven digits.
    """
    with np.errstate(over="ignore"):  # overflow in float32 becomes infinite, and a gap in a line
        array = np.ascontiguousarray(values, dtype=f"<{kind}")
    return {"dtype": kind, "bdata": base64.b64encode(array.tobytes()).decode()}
