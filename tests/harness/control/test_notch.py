"""The notch of `[controller.notch]`: its formula in every channel, and what it cannot be."""

from typing import Any

import control
import numpy as np
import pytest

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.uneven import UNEVEN

T = 0.0015
GAINS: dict[str, Any] = {
    "proportional_gain": [2.1e5, 1.7e5, 2.6e5, 1.4e5, 3.0e5, 1.9e5],
    "derivative_gain": [2.4e4, 1.8e4, 2.9e4, 1.5e4, 3.1e4, 2.0e4],
    "derivative_filter": 0.004,
}
INTEGRAL: dict[str, Any] = {"integral_gain": [9e4, 5e4, 0.0, 7e4, 3e4, 8e4], "anti_windup_time": 0.3}
NOTCH: dict[str, Any] = {"frequency": 41.0, "damping": 0.35, "depth": 0.15}


def biquad(frequency: float, damping: float, depth: float) -> tuple[FloatArray, FloatArray]:
    """Numerator and denominator in z⁻¹, by s = K (1 − z⁻¹)/(1 + z⁻¹), K = ω/tan(ω T/2), multiplied out by hand.

    (s² + 2 g ω s + ω²) (1 + z⁻¹)² = (K² + 2 g ω K + ω²) + (2 ω² − 2 K²) z⁻¹ + (K² − 2 g ω K + ω²) z⁻²
    """
    w = 2 * np.pi * frequency
    K = w / np.tan(w * T / 2)

    def polynomial(g: float) -> FloatArray:
        return np.array([K**2 + 2 * g * w * K + w**2, 2 * w**2 - 2 * K**2, K**2 - 2 * g * w * K + w**2])

    return polynomial(depth * damping), polynomial(damping)


@pytest.mark.parametrize("integral", [{}, INTEGRAL], ids=["pd", "pid"])
@pytest.mark.parametrize("notch", [NOTCH, {"frequency": 300.0, "damping": 0.03, "depth": 0.9}, {"frequency": 0.6}])
def test_the_notch_filters_the_forces_of_every_channel(notch: dict[str, float], integral: dict[str, Any]) -> None:
    """Expected: the controller without it times the biquad; its depth at the frequency, 1 at 0 Hz and half the rate."""
    kind: Any = gs.PID if integral else gs.PD
    systems = (
        kind(**GAINS, **integral, **extra).controller(UNEVEN, T).system for extra in ({}, {"notch": gs.Notch(**notch)})
    )
    plain, notched = (control.ss(*(getattr(system, name) for name in "ABCD"), T) for system in systems)
    values = {"damping": 0.5, "depth": 0.0} | notch
    b, a = biquad(**values)
    for frequency, size in ((0.1, None), (17.0, None), (values["frequency"], values["depth"]), (0.5 / T, 1.0)):
        z = np.exp(2j * np.pi * frequency * T)
        factor = np.polyval(b, z) / np.polyval(a, z)
        assert notched(z) == pytest.approx(plain(z) * factor, rel=1e-7, abs=1e-7 * np.abs(plain(z)).max())
        assert size is None or abs(factor) == pytest.approx(size, abs=1e-9)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"frequency": 0}, "frequency: is 0; expected > 0 Hz"),
        ({"frequency": "3 m"}, "found the unit 'm'"),
        ({"frequency": 3, "damping": -1}, "damping: is -1; expected > 0"),
        ({"frequency": 3, "depth": 1}, "depth: is 1; expected a number from 0 to below 1"),
        ({"frequency": 3, "width": 1}, "width"),
        ({"frequency": 333.4}, r"notch\.frequency is 333\.4 Hz; expected less than 333\.333 Hz"),  # 1/(2 · 1.5 ms)
    ],
)
def test_impossible_values_are_refused(values: dict[str, Any], words: str) -> None:
    with pytest.raises(gs.GoughStewartError, match=words):
        gs.PD(bandwidth=3, notch=gs.Notch(**values)).controller(UNEVEN, T)
    gs.PD(bandwidth=3, notch=gs.Notch(frequency=333.3)).controller(UNEVEN, T)
