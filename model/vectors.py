"""Algebra over leading axes, for NumPy floats and for CasADi symbols in object arrays; users' numbers.

Arithmetic and `np.exp`, `np.sin`, `np.sqrt`, `np.abs` work on both. What compares does not, since NumPy asks symbols
for a truth value; and CasADi takes x for (x + c) − c, by which some round. For these there are operations here. With
floats each is NumPy's own function, bit by bit. The first array says which: if it has symbols, the others may have
numbers.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Numbers or CasADi symbols; the algebra is the same for both.
Array = NDArray[Any]
Scalars = Array | float
# Numbers only.
FloatArray = NDArray[np.float64]
# A decorator: a leg of length 0 has no direction, so its results are infinite or NaN, without warnings.
without_warnings = np.errstate(divide="ignore", invalid="ignore")
_OBJECT = np.dtype(object)
_Operation = Callable[..., Array]


def dot(a: Array, b: Array) -> Array:
    """Scalar product a·b of (..., n) vectors, shape (...)."""
    return np.asarray((a * b).sum(axis=-1))


def cross(a: Array, b: Array) -> Array:
    """Vector product a×b of (..., 3) vectors."""
    (ax, ay, az), (bx, by, bz) = ((v[..., 0], v[..., 1], v[..., 2]) for v in (a, b))
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def centripetal(omega: Array, arm: Array) -> Array:
    """ω×(ω×r) of (..., 3) vectors."""
    return cross(omega, cross(omega, arm))


def skew(a: Array) -> Array:
    """Matrix ã (..., 3, 3) with ã b = a×b; eq. (4) of Liu, Li & Li (2000)."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    o = 0 * x
    return np.stack([np.stack(row, axis=-1) for row in ((o, -z, y), (z, o, -x), (-y, x, o))], axis=-2)


def apply(matrix: Array, vector: Array) -> Array:
    """Product of (..., m, n) matrices and (..., n) vectors, shape (..., m)."""
    return np.asarray((matrix * vector[..., None, :]).sum(axis=-1))


def outer(a: Array, b: Array) -> Array:
    """Dyadic product a bᵀ of (..., m) and (..., n) vectors, shape (..., m, n)."""
    return a[..., :, None] * b[..., None, :]


def concatenate(parts: Sequence[Array]) -> Array:
    """Join (..., n_k) vectors along their last axis; leading axes broadcast against each other."""
    parts = [np.asarray(part) for part in parts]
    shapes = {part.shape[:-1] for part in parts}
    if len(shapes) == 1:  # the usual case, a shortcut at a third of the cost
        return np.concatenate(parts, axis=-1)
    leading = np.broadcast_shapes(*shapes)
    return np.concatenate([np.broadcast_to(part, (*leading, part.shape[-1])) for part in parts], axis=-1)


def per_leg(value: Scalars) -> Array:
    """One value for all six legs: (...) to (..., 1), which broadcasts against (..., 6)."""
    return np.asarray(value)[..., None]


def _by_element(name: str, *arrays: Any) -> Array:
    """A function of CasADi for each element."""
    import casadi  # needed for tracing only

    function: Callable[..., Any] = getattr(casadi, name)
    elements = np.broadcast(*arrays)
    return np.array([function(*arguments) for arguments in elements], dtype=object).reshape(elements.shape)


def _operation(of_symbols: str, of_numbers: _Operation) -> _Operation:
    """An operation on arrays: CasADi's function of this name if the first has symbols, else NumPy's."""

    def operation(first: Array, *others: Scalars) -> Array:
        return _by_element(of_symbols, first, *others) if first.dtype is _OBJECT else of_numbers(first, *others)

    return operation


# The smaller and the larger of two; of NaN and a number, NumPy gives NaN, and C the number.
minimum, maximum = _operation("fmin", np.minimum), _operation("fmax", np.maximum)
# −1, 0 or 1.
sign = _operation("sign", np.sign)
# Whether a < b, a > b, a ≠ b: booleans, or symbols of 0 and 1.
less, greater, not_equal = _operation("lt", np.less), _operation("gt", np.greater), _operation("ne", np.not_equal)
# 1.0 where a ≥ b, else 0.0.
reached = _operation("ge", lambda a, b: (a >= b).astype(float))
# Of a condition, a and b: the elements of a where it holds, of b elsewhere, whatever those are there.
where = _operation("if_else", np.where)
# The angle of (x, y) [rad], of y and x.
arctan2 = _operation("atan2", np.arctan2)


def clip(a: Array, low: Scalars, high: Scalars) -> Array:
    """The larger of a and low, at most high; in a third of the time that `np.clip` takes for six numbers."""
    return minimum(maximum(a, low), high)


def rounded(a: Array) -> Array:
    """The nearest whole number, of two the even one: a − remainder(a, 1) of symbols, which is NaN for infinities."""
    return a - _by_element("remainder", a, 1.0) if a.dtype is _OBJECT else np.rint(a)


def first_of_largest(values: FloatArray) -> Any:
    """Index along the first axis of the first value within a part in 10⁹ of the largest; of a NaN, if there is one.

    Peaks of a symmetric platform are equal but for rounding, which must not decide which of them is told.
    """
    values = np.asarray(values)
    largest = values.max(axis=0)
    with np.errstate(invalid="ignore"):  # ∞ − ∞
        near = values >= largest - 1e-9 * np.abs(largest)
    return (near | (values == largest) | np.isnan(values)).argmax(axis=0)


def real_array(value: object, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """A float64 copy of real, finite numbers of this shape; `ValueError` has the value found and the expectation."""
    expected = "one number" if shape == () else f"numbers of shape {shape}"
    try:
        array = np.array(value)
    except ValueError:  # ragged
        raise ValueError(f"is {value!r}; expected {expected}") from None
    if array.dtype.kind not in "iuf":
        raise ValueError(f"is {value!r}; expected {expected}")
    if array.shape != shape:
        raise ValueError(f"has shape {array.shape}; expected {expected}")
    if not np.isfinite(array).all():
        raise ValueError(f"is {array.tolist()}; expected finite numbers only")
    return array.astype(np.float64, copy=False)  # already a copy
