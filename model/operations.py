"""Operations without branches on values, for NumPy floats and for CasADi symbols in object arrays.

Arithmetic and `np.exp`, `np.sin`, `np.sqrt`, `np.abs` work on both. What compares does not, since NumPy asks symbols
for a truth value; and CasADi takes x for (x + c) − c, by which some round. These are here. With floats each is NumPy's
own function, bit by bit. The first array says which: if it has symbols, the others may have numbers.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from gough_stewart.model.vectors import Array, Scalars

_OBJECT = np.dtype(object)
_Operation = Callable[..., Array]


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
