"""How arrays travel into a page: base64 of little-endian numbers, bit for bit."""

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.model.vectors import FloatArray


def packed(values: FloatArray) -> dict[str, Any]:
    """Numbers of any shape as the `{"dtype", "bdata", "shape"}` that plotly.js reads too; float64, bit for bit."""
    array = np.ascontiguousarray(values, dtype="<f8")
    shape = ", ".join(map(str, array.shape))
    return {"dtype": "f8", "bdata": base64.b64encode(array.tobytes()).decode(), "shape": shape}


def packed_line(values: FloatArray) -> dict[str, Any]:
    """Numbers (n,) of a drawn line; float32, seven digits of it."""
    array = np.ascontiguousarray(values, dtype="<f4")
    return {"dtype": "f4", "bdata": base64.b64encode(array.tobytes()).decode()}


def packed_flags(flags: NDArray[np.bool_]) -> str:
    """Truth values (n,) as characters 0 and 1."""
    return "".join("1" if flag else "0" for flag in flags)
