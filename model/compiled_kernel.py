"""The kernel's functions as machine code, if it was made of these sources and computes what it should here.

The library has the functions of `kernel_block.FUNCTIONS`, each as `evaluate_NAME(block)` on a block of numbers. It is
made by `gough_stewart.fmu_build.kernel_library`.
"""

import ctypes
import warnings
from functools import cache
from pathlib import Path

import numpy as np

from gough_stewart.model.kernel_block import FUNCTIONS, new_block
from gough_stewart.model.process.prebuilt import (
    prebuilt,
    prebuilt_numbers,
    state_of_package,
    this_machine,
)
from gough_stewart.model.vectors import FloatArray

PREFIX = "evaluate_"
# Share of the largest number by which an evaluation may differ from the shipped one; it differs by rounding.
_AGREES = 1e-12


@cache
def kernel_library() -> ctypes.PyDLL | None:
    """The library for this machine; None if there is none, or, with a warning, if it does not work here."""
    path = prebuilt(f"{this_machine()}/kernel", state_of_package("gough_stewart.model"))
    return None if path is None else _tried(path)


def processor_level() -> int | None:
    """The level of x86-64 that this processor and its system support, 1 to 4; 0 on others, None if not known."""
    library = kernel_library()
    return None if library is None else int(library.processor_level())


def _tried(path: Path) -> ctypes.PyDLL | None:
    """The library, if it gives the numbers that were shipped with it."""
    try:
        library = ctypes.PyDLL(str(path))  # keeps the interpreter's lock: a call takes a microsecond
        gap = _gap(library)
    except (OSError, AttributeError) as error:
        warnings.warn(f"{path} does not load here, and CasADi evaluates the equations: {error}", stacklevel=3)
        return None
    if not gap <= _AGREES:
        warnings.warn(
            f"{path} differs by {gap:.2g} from the numbers that came with it, and CasADi evaluates the equations",
            stacklevel=3,
        )
        return None
    return library


def _gap(library: ctypes.PyDLL) -> float:
    """The largest difference from the shipped evaluation, as a share of the largest number of a part."""
    shipped, (block, parts), gap = prebuilt_numbers(), new_block(), 0.0
    for name in ("x", "u", "p"):
        parts[name][:] = shipped[name]
    for name, (_, results) in FUNCTIONS.items():
        getattr(library, PREFIX + name)(address_of(block))
        for part in results:
            expected = np.array(shipped[part])
            gap = max(gap, float(np.max(np.abs(parts[part] - expected)) / np.max(np.abs(expected))))
    return gap


def address_of(block: FloatArray) -> ctypes.c_void_p:
    """The argument of the functions; the block must live as long as it is used."""
    return ctypes.c_void_p(block.ctypes.data)
