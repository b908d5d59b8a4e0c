"""Machine code that steps many platforms at once, eight in a vector."""

import ctypes
from dataclasses import fields
from typing import Any

from gough_stewart.fmu_build.lanes import WIDTH, LanesLibrary
from gough_stewart.harness.plants.lane_batch import Batch
from gough_stewart.model.vectors import FloatArray

_ARRAYS = tuple(field.name for field in fields(Batch))


class _CBatch(ctypes.Structure):
    """`batch` of c/lanes/lanes.h."""

    _fields_ = [
        ("blocks", ctypes.c_int64),
        ("stride", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in _ARRAYS),
    ]


class CompiledLanes:
    """The library of `fmu_build.lanes`; other threads run while it works."""

    def __init__(self, library: LanesLibrary) -> None:
        self.features = library.features
        self._library = ctypes.CDLL(str(library.path))
        self._library.lanes_check.restype = self._library.lanes_step.restype = ctypes.c_int64

    def check(self, batch: Batch) -> int:
        """See `LaneKernel`."""
        return int(self._library.lanes_check(_reference(batch)))

    def step(self, batch: Batch, size: float, substeps: int, *, checked: bool = True) -> int:
        """See `LaneKernel`."""
        step, n = ctypes.c_double(size), ctypes.c_int64(substeps)
        return int(self._library.lanes_step(_reference(batch), step, n, ctypes.c_int64(not checked)))

    def signals(self, batch: Batch, out: FloatArray) -> None:
        """See `LaneKernel`."""
        self._library.lanes_signals(_reference(batch), ctypes.c_void_p(out.ctypes.data))

    def results(self, batch: Batch, out: FloatArray) -> None:
        """See `LaneKernel`."""
        self._library.lanes_results(_reference(batch), ctypes.c_void_p(out.ctypes.data))


def _reference(batch: Batch) -> Any:
    states = batch.states
    pointers = (getattr(batch, name).ctypes.data for name in _ARRAYS)
    return ctypes.byref(_CBatch(states.shape[1] // WIDTH, states.strides[0] // states.itemsize, *pointers))
