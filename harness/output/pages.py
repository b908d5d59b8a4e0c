"""What self-contained pages are made of: our own texts, libraries out of wheels, numbers as text."""

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
    """A whole page that asks nobody for anything: its policy forbids it, and lets no script run but these.

    Parameters
    ----------
    title
        Plain text.
    body
        HTML, of which every text of a user is escaped.
    style
        CSS, besides that of all pages.
    data
        What the scripts find in the element `data`, as JSON.
    scripts
        In their order.
    """
    # a browser reads any end of a line as this one before it looks at a script
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
        # no text in it can end the element
        data=json.dumps(data, allow_nan=False, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c"),
        scripts="\n".join(f"<script>{script}</script>" for script in scripts),
    )
    return page.encode()


def asset(room: str, name: str) -> str:
    """A file of the folder `web` of a room."""
    return (files(f"gough_stewart.harness.{room}") / "web" / name).read_text(encoding="utf-8")


def plotly() -> str:
    """plotly.js."""
    return (place_of("plotly") / "package_data/plotly.min.js").read_text(encoding="utf-8")


def place_of(package: str) -> Path:
    """The folder of a package; found without importing it, which would take a second.

    Raises
    ------
    GoughStewartError
        The package is missing.
    """
    spec = find_spec(package)
    if spec is None or spec.submodule_search_locations is None:
        raise GoughStewartError(f"the package '{package}' is missing; install gough-stewart with what it depends on")
    return Path(spec.submodule_search_locations[0])


def packed(values: Array, kind: str = "f8") -> dict[str, str]:
    """Numbers of any shape, in C order, as base64 of little-endian ones: what plotly.js reads as an array.

    `kind` is NumPy's: "f8" keeps every bit, "f4" seven digits.
    """
    with np.errstate(over="ignore"):  # what float32 cannot hold is infinite, and a gap in a line
        array = np.ascontiguousarray(values, dtype=f"<{kind}")
    return {"dtype": kind, "bdata": base64.b64encode(array.tobytes()).decode()}
