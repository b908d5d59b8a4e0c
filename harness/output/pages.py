"""Building blocks of self-contained pages: own web files, libraries from wheels, packed numbers."""

import base64
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.vectors import Array


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
