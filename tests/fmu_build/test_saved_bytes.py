"""Serialised states number by number: what the checksum passes is looked at none the less."""

import struct

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.fmu_build.test_trajectories import start_of
from tests.support.fmu_plants import ERROR, OK, Fmu, Plant, plant, refused
from tests.support.uneven import uneven_case

# magic (8), format, kind, mode, number of doubles (4 each), layout (8), numbers, checksum (8); little-endian: saved.c
KIND, MODE, NUMBERS = 12, 16, 32


def fnv_1a(data: bytes) -> int:
    """Fowler, Noll and Vo's hash of 64 bits."""
    value = 0xCBF29CE484222325
    for byte in data:
        value = (value ^ byte) * 0x100000001B3 % 2**64
    return value


def numbers_of(blob: bytes) -> NDArray[np.float64]:
    return np.frombuffer(blob[NUMBERS:-8], "<f8").copy()


def with_numbers(blob: bytes, numbers: NDArray[np.float64]) -> bytes:
    return sealed(blob[:NUMBERS] + numbers.astype("<f8").tobytes())


def sealed(bare: bytes) -> bytes:
    """With its checksum."""
    return bare + struct.pack("<Q", fnv_1a(bare))


def accepts(p: Plant, blob: bytes) -> bool:
    """Whether the bytes become a state; else they are said to be damaged."""
    try:
        state = p.fmu.deserializeFMUState(blob)
    except Exception:
        assert "damaged" in p.messages[-1].text
        return False
    p.fmu.freeFMUState(state)
    return True


@pytest.fixture
def stepped(fmu: Fmu) -> tuple[Fmu, bytes]:
    with plant(fmu) as p:
        p.start(start_of(uneven_case()), tolerance=3e-7)
        p.step(0.0, 0.01)
        return fmu, p.serialized()


def test_the_checksum_is_fnv_1a(stepped: tuple[Fmu, bytes]) -> None:
    """Expected: by the published constants, over all bytes before it, the first eight of which name the format."""
    _, blob = stepped
    assert blob == sealed(blob[:-8])
    assert blob[:8] == b"GSTEWART"


def test_numbers_that_no_state_has_are_refused(stepped: tuple[Fmu, bytes]) -> None:
    """Expected: no NaN; infinity for a stop time alone; below 0 neither tolerance nor a step size."""
    fmu, blob = stepped
    good = numbers_of(blob)
    refused_below_0 = []
    with plant(fmu) as p:
        for k, value in enumerate(good):
            for bad in (np.nan, np.inf, -1.0):
                changed = good.copy()
                changed[k] = bad
                accepted = accepts(p, with_numbers(blob, changed))
                if bad == -1.0:
                    refused_below_0 += [] if accepted else [value]
                else:
                    assert accepted == (np.isinf(bad) and np.isinf(value)), k
    step, tolerance, fixed = sorted(refused_below_0, reverse=True)
    assert 1e-3 < step < 1  # the internal step, of a hundredth of a second or so
    assert (tolerance, fixed) == (3e-7, 0.0)


def test_a_tolerance_out_of_range_is_refused(stepped: tuple[Fmu, bytes]) -> None:
    """Expected: 1e-13 to 1e-2, as documented."""
    fmu, blob = stepped
    good = numbers_of(blob)
    (place,) = np.flatnonzero(good == 3e-7)
    low, high = 1e-13, 1e-2
    with plant(fmu) as p:
        for value, is_accepted in ((low, True), (0.9 * low, False), (high, True), (1.1 * high, False)):
            good[place] = value
            assert accepts(p, with_numbers(blob, good)) == is_accepted


def test_a_mode_that_the_kind_cannot_be_in_is_refused(stepped: tuple[Fmu, bytes]) -> None:
    """Expected: kinds 1 (Model Exchange) and 2; modes are bits, instantiated 1 … terminated 64, one at a time."""
    fmu, blob = stepped
    possible = {1: {1, 2, 4, 8, 64}, 2: {1, 2, 16, 64}}
    with plant(fmu) as p:
        for kind in (0, 1, 2, 3, 256, 2**31):
            for mode in (0, 1, 2, 3, 4, 8, 12, 16, 18, 32, 64, 65, 80, 128, 256, 2**31):
                header = blob[:KIND] + struct.pack("<II", kind, mode) + blob[MODE + 4 : -8]
                assert accepts(p, sealed(header)) == (mode in possible.get(kind, set())), (kind, mode)


def test_a_restored_state_goes_on_where_it_was_in_every_respect(fmu: Fmu) -> None:
    """Expected: mode, time, stop time, tolerance and what FMI 2.0 tells of the last step."""
    with plant(fmu) as p, plant(fmu) as q:
        p.start(start_of(uneven_case()), tolerance=3e-7, stop=0.5)
        p.step(0.0, 0.1)
        q.restore(p.serialized())
        assert q.get("time") == 0.1
        if q.is_fmi2:
            assert q.fmu.getRealStatus(2) == 0.1  # fmi2LastSuccessfulTime
        assert refused(q.step, 0.1, 0.5) == ERROR
        assert "stop time" in q.messages[-1].text
        for each in (p, q):
            assert refused(each.step, 0.1, 0.3) == OK
        assert p.serialized() == q.serialized()
