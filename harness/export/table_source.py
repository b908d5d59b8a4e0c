"""C source of a motion from a table: the splines' polynomials, and their evaluation in constant time."""

import re

import numpy as np

from gough_stewart.harness.export.relative import Home
from gough_stewart.harness.export.single import halves
from gough_stewart.harness.export.texts import filled, number, numbers, read
from gough_stewart.harness.motion.motion import ROUNDING, Piecewise
from gough_stewart.model.vectors import FloatArray

_TEXT = read("table.c")


def array_bytes(text: str, size: int) -> int:
    """What the constant arrays of a text take; a double in it takes `size` bytes, a float or an integer 4."""
    arrays = re.findall(r"^static const (\w+) \w+(?:\[\w+\])+ = \{(.*?)\};", text, re.M | re.S)
    return sum((size if kind == "double" else 4) * len(re.findall(r"[^\s{},]+", array)) for kind, array in arrays)


def table_of(reference: Piecewise, home: Home | None = None) -> str:
    """The table and its evaluation; in single precision poses are relative to home, and times are pairs."""
    begins, pieces = reference.pieces
    n = len(begins)
    end, end_low = reference.end, 0.0
    low = np.zeros(n)
    if home is not None:
        pieces = pieces.copy()
        pieces[:, :, 5] -= home.pose
        end, end_low = halves(end)
        begins, low = parted(begins)
    rows = ["    {" + ", ".join("{" + numbers(each) + "}" for each in piece) + "}," for piece in pieces]
    facts: dict[str, str | bool] = {
        "END": number(end),
        "END_LOW": number(end_low),
        "ROUNDING": number(ROUNDING),
        "N": str(n),
        "BEGINS": numbers(begins),
        "BEGINS_LOW": numbers(low),
        "PIECES": "\n".join(rows),
        "STEP": str(first_step(n)),
        "single": home is not None,
    }
    return filled(_TEXT, facts)


def parted(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Numbers (n,) as sums of two of single precision."""
    high = values.astype(np.float32).astype(float)
    return high, (values - high).astype(np.float32).astype(float)


def first_step(n: int) -> int:
    """Of a search among n values by halves: the largest power of 2 below n."""
    step = 1
    while 2 * step < n:
        step *= 2
    return step
