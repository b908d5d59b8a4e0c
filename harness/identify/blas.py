"""One thread for linear algebra: its matrices are small, and threads that wait for each other cost 20 times as much."""

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy.linalg._umath_linalg as numpy_library
import scipy.linalg._fblas as scipy_library

# NumPy and SciPy have an OpenBLAS each; other libraries of linear algebra keep their threads.
_PREFIXES, _SUFFIXES = ("scipy_openblas", "openblas"), ("64_", "")


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit OpenBLAS to one thread for the time of a block."""
    before = [(set_number, get_number()) for get_number, set_number in _controls()]
    for set_number, _ in before:
        set_number(1)
    try:
        yield
    finally:
        for set_number, number in before:
            set_number(number)


@cache
def _controls() -> tuple[tuple[Any, Any], ...]:
    """Functions that get and set the number of threads, of each OpenBLAS that is loaded."""
    controls = []
    for module in (numpy_library, scipy_library):
        library = ctypes.CDLL(module.__file__)
        for name in (f"{prefix}_{{}}_num_threads{suffix}" for prefix in _PREFIXES for suffix in _SUFFIXES):
            if hasattr(library, name.format("set")) and hasattr(library, name.format("get")):
                controls.append((getattr(library, name.format("get")), getattr(library, name.format("set"))))
    return tuple(controls)
