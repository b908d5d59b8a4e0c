"""The numbers that the kernel's functions read and write: one block of memory, the same for every host."""

import numpy as np

from gough_stewart.model import interface
from gough_stewart.model.interface import N_INPUTS
from gough_stewart.model.variant import IDEAL, Variant
from gough_stewart.model.vectors import FloatArray


def sizes_of(variant: Variant) -> dict[str, int]:
    """Sizes of the parts, in their order; matrices column by column."""
    n, q, m = (interface.size_of(each) for each in (variant.states, variant.parameters, variant.results))
    sizes = {"x": n, "u": N_INPUTS, "p": q, "xdot": n, "y": m}
    sizes |= {"A": n * n, "B": n * N_INPUTS, "C": m * n, "D": m * N_INPUTS, "square": 6, "determinant": 1, "size": 1}
    return sizes | ({"decay": 6, "gain": 36, "ratio": 6, "reach": 6, "sliding": 6} if variant.bristles else {})


# Of the ideal plant, for which there is machine code.
BLOCK = sizes_of(IDEAL)
# Arguments and results of the functions, by the names of their parts; `traced` has each as `NAME_function`.
FUNCTIONS = {
    "derivatives": (("x", "u", "p"), ("xdot",)),
    "outputs": (("x", "u", "p"), ("y",)),
    "jacobians": (("x", "u", "p"), ("A", "B", "C", "D")),
    "margins": (("x", "p"), ("square", "determinant", "size")),
}
OF_BRISTLES = {
    "decays": (("x", "p"), ("decay",)),
    "grip": (("x", "p"), ("decay", "gain", "ratio", "reach", "sliding")),
    "sliding": (("x", "p"), ("sliding",)),
}


def new_block(variant: Variant = IDEAL) -> tuple[FloatArray, dict[str, FloatArray]]:
    """A block of zeros, and its parts by name, as views."""
    sizes = sizes_of(variant)
    block = np.zeros(sum(sizes.values()))
    return block, dict(zip(sizes, np.split(block, np.cumsum([*sizes.values()])[:-1]), strict=True))


def offsets() -> dict[str, int]:
    """Where the parts begin in the block."""
    return dict(zip(BLOCK, np.cumsum([0, *BLOCK.values()])[:-1].tolist(), strict=True))
