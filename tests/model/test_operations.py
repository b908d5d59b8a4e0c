"""Operations on numbers and on symbols: the values worked out by hand, and the same from CasADi's evaluation and C."""

from collections.abc import Callable
from typing import Any

import casadi
import numpy as np
import pytest

from gough_stewart.model import operations

INF = np.inf
A = np.array([-2.5, -1.0, 0.0, 1e-12, 0.7, 3.0, -0.0, INF, -INF, 2.5])
B = np.array([1.0, -1.0, 0.3, 0.0, 0.7, -2.0, 0.0, 5.0, 4.0, INF])
C = np.array([2.0, 0.5, 0.1, 7.0, 0.8, 9.0, -1.0, 6.0, 5.0, 0.0])
CASES: dict[str, tuple[Callable[..., Any], tuple[Any, ...], list[float]]] = {
    "minimum": (operations.minimum, (A, B), [-2.5, -1, 0, 0, 0.7, -2, 0, 5, -INF, 2.5]),
    "maximum": (operations.maximum, (A, B), [1, -1, 0.3, 1e-12, 0.7, 3, 0, INF, 4, INF]),
    # where the bounds cross, the upper one wins
    "clip": (operations.clip, (A, B, C), [1, -1, 0.1, 1e-12, 0.7, 3, -1, 6, 4, 0]),
    "sign": (operations.sign, (A,), [-1, -1, 0, 1, 1, 1, 0, 1, -1, 1]),
    "less": (operations.less, (A, B), [1, 0, 1, 0, 0, 0, 0, 0, 1, 1]),
    "greater": (operations.greater, (A, B), [0, 0, 0, 1, 0, 1, 0, 1, 0, 0]),
    "not_equal": (operations.not_equal, (A, B), [1, 0, 1, 1, 0, 1, 0, 1, 1, 1]),
    "reached": (operations.reached, (A, B), [0, 1, 0, 1, 1, 1, 1, 1, 0, 0]),
    "where": (lambda a, b, c: operations.where(operations.less(a, 0.7), b, c), (A, B, C),
              [1, -1, 0.3, 0, 0.8, 9, 0, 6, 4, 0]),
    "number beside an array": (lambda a: operations.minimum(a, 0.3), (A,),
                               [-2.5, -1, 0, 1e-12, 0.3, 0.3, 0, 0.3, -INF, 0.3]),
    "rounded": (operations.rounded, (np.array([-2.5, -1.5, -0.5, 0.5, 1.5, 2.5, 0.5 - 2**-54, 1e15 + 0.5, -7.2]),),
                [-2, -2, 0, 0, 2, 2, 0, 1e15, -7]),
    "arctan2": (operations.arctan2, (np.array([-2.5, 0.0, 0.7, 3.0]), np.array([0.0, -2.0, 0.7, -3.0])),
                [-np.pi / 2, np.pi, np.pi / 4, 3 * np.pi / 4]),
}  # fmt: skip


def _function(of: Callable[..., Any], sizes: list[int]) -> casadi.Function:
    symbols = [casadi.SX.sym(f"in{k}", n) for k, n in enumerate(sizes)]
    arrays = [np.array([each[k] for k in range(each.numel())], dtype=object)[:, None] for each in symbols]
    return casadi.Function("f", symbols, [casadi.vertcat(*of(*arrays).ravel())])


@pytest.mark.parametrize("name", CASES)
def test_numbers_and_symbols_give_the_values_worked_out_by_hand(name: str) -> None:
    """Expected: typed in, at ties, both zeros and infinities; CasADi evaluates what was traced."""
    of, arrays, expected = CASES[name]
    _assert_equal(name, np.asarray(of(*arrays), dtype=float), expected)
    function = _function(of, [len(each) for each in arrays])
    _assert_equal(name, np.asarray(function(*arrays)).ravel(), expected)


def _assert_equal(name: str, found: Any, expected: list[float]) -> None:
    """Exactly; but for the last bit of an angle, which libraries round differently."""
    np.testing.assert_allclose(found, expected, rtol=3e-16 if name == "arctan2" else 0, atol=0, err_msg=name)
