"""The members of a plant of many platforms in memory."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.fmu_build.libraries import WIDTH
from gough_stewart.model import interface
from gough_stewart.model.interface import N_INPUTS
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.variant import IDEAL, Variant
from gough_stewart.model.vectors import FloatArray

IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Batch:
    """M members, a multiple of eight, as kernels use them, see c/lanes/lanes.h; members contiguous in rows.

    All are of one variant, which gives the sizes.
    """

    parameters: FloatArray  # (M / 8, N_PARAMETERS, 8)
    states: FloatArray  # (N_STATES, M)
    inputs: FloatArray  # (N_INPUTS, M)
    running: IntArray  # (M), 0 or −1
    side: FloatArray  # (M), sign of det J, 0 where not known yet
    failure: IntArray  # (M), see `Failure`
    reached: FloatArray  # (N_STATES, M), where a member failed
    failed_after: FloatArray  # (M), time since the begin of the step [s]
    error: FloatArray  # (M), largest estimate of the error of a step so far
    proposed: FloatArray  # (M), size of the next internal step [s], 0 before the first
    internal_steps: FloatArray  # (M), so far
    variant: Variant = IDEAL

    @classmethod
    def of(cls, members: int, variant: Variant = IDEAL) -> "Batch":
        """All zeros, for at least this number of members."""
        blocks = -(-members // WIDTH)
        running, failure = (np.zeros(blocks * WIDTH, np.int64) for _ in range(2))
        # aligned to 64 bytes
        n_states, n_parameters = interface.size_of(variant.states), interface.size_of(variant.parameters)
        size = blocks * n_parameters * WIDTH
        raw = np.zeros(size + WIDTH)
        start = -raw.ctypes.data % 64 // raw.itemsize
        parameters = raw[start : start + size].reshape(blocks, n_parameters, WIDTH)
        return cls(
            parameters,
            rows(n_states, blocks),
            rows(N_INPUTS, blocks),
            running,
            np.zeros(blocks * WIDTH),
            failure,
            rows(n_states, blocks),
            np.zeros(blocks * WIDTH),
            np.zeros(blocks * WIDTH),
            np.zeros(blocks * WIDTH),
            np.zeros(blocks * WIDTH),
            variant,
        )

    @property
    def blocks(self) -> int:
        """Number of vectors that hold the members."""
        return len(self.parameters)

    def padded(self, values: NDArray[np.float64]) -> FloatArray:
        """Values of N members (N, size) as (size, M); the last member fills the last vector."""
        missing = self.blocks * WIDTH - len(values)
        return np.concatenate([values, np.repeat(values[-1:], missing, axis=0)]).T

    def put_parameter(self, name: str, values: NDArray[np.float64]) -> None:
        """Write one parameter of N members (N, *shape)."""
        padded = self.padded(values.reshape(len(values), -1))
        self._by_element[_places(self.variant)[name]] = padded.reshape(len(padded), self.blocks, WIDTH)

    def parameters_of(self, members: Any = slice(None)) -> Parameters:
        """The parameters of some members by name, with a leading axis; a copy with contiguous elements."""
        own = self._by_element
        p = own.reshape(len(own), -1)[:, members]
        return Parameters(**interface.unpack(self.variant.parameters, p.T))

    @property
    def _by_element(self) -> FloatArray:
        return np.swapaxes(self.parameters, 0, 1)


def rows(size: int, blocks: int) -> FloatArray:
    """Zeros (size, 8 `blocks`) with a stride of an odd number of vectors: see c/lanes/lanes.h."""
    return np.zeros((size, (blocks | 1) * WIDTH))[:, : blocks * WIDTH]


@cache
def _places(variant: Variant) -> Mapping[str, slice]:
    """The position of each parameter in the kernels' vector."""
    at = interface.unpack(variant.parameters, np.arange(interface.size_of(variant.parameters)))
    return {name: slice(int(places.min()), int(places.max()) + 1) for name, places in at.items()}
