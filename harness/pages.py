"""What self-contained pages are made of: our own texts, libraries out of wheels, numbers as text."""

import base64
import json
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.vectors import Array


def asset(name: str) -> str:
    """A file of `web/`."""
    return (files("gough_stewart.harness") / "web" / name).read_text(encoding="utf-8")


def plotly() -> str:
    """plotly.js."""
    return library("plotly", "package_data/plotly.min.js")


def library(package: str, path: str) -> str:
    """A text that a package carries; found without importing the package, which would take a second.

    Raises
    ------
    GoughStewartError
        The package is missing.
    """
    spec = find_spec(package)
    if spec is None or spec.submodule_search_locations is None:
        raise GoughStewartError(f"the package '{package}' is missing; install gough-stewart with what it depends on")
    return Path(spec.submodule_search_locations[0], path).read_text(encoding="utf-8")


def packed(values: Array, kind: str = "f8") -> dict[str, str]:
    """Numbers of any shape, in C order, as base64 of little-endian ones: what plotly.js reads as an array.

    `kind` is NumPy's: "f8" keeps every bit, "f4" seven digits.
    """
    array = np.ascontiguousarray(values, dtype=f"<{kind}")
    return {"dtype": kind, "bdata": base64.b64encode(array.tobytes()).decode()}


def as_json(data: Any) -> str:
    """For a script element; no text in it can end the element."""
    return json.dumps(data, allow_nan=False, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")
