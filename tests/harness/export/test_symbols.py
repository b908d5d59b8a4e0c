"""Linear equations of symbols against NumPy, for matrices with and without triangular blocks."""

import casadi
import numpy as np
import pytest

from gough_stewart.harness.export import symbols

RNG = np.random.default_rng(11)
LOWER = np.kron(np.tril(np.ones((3, 3))), np.ones((2, 2)))
SHUFFLED = LOWER[np.ix_([4, 1, 5, 0, 3, 2], [2, 0, 5, 4, 1, 3])]


@pytest.mark.parametrize("pattern", [LOWER, LOWER.T, SHUFFLED, np.ones((6, 6)), np.eye(6)])
@pytest.mark.parametrize("shape", [(6,), (6, 4)])
def test_equations_of_symbols_have_numpys_solution(pattern: np.ndarray, shape: tuple[int, ...]) -> None:
    """Expected: NumPy's, for other elements everywhere and rows of very different size."""
    scales = 10.0 ** np.arange(6)[:, None]
    numbers = pattern * RNG.uniform(1, 2, (6, 6)) * scales + np.where(pattern, 3 * np.eye(6), 0) * scales
    right = RNG.normal(size=shape)
    M = casadi.SX.sym("M", 36)
    matrix = np.where(pattern != 0, symbols.elements(M).reshape(6, 6), 0.0)
    found = symbols.solve(matrix, np.array(right, dtype=object))
    value = np.array(casadi.Function("f", [M], [symbols.column(found)])(numbers.reshape(-1))).reshape(shape)
    expected = np.linalg.solve(numbers, right)
    assert value == pytest.approx(expected, rel=1e-9, abs=1e-12 * np.abs(expected).max())
