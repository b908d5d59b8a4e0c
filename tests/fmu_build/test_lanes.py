"""The library of many platforms: its elementary functions, and how it is kept."""

import ctypes

import numpy as np
import pytest

from gough_stewart.fmu_build.libraries import WIDTH, lanes_code, machine_code
from tests.support.arrays import FloatArray

# Of rounding: half a unit in the last place of 1.
U = 2.0**-53
# The numbers of x86 with 64 bits of mantissa; elsewhere as good as double, which is no reference.
needs_long_double = pytest.mark.skipif(np.finfo(np.longdouble).nmant < 60, reason="no long double to compare with")


def _elementary(x: FloatArray) -> FloatArray:
    """sin, cos and tanh (3, n) of n numbers, a multiple of eight."""
    library = ctypes.CDLL(str(machine_code(lanes_code()).path))
    y = np.empty((3, len(x)))
    pointers = (ctypes.c_void_p(array.ctypes.data) for array in (x, y))
    library.lanes_elementary(ctypes.c_int64(len(x) // WIDTH), *pointers)
    return y


def _samples(largest: float) -> FloatArray:
    """Dense between −7 and 7, then all magnitudes up to the largest, and next to the multiples of π/4."""
    rng = np.random.default_rng(5)
    n = 1 << 15
    magnitudes = 10.0 ** rng.uniform(-300, np.log10(largest), n) * rng.choice([-1.0, 1.0], n)
    steps = (1 + np.arange(n)) * rng.choice([-1.0, 1.0], n) * (np.pi / 4) * (1 + rng.integers(-3, 4, n) * 2 * U)
    return np.concatenate([rng.uniform(-7, 7, 4 * n), magnitudes, rng.uniform(-largest, largest, n), steps])


@needs_long_double
def test_elementary_functions_are_right_to_units_in_the_last_place() -> None:
    """Expected: the C library's, in long double; relative for small angles, and where tanh is near x or 1."""
    x = _samples(1e6)
    sine, cosine, _ = _elementary(x)
    exact = x.astype(np.longdouble)
    assert np.abs(sine - np.sin(exact)).max() < 1.6 * U
    assert np.abs(cosine - np.cos(exact)).max() < 1.6 * U
    x = _samples(0.7)
    x = x[np.abs(x) < 0.78]
    x = x[: len(x) // WIDTH * WIDTH]
    exact = np.sin(x.astype(np.longdouble))
    assert np.abs((_elementary(x)[0] - exact) / exact).max() < 2.2 * U
    x = _samples(1e3)
    exact = np.tanh(x.astype(np.longdouble))
    assert np.abs((_elementary(x)[2] - exact) / exact).max() < 4 * U


def test_what_is_not_a_number_stays_so_and_limits_are_kept() -> None:
    """Expected: NaN of NaN, of infinite angles and of those beyond a million; tanh ±1 at ±∞, and 0 of 0."""
    x = np.array([np.nan, np.inf, -np.inf, 1.1e6, 0.0, 1e300, -30.0, -0.0])
    sine, cosine, tangent = _elementary(x)
    for angle in (sine, cosine):
        np.testing.assert_array_equal(np.isnan(angle), [True, True, True, True, False, True, False, False])
    np.testing.assert_array_equal(tangent, [np.nan, 1.0, -1.0, 1.0, 0.0, 1.0, -1.0, 0.0])
    assert sine[4] == 0
    assert cosine[4] == 1
