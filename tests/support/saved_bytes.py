"""States of units: magic (8), format, kind, mode, count (4 each), layout (8), doubles, checksum (8); little-endian."""

import struct

import numpy as np
from fmpy.fmi1 import FMICallException
from numpy.typing import NDArray

from tests.support.fmu_plants import Plant

KIND, MODE, NUMBERS = 12, 16, 32


def sealed(bare: bytes) -> bytes:
    """With the checksum: Fowler, Noll and Vo's hash of 64 bits, FNV-1a."""
    value = 0xCBF29CE484222325
    for byte in bare:
        value = (value ^ byte) * 0x100000001B3 % 2**64
    return bare + struct.pack("<Q", value)


def numbers_of(blob: bytes) -> NDArray[np.float64]:
    """Those of a state, to be changed."""
    return np.frombuffer(blob[NUMBERS:-8], "<f8").copy()


def with_numbers(blob: bytes, numbers: NDArray[np.float64]) -> bytes:
    """The state with other numbers."""
    return sealed(blob[:NUMBERS] + numbers.astype("<f8").tobytes())


def accepts(p: Plant, blob: bytes) -> bool:
    """Whether the bytes become a state; else they are said to be damaged."""
    try:
        state = p.fmu.deserializeFMUState(blob)
    except FMICallException:
        assert "damaged" in p.messages[-1].text
        return False
    p.fmu.freeFMUState(state)
    return True
