"""Branch-free functions for motions, for numbers and for CasADi symbols in object arrays."""

import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.model.vectors import Array, Scalars


def numbers_or_symbols(values: ArrayLike) -> Array:
    """Floats; an object array stays as it is."""
    array = np.asarray(values)
    return array if array.dtype == object else array.astype(float, copy=False)


def minimum(a: Array, b: Scalars) -> Array:
    """The elementwise minimum."""
    return _elementwise("fmin", a, b) if a.dtype == object else np.asarray(np.minimum(a, b))


def maximum(a: Array, b: Scalars) -> Array:
    """The elementwise maximum."""
    return _elementwise("fmax", a, b) if a.dtype == object else np.asarray(np.maximum(a, b))


def reached(a: Array, b: Scalars) -> Array:
    """1 where a >= b, else 0."""
    return _elementwise("ge", a, b) if a.dtype == object else np.asarray((a >= b).astype(float))


def where_below(a: Array, bound: float, below: Array, otherwise: Array) -> Array:
    """The elements of one array where a < bound, of another elsewhere."""
    if a.dtype != object:
        return np.where(a < bound, below, otherwise)
    import casadi  # needed for tracing only

    return np.array(
        [casadi.if_else(x < bound, y, z) for x, y, z in zip(a, below, otherwise, strict=True)], dtype=object
    )


def arctan2(y: Array, x: Array) -> Array:
    """The angle of (x, y) [rad]."""
    return _elementwise("atan2", y, x) if y.dtype == object else np.asarray(np.arctan2(y, x))


def _elementwise(name: str, a: Array, b: Scalars) -> Array:
    import casadi  # needed for tracing only

    flat = [getattr(casadi, name)(x, y) for x, y in np.broadcast(a, b)]
    return np.array(flat, dtype=object).reshape(np.broadcast_shapes(a.shape, np.shape(b)))
