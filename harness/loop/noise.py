"""White noise of the sensors: numbers of c/loop/noise.h, each a function of seed, reading and element alone."""

import ctypes

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray

from gough_stewart.harness.loop.loop_library import loop_kernel
from gough_stewart.harness.loop.seeds import Seeds
from gough_stewart.model.interface import IDEAL
from gough_stewart.model.vectors import FloatArray


def streams_of(seeds: Seeds) -> NDArray[np.int64]:
    """The streams (4, N) of the members' seeds, or (4, 1) of one seed for all: words of 32 bits."""
    several = seeds if isinstance(seeds, tuple) else (seeds,)
    sequences = (seed if isinstance(seed, SeedSequence) else SeedSequence(seed) for seed in several)
    return np.array([sequence.generate_state(4) for sequence in sequences], np.int64).T.copy()


def standard_normal(streams: NDArray[np.int64], readings: range, elements: range) -> FloatArray:
    """Normal numbers (readings, elements, N) of streams (4, N): of consecutive readings, and elements of all signals.

    Raises
    ------
    BuildError, OSError
        As `loop_library`.
    """
    n = streams.shape[1]
    noise = np.zeros((len(readings), len(elements), n))
    sizes = (n, readings.start, len(readings), elements.start, len(elements))
    loop_kernel(IDEAL).library.loop_noise(
        ctypes.c_void_p(streams.ctypes.data), *map(ctypes.c_int64, sizes), ctypes.c_void_p(noise.ctypes.data)
    )
    return noise
