"""The machine code of laws that users wrote, compiled when they run for the first time and kept."""

import ctypes
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from gough_stewart.fmu_build.cache import BuildError
from gough_stewart.fmu_build.libraries import WIDTH, law_library
from gough_stewart.harness.control.laws import Controller
from gough_stewart.harness.control.laws_of_members import Law, SeparateLaws
from gough_stewart.harness.control.makers import Maker
from gough_stewart.harness.control.traced_law import TracedLaw, is_casadi_function, traced_law_of
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.plants import signals
from gough_stewart.model.vectors import FloatArray

# Share of the largest number by which machine code may differ from the function; they differ by rounding.
_AGREES = 1e-9
_SEED, _SCALES = 1, (1e-3, 1.0)


@dataclass(frozen=True)
class CompiledLaw:
    """A traced law with its machine code."""

    law: TracedLaw
    library: ctypes.CDLL

    used = signals.NAMES

    @property
    def address(self) -> int:
        """Of its function, see c/law/law.h."""
        return ctypes.cast(self.library.law_step, ctypes.c_void_p).value or 0


def are_traced(controllers: Iterable[Controller | None]) -> bool:
    """Whether controllers are, or make, CasADi functions that machine code can have together."""
    try:
        made = [each.peek() if isinstance(each, Maker) else each for each in controllers]
    except ControllerError:  # the run says so
        return False
    return all(map(is_casadi_function, made)) and compiled_law(made) is not None


def compiled_form(law: Law) -> CompiledLaw | None:
    """`compiled_law` of the controllers of a run."""
    return compiled_law(law.traced) if isinstance(law, SeparateLaws) else None


def compiled_law(functions: list[Any] | None) -> CompiledLaw | None:
    """The laws of members from their CasADi functions; None if there is no machine code for them."""
    law = None if functions is None else traced_law_of(functions)
    if law is None:
        return None
    library = _library(law.function.serialize())
    return None if library is None else CompiledLaw(law, library)


@lru_cache(64)
def _library(serialized: str) -> ctypes.CDLL | None:
    import casadi  # who has a function of it has imported it

    function = casadi.Function.deserialize(serialized)
    try:
        library = ctypes.CDLL(str(law_library(function).path))
    except (BuildError, OSError, RuntimeError):
        return None
    gap = _gap(function, library)
    if not gap <= _AGREES:
        warnings.warn(
            f"the machine code of the controller computes forces that differ by {gap:.2g} of the largest one from its "
            "function's; it runs in Python instead, more slowly",
            stacklevel=2,
        )
        return None
    return library


def call(library: ctypes.CDLL, memory: FloatArray, following: FloatArray) -> None:
    """Write (6 + states, 8) of numbers (k, 8), see c/law/law.h."""
    at = (ctypes.c_void_p(each.ctypes.data) for each in (memory, following))
    library.law_step(*at, ctypes.c_int64(WIDTH))


def _gap(function: Any, library: ctypes.CDLL) -> float:
    """The largest difference between both, as a share of the largest number; for eight points, not alike."""
    drawn = np.random.default_rng(_SEED)
    memory = np.repeat(_SCALES, WIDTH // len(_SCALES)) * drawn.standard_normal((function.numel_in(0), WIDTH))
    ours: FloatArray = np.zeros((function.numel_out(0), WIDTH))
    call(library, memory, ours)
    theirs = np.stack([np.asarray(function(memory[:, k])).ravel() for k in range(WIDTH)], axis=1)
    known = np.isfinite(theirs)
    if not np.array_equal(known, np.isfinite(ours)):
        return np.inf
    scale = np.abs(theirs[known]).max(initial=0.0)
    return float(np.abs(ours - theirs)[known].max(initial=0.0) / scale) if scale else 0.0
