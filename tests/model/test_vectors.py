"""Vector algebra over leading axes, against NumPy's own."""

import numpy as np
import pytest

from gough_stewart.model import vectors
from gough_stewart.model.vectors import real_array

RNG = np.random.default_rng(6)
A, B = RNG.normal(size=(2, 4, 6, 3))


def test_products_are_those_of_numpy() -> None:
    """Expected: np.cross and einsum, over two leading axes of different length."""
    assert vectors.dot(A, B) == pytest.approx(np.einsum("abi,abi->ab", A, B), abs=1e-14)
    assert vectors.cross(A, B) == pytest.approx(np.cross(A, B), abs=1e-14)
    assert vectors.outer(A, B) == pytest.approx(np.einsum("abi,abj->abij", A, B), abs=1e-14)
    assert vectors.outer(A, B[..., :2]).shape == (4, 6, 3, 2)
    tilde = vectors.skew(A)
    assert np.einsum("abij,abj->abi", tilde, B) == pytest.approx(np.cross(A, B), abs=1e-14)
    assert vectors.transpose(tilde) == pytest.approx(-tilde, abs=0)
    M = RNG.normal(size=(4, 6, 2, 3))
    assert vectors.apply(M, A) == pytest.approx(np.einsum("abij,abj->abi", M, A), abs=1e-14)
    assert vectors.transpose(M).shape == (4, 6, 3, 2)


def test_parts_are_joined_along_the_last_axis_over_axes_that_broadcast() -> None:
    """Expected: each row by itself."""
    assert vectors.concatenate([A[0], B[0, :, :2]]).tolist() == np.hstack([A[0], B[0, :, :2]]).tolist()
    found = vectors.concatenate([A[:, :1], B[0], np.array([7.0])])
    assert found.shape == (4, 6, 7)
    for i, j in np.ndindex(4, 6):
        assert found[i, j].tolist() == [*A[i, 0], *B[0, j], 7.0]


@pytest.mark.parametrize(
    ("value", "shape", "text"),
    [
        ("3", (), "is '3'; expected one number"),
        (None, (2,), "is None; expected numbers of shape (2,)"),
        (True, (), "is True; expected one number"),
        (1j, (), "is 1j; expected one number"),
        ([[1, 2], [3]], (2, 2), "is [[1, 2], [3]]; expected numbers of shape (2, 2)"),
        ([1.0, 2.0], (3,), "has shape (2,); expected numbers of shape (3,)"),
        ([1.0], (), "has shape (1,); expected one number"),
        ([1.0, np.nan], (2,), "is [1.0, nan]; expected finite numbers only"),
        (-np.inf, (), "is -inf; expected finite numbers only"),
    ],
)
def test_what_is_no_real_array_is_told_with_value_and_expectation(
    value: object, shape: tuple[int, ...], text: str
) -> None:
    with pytest.raises(ValueError, match=r"^(is|has) ") as caught:
        real_array(value, shape)
    assert str(caught.value) == text


def test_real_numbers_are_copied_as_floats() -> None:
    """Expected: integers, signed or not, and shorter floats; the user's array stays his own."""
    for kind in (np.int8, np.uint16, np.float32):
        found = real_array(np.array([1, 2], kind), (2,))
        assert (found.tolist(), found.dtype.name) == ([1.0, 2.0], "float64")
    own = np.array([1.0, 2.0])
    real_array(own, (2,))[0] = 5
    assert own[0] == 1


def test_the_first_of_equal_peaks_is_told_whatever_the_rounding() -> None:
    """Expected: by hand; the second peak is larger by rounding, the third by more."""
    peaks = np.array(
        [[1.0, -3.0, np.nan, 2.0, np.inf], [2.0, -2.0, 7.0, np.nan, 1.0], [2.0 + 4e-16, -2.0, 8.0, 3.0, np.inf]]
    )
    assert vectors.first_of_largest(peaks).tolist() == [1, 1, 0, 1, 0]
    assert vectors.first_of_largest(np.array([2.0, 2.0 + 1e-8])) == 1
    assert vectors.first_of_largest(np.array([0.0, -0.0, 0.0])) == 0
    assert vectors.first_of_largest(np.array([-np.inf, -5.0, -5.0 + 1e-14])) == 1
