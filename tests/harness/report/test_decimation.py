"""Curves reduced for display."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gough_stewart.harness.report.packing import decimated
from gough_stewart.model.vectors import FloatArray


def kept_rows(values: FloatArray, points: int) -> list[int]:
    """As documented, bucket by bucket: first and last row, and the first smallest and first largest finite value."""
    n, buckets = len(values), max(1, (points - 2) // 2)
    width = math.ceil((n - 2) / buckets)
    rows = {0, n - 1}
    for start in range(1, n - 1, width):
        finite = [k for k in range(start, min(start + width, n - 1)) if np.isfinite(values[k])]
        for pick in (min, max):
            rows.add(pick(finite, key=lambda k: values[k]) if finite else start)
    return sorted(rows)


@settings(max_examples=60)
@given(st.integers(1, 90), st.integers(0, 40), st.integers(0, 2**32 - 1))
def test_the_rows_kept_are_those_of_a_loop_over_buckets(n: int, points: int, seed: int) -> None:
    """Expected: `kept_rows`; times that are no row numbers, from 7.3 s; gaps and infinite values are no extremes."""
    rng = np.random.default_rng(seed)
    time = 7.3 + np.cumsum(rng.uniform(0.1, 1.0, n))
    values = rng.integers(-4, 5, n) + rng.choice([0.0, 0.0, 0.0, np.nan, np.inf, -np.inf], n)
    found, shown = decimated(time, values, points)
    if n <= max(points, 4):
        assert (found is time, shown is values) == (True, True)
        return
    rows = kept_rows(values, points)
    assert np.array_equal(found, time[rows])
    assert np.array_equal(shown, values[rows], equal_nan=True)
    assert len(found) <= max(points, 4)


@pytest.mark.parametrize(("n", "points", "kept"), [(4, 0, 4), (5, 0, 4), (8, 8, 8), (9, 8, 7), (9, 7, 6)])
def test_short_curves_stay_whole_up_to_the_number_of_points(n: int, points: int, kept: int) -> None:
    """Expected: both ends, two rows of a bucket of 3 or 4, one of a bucket of 1: 3, 3, 1 of 8 points, 4, 3 of 7."""
    values = np.arange(n) * (-1.0) ** np.arange(n)
    assert len(decimated(np.arange(n) / 7, values, points)[0]) == kept
