"""Integration of smooth equations almost to rounding."""

import numpy as np
import pytest

from gough_stewart.model.errors import StepError
from gough_stewart.model.extrapolation import extrapolated
from gough_stewart.model.vectors import FloatArray


@pytest.mark.parametrize("length", [0.01, 0.7, 30.0])
def test_a_driven_oscillator_ends_where_its_closed_form_does(length: float) -> None:
    """Expected: ẍ = −4 x + 3 cos t has x = cos t for x(0) = 1, ẋ(0) = 0; the start is not at time 0."""

    def derivatives(t: float, x: FloatArray) -> FloatArray:
        return np.array([x[1], -4 * x[0] + 3 * np.cos(t)])

    start = 0.3
    found = extrapolated(derivatives, np.array([np.cos(start), -np.sin(start)]), (start, start + length), 1e-13)
    assert found == pytest.approx([np.cos(start + length), -np.sin(start + length)], abs=1e-11)


def test_a_loose_tolerance_costs_fewer_evaluations() -> None:
    """Expected: of e^{−5t} over 1, at most the tolerance away from it, and the looser one with less work."""
    work = []
    for tolerance in (1e-4, 1e-12):
        times: list[float] = []

        def derivatives(t: float, x: FloatArray, times: list[float] = times) -> FloatArray:
            times.append(t)
            return -5 * x

        found = extrapolated(derivatives, np.ones(1), (0.0, 1.0), tolerance)
        assert found == pytest.approx([np.exp(-5)], abs=tolerance)
        work.append(len(times))
    assert work[0] < work[1] / 2


def test_a_pole_is_an_error_with_its_time() -> None:
    """Expected: ẋ = x² from 1 has its pole at 1."""
    with np.errstate(all="ignore"), pytest.raises(StepError, match="1e-12") as caught:
        extrapolated(lambda _t, x: x**2, np.ones(1), (0.0, 1.5), 1e-12)
    assert caught.value.time == pytest.approx(1.0, abs=0.01)
