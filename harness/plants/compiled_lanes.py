"""The lane kernel in machine code: many platforms at once, eight per vector."""

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
    """The library of `fmu_build.lanes`; it releases the GIL while it works."""

    def __init__(self, library: LanesLibrary) -> None:
        self.features = library.features
        self.library = ctypes.CDLL(str(library.path))
        self.library.lanes_check.restype = self.library.lanes_step.restype = ctypes.c_int64

    def check(self, batch: Batch) -> int:
        """See `LaneKernel`."""
        return int(self.library.lanes_check(reference(batch)))

    def step(
        self, batch: Batch, size: float, substeps: int, signals: FloatArray | None = None, *, plain: bool = False
    ) -> int:
        """See `LaneKernel`."""
        out = ctypes.c_void_p(None if signals is None else signals.ctypes.data)
        numbers = ctypes.c_double(size), ctypes.c_int64(substeps), ctypes.c_int64(plain)
        return int(self.library.lanes_step(reference(batch), *numbers, out))

    def signals(self, batch: Batch, out: FloatArray) -> None:
        """See `LaneKernel`."""
        self.library.lanes_signals(reference(batch), ctypes.c_void_p(out.ctypes.data))

    def results(self, batch: Batch, out: FloatArray) -> None:
        """See `LaneKernel`."""
        self.library.lanes_results(reference(batch), ctypes.c_void_p(out.ctypes.data))


def reference(batch: Batch) -> Any:
    """The argument of the library's functions; it must live as long as the batch is used."""
    states = batch.states
    pointers = (getattr(batch, name).ctypes.data for name in _ARRAYS)
    return ctypes.byref(_CBatch(states.shape[1] // WIDTH, states.strides[0] // states.itemsize, *pointers))
