"""The kernel: state derivatives, results and exact Jacobians of one platform, evaluated without allocation.

    ẋ = f(x, u, p),  y = g(x, u, p),  and the Jacobians A, B, C, D of (ẋ, y) with respect to (x, u)

The functions, and what is in x, u, p and y, are those of `gough_stewart.model.traced`. Those of the ideal plant come
with the package as machine code, made by `gough_stewart.fmu_build.libraries`: each as `evaluate_NAME(block)` on a
block of numbers, in one library with the stepper of `stepping`. The library counts if it was made of the
sources that are here and computes what it should; without it, CasADi evaluates the functions.
"""

import ctypes
import warnings
from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.model import interface
from gough_stewart.model.interface import IDEAL, N_INPUTS, Variant
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.process.installed import (
    THIS_MACHINE,
    TRACER,
    check_installed,
    manifest,
    prebuilt,
    state_of_texts,
)
from gough_stewart.model.vectors import Array, FloatArray

PREFIX = "evaluate_"
# Arguments and results of the functions, by the names of their parts; `traced_function` makes each.
FUNCTIONS = {
    "derivatives": (("x", "u", "p"), ("xdot",)),
    "outputs": (("x", "u", "p"), ("y",)),
    "jacobians": (("x", "u", "p"), ("A", "B", "C", "D")),
}
# Share of the largest number by which an evaluation may differ from the shipped one; it differs by rounding.
_AGREES = 1e-12


def new_block(variant: Variant = IDEAL) -> tuple[FloatArray, dict[str, FloatArray]]:
    """A block of zeros, and its parts by name in their order, as views; matrices column by column."""
    n, q, m = variant.n_states, variant.n_parameters, variant.n_results
    sizes = {"x": n, "u": N_INPUTS, "p": q, "xdot": n, "y": m}
    sizes |= {"A": n * n, "B": n * N_INPUTS, "C": m * n, "D": m * N_INPUTS}
    block = np.zeros(sum(sizes.values()))
    return block, dict(zip(sizes, np.split(block, np.cumsum([*sizes.values()])[:-1]), strict=True))


@cache
def kernel_library() -> ctypes.PyDLL | None:
    """The library of the ideal plant that came with the package; None if there is none, or with a warning if it fails.

    It keeps the interpreter's lock: a call takes microseconds. It fails if it does not compute what came with it.
    """
    carried = prebuilt(f"{THIS_MACHINE}/kernel", state_of_texts())
    if carried is None:
        return None
    path, shipped, (block, parts), gap = carried.path, manifest().get("numbers", {}), new_block(), 0.0
    for name in ("x", "u", "p"):
        parts[name][:] = shipped[name]
    try:
        library = ctypes.PyDLL(str(path))
        for name, (_, results) in FUNCTIONS.items():
            getattr(library, PREFIX + name)(block.ctypes.data_as(ctypes.c_void_p))
            for part in results:
                expected = np.array(shipped[part])
                # as a share of the largest number of a part
                gap = max(gap, float(np.max(np.abs(parts[part] - expected)) / np.max(np.abs(expected))))
    except (OSError, AttributeError) as error:
        warnings.warn(f"{path} does not load here, and CasADi evaluates the equations: {error}", stacklevel=2)
        return None
    if not gap <= _AGREES:
        differs = f"{path} differs by {gap:.2g} from the numbers that came with it"
        warnings.warn(f"{differs}, and CasADi evaluates the equations", stacklevel=2)
        return None
    return library


class Linearisation(NamedTuple):
    """Exact Jacobians of δẋ = A δx + B δu, δy = C δx + D δu."""

    A: Array  # (12, 12)
    B: Array  # (12, 12)
    C: Array  # (N_RESULTS, 12)
    D: Array  # (N_RESULTS, 12)


def parameter_vector(parameters: Parameters, variant: Variant = IDEAL) -> FloatArray:
    """The kernel's parameter vector p of a platform: its parameters in table order, flat, row by row."""
    return interface.pack(variant.parameters, vars(parameters))


class Kernel:
    """The functions with a fixed block of memory: calls copy into it and allocate nothing.

    Methods return views of the block, which the next call overwrites. Arguments are the state x (12,), or more, the
    inputs u (12,), and p of `parameter_vector`. Not thread-safe: use one Kernel per thread; they share the code.
    """

    def __init__(self, variant: Variant = IDEAL) -> None:
        self._variant = variant
        self._block, self._parts = new_block(variant)
        self._calls: dict[str, Callable[[], object]] = {}

    def derivatives(self, x: Array, u: Array, p: Array) -> FloatArray:
        """State derivatives ẋ (12,): velocity, rates of roll, pitch, yaw, acceleration, angular acceleration."""
        return self._evaluate("derivatives", x, u, p)["xdot"]

    def outputs(self, x: Array, u: Array, p: Array) -> FloatArray:
        """Outputs and locals y (N_RESULTS,) in the order of `interface.RESULT_COLUMNS`."""
        return self._evaluate("outputs", x, u, p)["y"]

    def jacobians(self, x: Array, u: Array, p: Array) -> Linearisation:
        """Exact Jacobians at (x, u)."""
        parts = self._evaluate("jacobians", x, u, p)
        n, m = len(parts["x"]), len(parts["y"])
        shapes = {"A": (n, n), "B": (n, N_INPUTS), "C": (m, n), "D": (m, N_INPUTS)}
        return Linearisation(*(parts[name].reshape(shape, order="F") for name, shape in shapes.items()))

    def _evaluate(self, name: str, x: Array, u: Array, p: Array) -> dict[str, FloatArray]:
        parts = self._parts
        if name not in self._calls:
            library = kernel_library() if self._variant == IDEAL else None
            if library is None:
                self._calls[name] = traced_call(name, parts, self._variant)
            else:
                function = getattr(library, PREFIX + name)
                function.restype = None
                self._calls[name] = partial(function, self._block.ctypes.data_as(ctypes.c_void_p))
        parts["x"][:], parts["u"][:], parts["p"][:] = x, u, p
        self._calls[name]()
        return parts


def traced_call(name: str, parts: Mapping[str, FloatArray], variant: Variant = IDEAL) -> Callable[[], object]:
    """A call of a traced Function on parts of a block; `NotInstalledError` without CasADi."""
    check_installed({TRACER: "to trace the equations, which are not compiled for this machine here"})
    from gough_stewart.model.traced import traced_function

    arguments, results = FUNCTIONS[name]
    function: Any = traced_function(name, variant)  # its buffer takes any memory, which its types do not say
    buffer, evaluate = function.buffer()
    for i, part in enumerate(arguments):
        buffer.set_arg(i, parts[part].data)
    for i, part in enumerate(results):
        buffer.set_res(i, parts[part].data)

    def call(_kept: object = buffer) -> None:  # the buffer must outlive the calls
        evaluate()

    return call
