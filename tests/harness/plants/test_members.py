"""The memory of many members, against plain NumPy; three members that differ."""

import numpy as np
import pytest

from gough_stewart.harness.plants import members


@pytest.mark.parametrize(("rows", "strides"), [((), (8, 24)), ((5,), (96, 8, 24)), ((2, 5), (480, 96, 8, 24))])
def test_arrays_of_members_are_contiguous_over_members(rows: tuple[int, ...], strides: tuple[int, ...]) -> None:
    """Expected: shape by rows, members, elements; a step of one number from member to member."""
    values = members.zeros((3,), 4, *rows)
    assert values.shape == (*rows, 3, 4)
    assert values.strides == strides
    assert values.dtype == np.float64
    assert not values.any()
    flags = members.flags((3,), 4, *rows)
    assert flags.shape == (*rows, 3, 4)
    assert flags.strides == tuple(step // 8 for step in strides)
    assert flags.dtype == np.bool_
    assert not flags.any()


def test_arrays_of_one_run_have_no_axis_of_members() -> None:
    assert members.zeros((), 4, 5).shape == (5, 4)
    assert members.flags((), 4).shape == (4,)


def test_values_of_members_are_stacked_row_by_row() -> None:
    """Expected: the member's own values in its own row, over leading axes; members contiguous."""
    each = [np.arange(8.0).reshape(2, 4) + 100 * k for k in range(3)]
    found = members.stacked(each)
    assert found.shape == (2, 3, 4)
    for k in range(3):
        assert found[:, k].tolist() == each[k].tolist()
    assert found.strides[1] == 8
    assert members.stacked([[1, 2], [3, 4], [5, 6]]).tolist() == [[1, 2], [3, 4], [5, 6]]


@pytest.mark.parametrize("is_one", [True, False])
def test_vectors_are_below_a_bound_if_the_sum_of_all_squares_is(is_one: bool) -> None:
    """Expected: the square root of the sum from both sides; not a number is never below."""
    values = np.array([[3.0], [-4.0], [12.0]]) if is_one else np.array([[3.0, 0.0, 0.0], [-4.0, 12.0, 0.0]])
    assert members.all_below(values, 13.0 + 1e-9) is True
    assert members.all_below(values, 13.0) is False
    assert members.all_below(values, 13.0 - 1e-9) is False
    values[-1] = np.nan
    assert members.all_below(values, 1e9) is False


def test_a_value_may_be_common_or_of_each_member() -> None:
    """Expected: the common one for all; the least, and the last, of three."""
    own = np.array([5.0, 2.0, 7.0])
    assert (members.smallest(own), members.smallest(4.5)) == (2.0, 4.5)
    assert [members.of(own, k) for k in range(3)] == [5.0, 2.0, 7.0]
    assert [members.of(4.5, k) for k in range(3)] == [4.5] * 3
