"""The library of a plant's functions as machine code, made by `gough_stewart.fmu_build.kernel_library`.

Of the ideal plant it has the functions of the kernel, each as `evaluate_NAME(block)` on a block of numbers, and the
stepper (`compiled_stepper`); it comes with the package, and counts if it was made of the sources that are here and
computes what it should.
"""

import ctypes
import warnings
from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np

from gough_stewart.model import interface
from gough_stewart.model.interface import N_INPUTS
from gough_stewart.model.process.prebuilt import digest_of_files, prebuilt, prebuilt_numbers, this_machine
from gough_stewart.model.variant import IDEAL, Variant
from gough_stewart.model.vectors import FloatArray

PREFIX = "evaluate_"
# Arguments and results of the functions, by the names of their parts; `traced` has each as `NAME_function`.
FUNCTIONS = {
    "derivatives": (("x", "u", "p"), ("xdot",)),
    "outputs": (("x", "u", "p"), ("y",)),
    "jacobians": (("x", "u", "p"), ("A", "B", "C", "D")),
}
# Share of the largest number by which an evaluation may differ from the shipped one; it differs by rounding.
_AGREES = 1e-12
# Of `fmu_build`, what the library is made of besides the equations.
_SOURCES = (".", "plant", "c/plant", "c/unit", "c/kernel", "c/stepper")


def sizes_of(variant: Variant) -> dict[str, int]:
    """Sizes of the parts of a block, in their order; matrices column by column."""
    n, q, m = (interface.size_of(variables) for variables in (variant.states, variant.parameters, variant.results))
    sizes = {"x": n, "u": N_INPUTS, "p": q, "xdot": n, "y": m}
    return sizes | {"A": n * n, "B": n * N_INPUTS, "C": m * n, "D": m * N_INPUTS}


def new_block(variant: Variant = IDEAL) -> tuple[FloatArray, dict[str, FloatArray]]:
    """A block of zeros, and its parts by name, as views."""
    sizes = sizes_of(variant)
    block = np.zeros(sum(sizes.values()))
    return block, dict(zip(sizes, np.split(block, np.cumsum([*sizes.values()])[:-1]), strict=True))


@cache
def kernel_state() -> str:
    """Digest of all sources of the library."""
    build, model = (Path(str(resources.files(f"gough_stewart.{name}"))) for name in ("fmu_build", "model"))
    folders = [*(build / folder for folder in _SOURCES), model]
    files = (path for folder in folders for path in folder.iterdir())
    return digest_of_files(path for path in files if path.suffix in (".py", ".c", ".h"))


@cache
def kernel_library() -> ctypes.PyDLL | None:
    """The library of the ideal plant that came with the package; None if there is none, or with a warning if it fails.

    It keeps the interpreter's lock: a call takes a microsecond.
    """
    path = prebuilt(f"{this_machine()}/kernel", kernel_state())
    if path is None:
        return None
    try:
        library = ctypes.PyDLL(str(path))
        gap = _gap(library)
    except (OSError, AttributeError) as error:
        warnings.warn(f"{path} does not load here, and CasADi evaluates the equations: {error}", stacklevel=2)
        return None
    if not gap <= _AGREES:
        warnings.warn(
            f"{path} differs by {gap:.2g} from the numbers that came with it, and CasADi evaluates the equations",
            stacklevel=2,
        )
        return None
    return library


def processor_level() -> int | None:
    """The level of x86-64 that this processor and its system support, 1 to 4; 0 on others, None if not known."""
    library = kernel_library()
    return None if library is None else int(library.processor_level())


def address_of(block: FloatArray) -> ctypes.c_void_p:
    """The argument of the functions; the block must live as long as it is used."""
    return ctypes.c_void_p(block.ctypes.data)


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
