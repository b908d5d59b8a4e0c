"""Arrays of a page: what is packed comes out again, as near as was promised, and no peak of a long record is lost."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gough_stewart.harness.report.packing import MOST_ROWS, Arrays, blocks
from gough_stewart.harness.report.quantities import LENGTH, NUMBER
from gough_stewart.model.vectors import FloatArray
from tests.support.page_arrays import unpacked


def once(values: FloatArray, *quantity: object) -> FloatArray:
    kept = Arrays()
    assert kept.add(values, *quantity) == 0  # type: ignore[arg-type]
    return unpacked(kept.packed[0])


@given(arrays(float, st.integers(1, 40), elements=st.floats(-1e9, 1e9)))
def test_without_a_quantity_every_bit_is_kept(values: FloatArray) -> None:
    """Expected: the same numbers; of evenly spaced ones within a millionth of a step."""
    assert once(values) == pytest.approx(values, rel=1e-12, abs=1e-6 * np.ptp(values))


@given(
    arrays(
        float,
        st.integers(1, 60),
        elements=st.one_of(st.floats(-3.0, 5.0), st.just(float("nan")), st.floats(1.0, 1.00001)),
    )
)
def test_with_a_quantity_values_are_off_by_less_than_is_shown_and_gaps_stay(values: FloatArray) -> None:
    """Expected: within half of a millionth of the range, or of an eighth of 0.001 mm; NaN where NaN was."""
    found, finite = once(values, LENGTH), np.isfinite(values)
    assert np.array_equal(np.isfinite(found), finite)
    if finite.any():
        span = float(np.ptp(values[finite]))
        # single precision has no more digits than a millionth of the value
        least = max(1e-6, 1e-6 * float(np.abs(values[finite]).max()))
        assert np.abs(found - values)[finite].max() <= max(span / 2**21, least / 16) * 1.001 + 1e-12


_TIME = np.linspace(0.0, 1.0, 501)
_RANDOM = np.random.default_rng(5)


@pytest.mark.parametrize(
    ("order", "values"),
    [
        (0, np.arange(501) % 2 + _RANDOM.uniform(0.0, 0.2, 501)),
        (1, np.cumsum(_RANDOM.uniform(-1.0, 1.0, 501))),
        (2, 0.4 + np.sin(5 * _TIME + 0.3)),
    ],
    ids=["to and fro", "a walk", "a smooth curve"],
)
def test_differences_are_of_the_order_that_suits_a_curve(order: int, values: FloatArray) -> None:
    """Expected: none for jumps to and fro, the first for a walk, the second for a smooth curve; and the values."""
    kept = Arrays()
    kept.add(values, LENGTH)
    assert kept.packed[0]["o"] == order
    assert np.abs(unpacked(kept.packed[0]) - values).max() <= 0.5001 * kept.packed[0]["s"]


def test_whole_numbers_stay_whole_and_what_is_infinite_is_a_gap() -> None:
    flags = np.array([0.0, 1.0, 1.0, 0.0, 7.0])
    assert once(flags, NUMBER).tolist() == flags.tolist()
    assert np.isnan(once(np.array([1.0, np.inf, 2.5]), NUMBER)).tolist() == [False, True, False]
    assert np.isnan(once(np.full(4, np.nan), LENGTH)).all()


def test_the_same_numbers_are_kept_once() -> None:
    kept, time = Arrays(), np.arange(1000) / 7
    assert [kept.add(time), kept.add(time.copy()), kept.add(time[:999]), kept.add(time, LENGTH)] == [0, 0, 1, 2]
    assert [each["k"] for each in kept.packed] == ["even"] * 3
    assert unpacked(kept.packed[1])[-1] == time[998]


def test_a_clock_that_is_uneven_by_a_share_of_a_step_is_kept_as_it_is() -> None:
    time = np.arange(50) / 10
    time[17] += 1e-5
    kept = Arrays()
    kept.add(time)
    assert kept.packed[0]["k"] == "f8"
    assert np.array_equal(unpacked(kept.packed[0]), time)


@pytest.mark.parametrize("rows", [101, 1000, 1003])
def test_blocks_keep_every_peak_in_its_order(rows: int) -> None:
    """Expected, row by row: of each block its smallest and largest value as they follow each other; gaps are gaps."""
    rng = np.random.default_rng(3)
    time, values = np.linspace(7.3, 9.1, rows), rng.normal(size=rows)
    values[30:60] = np.nan
    found_time, found = blocks(time, values, most=100)
    width = -(-2 * rows // 100)
    assert len(found) == len(found_time) == 2 * -(-rows // width) <= 102
    for k in range(0, rows, width):
        part, pair = values[k : k + width], found[2 * (k // width) : 2 * (k // width) + 2]
        assert found_time[2 * (k // width)] == time[k]
        if np.isnan(part).all():
            assert np.isnan(pair).all()
            continue
        order = np.nanargmin(part) <= np.nanargmax(part)
        assert pair.tolist() == ([np.nanmin(part), np.nanmax(part)][:: 1 if order else -1])
    assert (np.diff(found_time) >= 0).all()
    assert np.array_equal(blocks(time, values)[1], values, equal_nan=True)
    assert rows <= MOST_ROWS
