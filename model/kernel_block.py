"""The numbers that the kernel's functions read and write: one block of memory, the same for every host."""

import numpy as np

from gough_stewart.model.interface import N_INPUTS, N_PARAMETERS, N_RESULTS, N_STATES
from gough_stewart.model.vectors import FloatArray

# Sizes of the parts, in their order; matrices column by column.
BLOCK = {
    **{"x": N_STATES, "u": N_INPUTS, "p": N_PARAMETERS, "xdot": N_STATES, "y": N_RESULTS},
    **{"A": N_STATES * N_STATES, "B": N_STATES * N_INPUTS, "C": N_RESULTS * N_STATES, "D": N_RESULTS * N_INPUTS},
    **{"square": 6, "determinant": 1, "size": 1},
}
# Arguments and results of the functions, by the names of their parts; `traced` has each as `NAME_function`.
FUNCTIONS = {
    "derivatives": (("x", "u", "p"), ("xdot",)),
    "outputs": (("x", "u", "p"), ("y",)),
    "jacobians": (("x", "u", "p"), ("A", "B", "C", "D")),
    "margins": (("x", "p"), ("square", "determinant", "size")),
}


def new_block() -> tuple[FloatArray, dict[str, FloatArray]]:
    """A block of zeros, and its parts by name, as views."""
    block = np.zeros(sum(BLOCK.values()))
    return block, dict(zip(BLOCK, np.split(block, np.cumsum([*BLOCK.values()])[:-1]), strict=True))


def offsets() -> dict[str, int]:
    """Where the parts begin in the block."""
    return dict(zip(BLOCK, np.cumsum([0, *BLOCK.values()])[:-1].tolist(), strict=True))
