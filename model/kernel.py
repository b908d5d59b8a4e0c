"""The kernel: state derivatives, results and exact Jacobians of one platform, evaluated without allocation.

    ẋ = f(x, u, p),  y = g(x, u, p),  and the Jacobians A, B, C, D of (ẋ, y) with respect to (x, u)

The functions, and what is in x, u, p and y, are those of `gough_stewart.model.traced`.
"""

from collections.abc import Callable, Mapping
from functools import partial
from itertools import product
from typing import NamedTuple

from gough_stewart.model import interface
from gough_stewart.model.compiled_kernel import FUNCTIONS, PREFIX, address_of, kernel_library, new_block
from gough_stewart.model.interface import N_INPUTS
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.process.installed import TRACER, check_installed
from gough_stewart.model.variant import IDEAL, Variant
from gough_stewart.model.vectors import Array, FloatArray


class Linearisation(NamedTuple):
    """Exact Jacobians of δẋ = A δx + B δu, δy = C δx + D δu."""

    A: Array  # (12, 12)
    B: Array  # (12, 12)
    C: Array  # (N_RESULTS, 12)
    D: Array  # (N_RESULTS, 12)


def parameter_vector(parameters: Parameters, variant: Variant = IDEAL) -> FloatArray:
    """The kernel's parameter vector p of a platform: its parameters in table order, flat, row by row."""
    return interface.pack(variant.parameters, {v.name: getattr(parameters, v.name) for v in variant.parameters})


class Kernel:
    """The functions with a fixed block of memory: calls copy into it and allocate nothing.

    Every method returns a view of the block that its next call overwrites: copy the results that you keep. The
    arguments are the state x (12,), or more of a variant with more states, the inputs u (12,), and the parameters p
    (`parameter_vector`). Not thread-safe: use one Kernel per thread; they share the code.
    """

    def __init__(self, variant: Variant = IDEAL) -> None:
        self._variant = variant
        self._block, self._parts = new_block(variant)
        self._x, self._u, self._p, self._xdot, self._y = (self._parts[name] for name in ("x", "u", "p", "xdot", "y"))
        self._matrices = Linearisation(
            *(
                self._parts[name].reshape((m, n), order="F")
                for name, (m, n) in zip(
                    "ABCD", product((len(self._x), len(self._y)), (len(self._x), N_INPUTS)), strict=True
                )
            )
        )
        self._call_derivatives = self._call("derivatives")
        self._call_outputs = self._call("outputs")
        self._call_jacobians: Callable[[], object] | None = None  # may have to be traced

    def derivatives(self, x: Array, u: Array, p: Array) -> FloatArray:
        """State derivatives ẋ (12,): velocity, rates of roll, pitch, yaw, acceleration, angular acceleration."""
        self._x[:], self._u[:], self._p[:] = x, u, p
        self._call_derivatives()
        return self._xdot

    def outputs(self, x: Array, u: Array, p: Array) -> FloatArray:
        """Outputs and locals y (N_RESULTS,) in the order of `interface.RESULT_COLUMNS`."""
        self._x[:], self._u[:], self._p[:] = x, u, p
        self._call_outputs()
        return self._y

    def jacobians(self, x: Array, u: Array, p: Array) -> Linearisation:
        """Exact Jacobians at (x, u)."""
        if self._call_jacobians is None:
            self._call_jacobians = self._call("jacobians")
        self._x[:], self._u[:], self._p[:] = x, u, p
        self._call_jacobians()
        return self._matrices

    def _call(self, name: str) -> Callable[[], object]:
        """A function on the block: machine code if there is any, else CasADi."""
        library = kernel_library() if self._variant == IDEAL else None
        if library is None:
            return traced_call(name, self._parts, self._variant)
        function = getattr(library, PREFIX + name)
        function.restype = None
        return partial(function, address_of(self._block))


def traced_call(name: str, parts: Mapping[str, FloatArray], variant: Variant = IDEAL) -> Callable[[], object]:
    """A call of a traced Function on parts of a block.

    Raises
    ------
    NotInstalledError
        CasADi is not installed.
    """
    check_installed({TRACER: "to trace the equations, which are not compiled for this machine here"})
    from gough_stewart.model import traced

    arguments, results = FUNCTIONS[name]
    buffer, evaluate = getattr(traced, f"{name}_function")(variant).buffer()
    for i, part in enumerate(arguments):
        buffer.set_arg(i, parts[part].data)
    for i, part in enumerate(results):
        buffer.set_res(i, parts[part].data)

    def call(_kept: object = buffer) -> None:  # the buffer must outlive the calls
        evaluate()

    return call
