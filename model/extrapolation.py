"""Integration of smooth equations almost to rounding, for reference results: the extrapolated midpoint rule.

The result of the modified midpoint rule with n substeps has an error in even powers of 1/n [Gragg, SIAM J. Numer. Anal.
2, 1965], which polynomial extrapolation to 1/n = 0 removes [Bulirsch & Stoer, Numer. Math. 8, 1966].
"""

from collections.abc import Callable

import numpy as np

from gough_stewart.model.errors import StepError
from gough_stewart.model.vectors import FloatArray

Derivatives = Callable[[float, FloatArray], FloatArray]
_SUBSTEPS = (2, 4, 6, 8, 10, 12, 14, 16)
# Halvings of a span.
_MOST_HALVINGS = 12


def extrapolated(
    derivatives: Derivatives, x: FloatArray, span: tuple[float, float], tolerance: float, halvings: int = 0
) -> FloatArray:
    """State at the end of a time span; its halves are integrated one by one where extrapolation does not converge.

    Parameters
    ----------
    derivatives
        ẋ(t, x); returns a new array in every call.
    span
        Start and end [s].
    tolerance
        Of the last two extrapolations, max |δx| / (1 + |x|).

    Raises
    ------
    StepError
        The tolerance is not reached in a 4096th of the span.
    """
    start, end = span
    rate = derivatives(start, x)
    row: list[FloatArray] = []  # T_{j,0} … T_{j,j} of Neville's scheme
    for j, n in enumerate(_SUBSTEPS):
        before, row = row, [_midpoint(derivatives, x, rate, span, n)]
        for k in range(1, j + 1):
            row.append(row[-1] + (row[-1] - before[k - 1]) / ((n / _SUBSTEPS[j - k]) ** 2 - 1))
        # two neighbours can be equal by chance
        if j and all(_differ(row[-1], each) <= tolerance for each in (row[-2], before[-1])):
            return row[-1]
    if halvings == _MOST_HALVINGS:
        raise StepError("span", end - start, start, f"the tolerance {tolerance:g} cannot be met")
    middle = (start + end) / 2
    x = extrapolated(derivatives, x, (start, middle), tolerance, halvings + 1)
    return extrapolated(derivatives, x, (middle, end), tolerance, halvings + 1)


def _differ(x: FloatArray, other: FloatArray) -> float:
    return float(np.max(np.abs(x - other) / (1 + np.abs(x))))


def _midpoint(
    derivatives: Derivatives, x: FloatArray, rate: FloatArray, span: tuple[float, float], n: int
) -> FloatArray:
    """The modified midpoint rule with n substeps, smoothed at the end."""
    start, end = span
    h = (end - start) / n
    last, now = x, x + h * rate
    for m in range(1, n):
        last, now = now, last + 2 * h * derivatives(start + m * h, now)
    return (last + now + h * derivatives(end, now)) / 2
