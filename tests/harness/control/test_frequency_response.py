"""Injections and what is made of their periods; loops that are a line of arithmetic."""

from typing import Any

import numpy as np
import pytest

from gough_stewart import GoughStewartError
from gough_stewart.harness.control.frequency_response import (
    InjectionChoice,
    Multisine,
    Prbs,
    Sweep,
    response_of_periods,
)

T = 1e-3
KINDS: dict[str, InjectionChoice] = {
    "multisine": Multisine(leg=2, amplitude=7.0, band=(4, 90), period=0.5, seed=3),
    "chirp": Sweep(leg=2, amplitude=7.0, band=(4, 90), period=0.5),
    "prbs": Prbs(leg=2, amplitude=7.0, band=(4, 90), period=0.5, seed=5),
}


def test_signals_fill_their_band_repeat_and_keep_to_their_size() -> None:
    """Expected: the transform of one period."""
    for choice in KINDS.values():
        one = choice.signal(T)
        power = np.abs(np.fft.rfft(one)) ** 2
        frequency = np.arange(len(power)) / (len(one) * T)
        inside = power[(frequency >= 4) & (frequency <= 90)].sum()
        assert np.abs(one).max() == pytest.approx(1, abs=1e-3)
        # of bits of τ = 4 ms: twice the integral of sinc² from 4 τ to 90 τ is 0.59
        assert inside > {"multisine": 0.999999, "chirp": 0.9, "prbs": 0.58}[choice.type] * power[1:].sum()
        assert (power[choice.lines(T)] > 1e-3 * power.max()).all()
    sweep, prbs = KINDS["chirp"].signal(T), KINDS["prbs"].signal(T)
    assert abs(sweep[0] - sweep[-1]) < np.abs(np.diff(sweep)).max()
    assert set(prbs) == {-1.0, 1.0}
    assert len(prbs) == 127 * 4  # bits of 4 ms, 2.8 a period of 90 Hz; 2^7 − 1 of them are 0.5 s or longer
    # a sum of sines without care for phases has its peak at four times its root mean square, or more
    assert np.sqrt((KINDS["multisine"].signal(T) ** 2).mean()) > 1 / 3
    other = Multisine(leg=2, amplitude=7.0, band=(4, 90), period=0.5, seed=4)
    assert np.abs(other.signal(T) - KINDS["multisine"].signal(T)).max() > 0.1
    few = Multisine(leg=1, amplitude=1.0, band=(1, 100), lines_at_most=7)
    assert few.lines(T).tolist() == [1, 2, 5, 10, 22, 46, 100]  # 100^(k/6), rounded


@pytest.mark.parametrize("seed", [0, 195, 12])
def test_a_multisine_is_the_flattest_of_fifty_sums_of_cosines(seed: int) -> None:
    """Expected: ∑ cos(2π k t/n + φ_k), drawn and summed here; of these seeds one takes its first sum, one its last."""
    choice = Multisine(leg=2, amplitude=7.0, band=(4, 90), period=0.5, lines_at_most=5, seed=seed)
    n, k, rng = 500, choice.lines(T), np.random.default_rng(seed)
    t = np.arange(n)[:, None] / n
    sums = [np.cos(2 * np.pi * (k * t + rng.uniform(size=len(k)))).sum(axis=1) for _ in range(50)]
    flattest = min(sums, key=lambda each: float(np.abs(each).max()))
    assert choice.signal(T) == pytest.approx(flattest / np.abs(flattest).max(), abs=1e-12)


def refused(match: str, **values: Any) -> None:
    made: dict[str, Any] = {"leg": 1, "amplitude": 1.0, "band": (1, 10)} | values
    with pytest.raises(GoughStewartError, match=match):
        Multisine(**made).forces(3000, T, np.eye(6))


def test_injections_that_cannot_be_are_refused_with_the_reason() -> None:
    refused(
        r"^expected leg \(1 to 6\) or mode \(surge, sway, heave, roll, pitch, yaw\), and only one of them$", leg=None
    )
    every = "'surge', 'sway', 'heave', 'roll', 'pitch' or 'yaw'"
    refused(rf"^mode: is 'lift'; expected {every}$", leg=None, mode="lift")
    refused("band is 0 to 10 Hz; expected two frequencies > 0, the lower one first", band=(0, 10))
    refused("band is 10 to 10 Hz", band=(10, 10))
    refused("only one of them", mode="heave")
    refused("leg.*7", leg=7)
    refused("band is 10 to 1 Hz.*the lower one first", band=(10, 1))
    refused("band is 1 to 600 Hz at a sample_time of 0.001 s.*500 Hz", band=(1, 600))
    refused("without a harmonic of the period of 0.05 s", band=(1, 10), period=0.05)
    refused("a run of 3 s has 1.5 periods of 2 s.*loop.duration of 6 s", period=2.0)
    refused("amplitude", amplitude=0.0)
    refused("amplitude", amplitude="5 Nm")
    with pytest.raises(GoughStewartError, match="bits; expected at most 1048575"):
        Prbs(leg=1, amplitude=1.0, band=(1e-4, 100)).signal(T)
    with pytest.raises(GoughStewartError, match=r"1\.5 periods, of which 1 settle"):
        response_of_periods(np.ones(150), np.ones(150), 100, np.array([3]), 1)
