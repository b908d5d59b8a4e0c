"""Injections of experiments: what their signals have in their band, and what no injection can be."""

from typing import Any

import numpy as np
import pytest

import gough_stewart as gs

T = 1e-3


def injection(kind: str, **keys: Any) -> Any:
    """The injection of an experiment, on leg 2 from 4 to 90 Hz unless it says otherwise."""
    table = {"type": kind, "leg": 2, "amplitude": 7.0, "band": [4, 90], **keys}
    plain = {name: value for name, value in table.items() if value is not None}
    return gs.load_experiment("frequency_response", {"injection": plain}).injection


def test_each_signal_has_the_form_of_its_kind() -> None:
    """Expected: bits of 4 ms, 2⁷ − 1 of them for half a second, with 0.59 of their power in the band; a low crest."""
    prbs = injection("prbs", period=0.5, seed=5)
    bits = prbs.signal(T)
    assert (set(bits), len(bits)) == ({-1.0, 1.0}, 127 * 4)
    assert len(injection("prbs", period=0.508).signal(T)) == 127 * 4  # exactly so many bits
    power = np.abs(np.fft.rfft(bits)) ** 2
    frequency = np.arange(len(power)) / (len(bits) * T)
    # twice the integral of sinc² from 4 τ to 90 τ
    assert power[(frequency >= 4) & (frequency <= 90)].sum() > 0.58 * power[1:].sum()
    assert (power[prbs.lines(T)] > 1e-3 * power.max()).all()
    again, other = (injection("prbs", period=0.5, seed=seed).signal(T) for seed in (5, 6))
    assert (bits == again).all()
    assert (bits != other).any()
    # a sum of sines without care for phases has its peak at four times its root mean square, or more
    assert np.sqrt((injection("multisine", period=0.5, seed=3).signal(T) ** 2).mean()) > 1 / 3
    few = injection("multisine", band=[1, 100], lines_at_most=7)
    assert few.lines(T).tolist() == [1, 2, 5, 10, 22, 46, 100]  # 100^(k/6), rounded


@pytest.mark.parametrize("seed", [0, 195, 12])
def test_a_multisine_is_the_flattest_of_fifty_sums_of_cosines(seed: int) -> None:
    """Expected: ∑ cos(2π k t/n + φ_k), drawn and summed here; of these seeds one takes its first sum, one its last."""
    choice = injection("multisine", period=0.4997, lines_at_most=5, seed=seed)  # whole samples
    n, k, rng = 500, choice.lines(T), np.random.default_rng(seed)
    t = np.arange(n)[:, None] / n
    sums = [np.cos(2 * np.pi * (k * t + rng.uniform(size=len(k)))).sum(axis=1) for _ in range(50)]
    flattest = min(sums, key=lambda values: float(np.abs(values).max()))
    assert choice.signal(T) == pytest.approx(flattest / np.abs(flattest).max(), abs=1e-12)


EVERY = "'surge', 'sway', 'heave', 'roll', 'pitch' or 'yaw'"


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"leg": None}, r"expected leg \(1 to 6\) or mode \(surge, .* yaw\), and only one of them$"),
        ({"leg": None, "mode": "lift"}, rf"mode: is 'lift'; expected {EVERY}$"),
        ({"mode": "heave"}, "only one of them"),
        ({"leg": 7}, "leg.*7"),
        ({"band": [0, 10]}, "band is 0 to 10 Hz; expected two frequencies > 0, the lower one first"),
        ({"band": [10, 10]}, "band is 10 to 10 Hz.*the lower one first"),
        ({"band": [1, 500]}, "band is 1 to 500 Hz at a sample_time of 0.001 s.*500 Hz"),
        ({"band": [1, 10], "period": 0.05}, "without a harmonic of the period of 0.05 s"),
        ({"period": 2.0}, "a run of 3 s has 1.5 periods of 2 s.*loop.duration of 6 s"),
        ({"amplitude": 0.0}, "amplitude"),
        ({"amplitude": "5 Nm"}, "amplitude"),
        ({"kind": "prbs", "band": [1e-4, 100]}, "bits; expected at most 1048575"),
    ],
)
def test_injections_that_cannot_be_are_refused_with_the_reason(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(gs.GoughStewartError, match=message):
        injection(**{"kind": "multisine", **keys}).forces(3000, T, np.eye(6))
