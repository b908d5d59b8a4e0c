"""The library of many platforms: its elementary functions, and how it is kept."""

import ctypes
import re
import subprocess
import sys
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gough_stewart.fmu_build.libraries import WIDTH, lanes_code, lanes_sources, machine_code
from gough_stewart.fmu_build.toolchain import BY_NAME
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


@pytest.mark.evidence
@pytest.mark.parametrize("name", ["aarch64-darwin", "aarch64-linux", "x86_64-darwin"])
def test_other_systems_can_compile_the_library(name: str, tmp_path: Path) -> None:
    """Expected: no complaint of the compiler, whose integers of 64 bits have another type on each system."""
    for file, text in lanes_sources().files.items():
        (tmp_path / file).write_text(text)
    command = [sys.executable, "-m", "ziglang", "cc", "-target", BY_NAME[name].triple, "-std=c11", "-O0", "-Werror"]
    command += ["-c", "-I", ".", "lanes.c", "-o", "lanes.o"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "lanes.o").stat().st_size > 10_000


def _rows(declaration: str) -> list[list[Fraction]]:
    """The numbers of a table of steps.h or lanes.c, row by row."""
    text = "".join(lanes_sources().headers["steps.h"] + lanes_sources().units["lanes.c"])
    table = text[text.index(declaration) :].partition("=")[2].partition(";")[0]
    numbers = (re.sub(r"\s", "", row).split(",") for row in re.findall(r"\{([^{}]+)\}", table))
    quotients = ([number.partition("/") for number in row if number] for row in numbers)
    return [[Fraction(above) / Fraction(below or "1") for above, _, below in row] for row in quotients]


def _residues(weights: Any, stages: Any, order: int) -> list[Fraction]:
    """What is missing of Butcher's conditions for an order, by rooted trees (Hairer, Nørsett, Wanner, II.2)."""
    c = stages.sum(axis=1)
    ac, ac2 = stages @ c, stages @ c**2
    conditions = (
        (1, c**0, 1),
        (2, c, 2),
        *((3, c**2, 3), (3, ac, 6)),
        *((4, c**3, 4), (4, c * ac, 8), (4, ac2, 12), (4, stages @ ac, 24)),
        *((5, c**4, 5), (5, c**2 * ac, 10), (5, ac**2, 20), (5, c * ac2, 15), (5, stages @ c**3, 20)),
        *((5, c * (stages @ ac), 30), (5, stages @ (c * ac), 40), (5, stages @ ac2, 60)),
        (5, stages @ stages @ ac, 120),
    )
    return [weights @ vector - Fraction(1, share) for least, vector, share in conditions if least <= order]


def test_the_methods_have_their_orders() -> None:
    """Expected: Butcher's conditions, in fractions; of Dormand and Prince's pair also of the solution of order 4."""
    declarations = {
        "RK4[4][6]": 4,
        "A[STAGES][6] = {{1.0 / 3}": 4,
        "A[STAGES][6] = {\n    {1.0 / 5}": 5,
        "CASH_KARP[6][6]": 5,
    }
    for declaration, order in declarations.items():
        *inner, weights = _rows(declaration)
        n = len(weights)
        stages = np.array([[*row, *[Fraction(0)] * (n - len(row))] for row in ([], *inner)])
        assert not any(_residues(np.array(weights), stages, order)), declaration
        if declaration.endswith("{1.0 / 5}"):
            (difference,) = _rows("double E[]")
            stages = np.array([[*row, *[Fraction(0)] * (7 - len(row))] for row in ([], *inner, weights)])
            assert not any(_residues(np.array([*weights, Fraction(0)]) - difference, stages, 4))
