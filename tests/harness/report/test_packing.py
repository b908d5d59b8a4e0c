"""Arrays of a page, and curves with fewer points: what is packed comes out again, and no peak is lost."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gough_stewart.harness.report.packing import MOST_ROWS, Arrays, blocks, decimated
from gough_stewart.harness.report.quantities import LENGTH, NUMBER
from tests.support.page_arrays import unpacked
from tests.support.records import Floats


def once(values: Any, *quantity: Any) -> Floats:
    kept = Arrays()
    assert kept.add(values, *quantity) == 0
    return unpacked(kept.packed[0])


@given(arrays(float, st.integers(1, 40), elements=st.floats(-1e9, 1e9)))
def test_without_a_quantity_every_bit_is_kept(values: Floats) -> None:
    """Expected: the same numbers; of evenly spaced ones within a millionth of a step."""
    assert once(values) == pytest.approx(values, rel=1e-12, abs=1e-6 * np.ptp(values))


_ELEMENTS = st.one_of(st.floats(-3.0, 5.0), st.just(float("nan")), st.floats(1.0, 1.00001))


@given(arrays(float, st.integers(1, 60), elements=_ELEMENTS))
def test_with_a_quantity_values_are_off_by_less_than_is_shown_and_gaps_stay(values: Floats) -> None:
    """Expected: within half of a millionth of the range, or of an eighth of 0.001 mm; NaN where NaN was."""
    found, finite = once(values, LENGTH), np.isfinite(values)
    assert np.array_equal(np.isfinite(found), finite)
    if finite.any():
        # single precision has no more digits than a millionth of the value
        least = max(1e-6, 1e-6 * float(np.abs(values[finite]).max()))
        allowed = max(float(np.ptp(values[finite])) / 2**21, least / 16) * 1.001 + 1e-12
        assert np.abs(found - values)[finite].max() <= allowed


def test_whole_numbers_stay_whole_what_is_infinite_is_a_gap_and_equal_arrays_are_kept_once() -> None:
    """Expected: by hand; a clock that is uneven by more than a millionth of a step is kept as it is."""
    flags = np.array([0.0, 1.0, 1.0, 0.0, 7.0])
    assert once(flags, NUMBER).tolist() == flags.tolist()
    assert np.isnan(once(np.array([1.0, np.inf, 2.5]), NUMBER)).tolist() == [False, True, False]
    assert np.isnan(once(np.full(4, np.nan), LENGTH)).all()
    kept, time = Arrays(), np.arange(1000) / 7
    uneven = time + 1e-5 * (np.arange(1000) == 17)
    added = [kept.add(values) for values in (time, time.copy(), time[:999], uneven)]
    assert [*added, kept.add(time, LENGTH)] == [0, 0, 1, 2, 3]
    assert [each["k"] for each in kept.packed] == ["even", "even", "f8", "even"]
    assert (unpacked(kept.packed[1])[-1], unpacked(kept.packed[2])[17]) == (time[998], uneven[17])


@pytest.mark.parametrize("rows", [101, 1000, 1003])
def test_blocks_keep_every_peak_in_its_order(rows: int) -> None:
    """Expected, row by row: of each block its smallest and largest value as they follow each other; gaps are gaps."""
    time, values = np.linspace(7.3, 9.1, rows), np.random.default_rng(3).normal(size=rows)
    values[30:60] = np.nan
    found_time, found = blocks(time, values, most=100)
    width = -(-2 * rows // 100)
    assert len(found) == len(found_time) == 2 * -(-rows // width) <= 102
    for place, k in enumerate(range(0, rows, width)):
        part, pair = values[k : k + width], found[2 * place : 2 * place + 2]
        assert found_time[2 * place : 2 * place + 2].tolist() == [time[k], time[min(k + width // 2, rows - 1)]]
        if np.isnan(part).all():
            assert np.isnan(pair).all()
        else:
            rises = np.nanargmin(part) <= np.nanargmax(part)
            assert pair.tolist() == [np.nanmin(part), np.nanmax(part)][:: 1 if rises else -1]
    assert (np.diff(found_time) >= 0).all()
    assert np.array_equal(blocks(time, values)[1], values, equal_nan=True)
    assert rows <= MOST_ROWS


@settings(max_examples=60)
@given(st.integers(1, 90), st.integers(0, 40), st.integers(0, 2**32 - 1))
def test_the_rows_kept_are_those_of_a_loop_over_buckets(n: int, points: int, seed: int) -> None:
    """Expected: both ends, and of each bucket the first smallest and the first largest finite value."""
    rng = np.random.default_rng(seed)
    time = 7.3 + np.cumsum(rng.uniform(0.1, 1.0, n))
    values = rng.integers(-4, 5, n) + rng.choice([0.0, 0.0, 0.0, np.nan, np.inf, -np.inf], n)
    found, shown = decimated(time, values, points)
    if n <= max(points, 4):
        assert (found is time, shown is values) == (True, True)
        return
    width, rows = math.ceil((n - 2) / max(1, (points - 2) // 2)), {0, n - 1}
    for start in range(1, n - 1, width):
        finite = [k for k in range(start, min(start + width, n - 1)) if np.isfinite(values[k])]
        rows |= {pick(finite, key=lambda k: values[k]) if finite else start for pick in (min, max)}
    assert np.array_equal(found, time[sorted(rows)])
    assert np.array_equal(shown, values[sorted(rows)], equal_nan=True)
    assert len(found) <= max(points, 4)
