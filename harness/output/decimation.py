"""Reduces the points of a curve for display."""

import numpy as np

from gough_stewart.model.vectors import FloatArray


def decimated(time: FloatArray, values: FloatArray, points: int) -> tuple[FloatArray, FloatArray]:
    """Times and values (m,), m ≤ max(points, 4), that look the same in a figure as all (n,).

    The first and last row stay. The rows between are divided into buckets; of each, the smallest and the largest finite
    value stay at their times, so no peak is lost. Curves with few enough points are returned unchanged.
    """
    n = len(time)
    if n <= max(points, 4):
        return time, values
    inner = values[1:-1]
    buckets = max(1, (points - 2) // 2)
    width = -(-len(inner) // buckets)
    padding = (0, buckets * width - len(inner))
    finite = np.isfinite(inner)
    low = np.pad(np.where(finite, inner, np.inf), padding, constant_values=np.inf).reshape(buckets, width)
    high = np.pad(np.where(finite, inner, -np.inf), padding, constant_values=-np.inf).reshape(buckets, width)
    starts = 1 + width * np.arange(buckets)
    kept = np.concatenate([[0, n - 1], starts + low.argmin(axis=1), starts + high.argmax(axis=1)])
    # the last buckets may have only padding
    kept = np.unique(np.minimum(kept, n - 1))
    return time[kept], values[kept]
