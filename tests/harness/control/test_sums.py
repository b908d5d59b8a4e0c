"""Products of many members' sparse matrices, against NumPy's matrix product."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from gough_stewart.harness.control.sums import Product


@settings(max_examples=60)
@given(pattern=arrays.arrays(bool, st.tuples(st.integers(1, 9), st.integers(1, 9))), seed=st.integers(0, 9))
def test_a_product_of_any_pattern_is_the_matrix_product(pattern: np.ndarray, seed: int) -> None:
    rng = np.random.default_rng(seed)
    matrices = rng.normal(size=(3, *pattern.shape)) * pattern
    x, y = rng.normal(size=(pattern.shape[1], 3)), np.zeros((pattern.shape[0], 3))
    Product(matrices, 3).of(x, y)()
    np.testing.assert_allclose(y, np.einsum("nij,jn->in", matrices, x), rtol=0, atol=1e-13)


def test_zeros_that_others_fill_leave_a_member_its_bits() -> None:
    """Expected: the sum of a member's own terms, columns ascending, whatever terms of zero stand between."""
    rng = np.random.default_rng(1)
    sparse = rng.normal(size=(6, 8)) * (rng.random((6, 8)) < 0.5)
    full = rng.normal(size=(6, 8))
    x = rng.normal(size=(8, 1))
    alone, beside = np.zeros((6, 1)), np.zeros((6, 2))
    Product(sparse, 1).of(x, alone)()
    Product(np.stack([full, sparse]), 2).of(np.repeat(x, 2, axis=1), beside)()
    np.testing.assert_array_equal(beside[:, 1:], alone)
    terms = [[sparse[i, j] * x[j, 0] for j in range(8) if sparse[i, j]] for i in range(6)]
    assert alone[:, 0].tolist() == [sum(row[1:], start=row[0]) for row in terms]


@pytest.mark.parametrize("n_members", [1, 5])
def test_one_matrix_may_be_that_of_all(n_members: int) -> None:
    matrix, x = np.diag([1.0, 2.0, 3.0]), np.arange(3.0 * n_members).reshape(3, -1)
    y = np.zeros_like(x)
    Product(matrix, n_members).of(x, y)()
    assert (y == matrix @ x).all()


def test_channels_side_by_side_take_one_operation_for_each_kind_of_element() -> None:
    """Expected: NumPy's product, and the sums by hand with columns ascending, to the bit; two outputs read the same."""
    rng = np.random.default_rng(3)
    p, q, r, s, t = (np.diag(rng.normal(size=6)) for _ in range(5))
    matrix = np.block([[p, q, r], [s, np.zeros((6, 6)), t]])
    x, y = rng.normal(size=(18, 2)), np.full((12, 2), np.nan)
    Product(matrix, 2).of(x, y)()
    np.testing.assert_allclose(y, matrix @ x, rtol=1e-14)
    for i in range(12):
        terms = [matrix[i, j] * x[j] for j in range(18) if matrix[i, j]]
        np.testing.assert_array_equal(y[i], sum(terms[1:], start=terms[0]))
