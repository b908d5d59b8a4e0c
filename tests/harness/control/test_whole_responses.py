"""All numbers of `gs.frf` for uneven loops, by plain sums over the record and a loop written from the documentation."""

from typing import Any

import numpy as np
import pytest
from scipy.stats import f as fisher

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.documented_loop import linear
from tests.support.uneven import UNEVEN
from tests.support.uneven_loops import LOOPS, POSE, experiment_of

SIGMA = 2e-6  # of the length sensors [m]
# Another loop, channel, signal and number of settling periods in each; runs end in the middle of a period.
RUNS: dict[str, dict[str, Any]] = {
    "leg 5": {"loop": "pd", "settle": 2, "periods": 7.4, "plant_step": 2.5e-3,
              "injection": {"type": "multisine", "leg": 5, "lines_at_most": 9, "seed": 4}},
    "yaw": {"loop": "task", "settle": 1, "periods": 6.6, "plant_step": 5e-3,
            "injection": {"type": "chirp", "mode": "yaw"}},
    "sway": {"loop": "pid", "settle": 3, "periods": 6.3, "plant_step": 2e-3,
             "injection": {"type": "multisine", "mode": "sway", "lines_at_most": 12}},
}  # fmt: skip
PERIOD = 0.4  # [s]


class Case:
    """A run with an injection, what `frf` says of it, and the transforms of its periods."""

    def __init__(self, channel: str) -> None:
        given = RUNS[channel]
        self.channel, self.settle, self.periods = channel, given["settle"], int(given["periods"]) - given["settle"]
        self.options = LOOPS[given["loop"]]
        self.T = self.options["sample_time"]
        injection = {**given["injection"], "amplitude": 1.5, "band": [3, 60], "period": PERIOD}
        experiment = experiment_of(
            given["loop"],
            plant={},
            injection={**injection, "settle": self.settle},
            sensors={"noise": {"leg_length": SIGMA}, "seed": 3},
            loop={"duration": round(given["periods"] * PERIOD / self.T) * self.T, "sample_time": self.T}
            | {"plant_step": given["plant_step"], "delay": self.options["delay"]},
        )
        frictionless = {"platform.parameters.leg_coulomb_friction": 0.0}
        self.record = gs.run(experiment, {"controller.feedforward": "gravity", **frictionless})
        self.found = gs.frf(self.record)
        self.n = round(PERIOD / self.T)
        # what the excited channel is, from directions of the legs and arms of the joints
        self.J = linear(self.options, UNEVEN, POSE).jacobian
        if channel.startswith("leg"):
            self.forces = self.sees = np.eye(6)[int(channel[-1]) - 1]
        else:
            k = ["surge", "sway", "heave", "roll", "pitch", "yaw"].index(channel)
            along = np.linalg.inv(self.J.T)[:, k]
            self.forces = along / np.abs(along).max()
            self.sees = self.J[:, k] * np.abs(along).max()

    def by_period(self, forces: FloatArray) -> Any:
        """Transforms (periods, lines) of the channel's force (m, 6) at the samples, harmonic by harmonic."""
        turns = np.outer(np.round(self.found.frequency * PERIOD), np.arange(self.n)) / self.n
        used = (forces @ self.sees)[self.settle * self.n : (self.settle + self.periods) * self.n]
        return used.reshape(self.periods, self.n) @ np.exp(-2j * np.pi * turns).T

    def at_samples(self, name: str) -> FloatArray:
        """A column of the commands, one row a sample: what was commanded at a sample stands in all of its rows."""
        every = round(self.T / self.record.metadata["plant_step"])
        return np.asarray(self.record[name][:-1:every])


@pytest.fixture(scope="module", params=RUNS)
def case(request: pytest.FixtureRequest) -> Case:
    return Case(request.param)


def test_the_channel_is_pushed_by_the_signal_of_its_kind(case: Case) -> None:
    """Expected: the largest force on a leg 1.5 N, the same signal for all; of a chirp by its formula."""
    injected = case.at_samples("controller.injection")
    assert case.found.channel == case.channel
    assert np.abs(injected).max() == pytest.approx(1.5, rel=1e-3)
    signal = injected @ case.sees
    assert injected == pytest.approx(np.outer(signal, case.forces), abs=1e-12)
    assert signal[case.n :] == pytest.approx(signal[: -case.n], abs=1e-12)
    if case.channel == "yaw":
        # whole cycles in the period: 3 to 60 Hz are 12.6 on average of 0.4 s, rounded up to 13
        t = np.arange(case.n) / case.n
        sweep = (60 - 3) / 2 * PERIOD
        assert signal[: case.n] == pytest.approx(1.5 * np.sin(2 * np.pi * ((13 - sweep) * t + sweep * t**2)), abs=1e-9)
    else:
        power = np.abs(np.fft.rfft(signal[: case.n])) ** 2
        lines = np.round(case.found.frequency * PERIOD).astype(int)
        assert power[lines] == pytest.approx(power[lines[0]])
        assert np.delete(power, lines).max() < 1e-20 * power.max()


def test_frequencies_are_harmonics_of_the_period_in_the_band(case: Case) -> None:
    """Expected: all from 3 to 60 Hz, or as many as asked for, spaced logarithmically and rounded."""
    inside = np.arange(2, 25)  # 5 to 60 Hz: 2.5 Hz are below the band
    most = RUNS[case.channel]["injection"].get("lines_at_most")
    chosen = inside if most is None else np.unique(np.round(2 * (24 / 2) ** (np.arange(most) / (most - 1))))
    assert case.found.frequency == pytest.approx(chosen / PERIOD)
    assert case.found.measured.periods == case.periods


def test_every_number_is_that_of_the_transforms_of_the_periods(case: Case) -> None:
    """Expected: S, its circle by Fisher's distribution, T, L, its circle, coherence; and the table of all of them."""
    force = case.at_samples("controller.force") - case.at_samples("controller.feedforward")
    D, U = case.by_period(case.at_samples("controller.injection")), case.by_period(force)
    S = (U * D.conj()).sum(axis=0) / (np.abs(D) ** 2).sum(axis=0)
    P = case.periods
    spread = (np.abs(U - S * D) ** 2).sum(axis=0) / (P - 1)
    radius = np.sqrt(fisher.ppf(0.95, 2, 2 * P - 2) * spread / (np.abs(D) ** 2).sum(axis=0))
    coherence = np.abs((U * D.conj()).sum(axis=0)) ** 2 / ((np.abs(U) ** 2).sum(axis=0) * (np.abs(D) ** 2).sum(axis=0))
    measured = case.found.measured
    assert pytest.approx(S, rel=1e-9) == measured.S
    assert pytest.approx(1 - S, rel=1e-9) == measured.T
    assert pytest.approx(1 / S - 1, rel=1e-8) == measured.L
    assert measured.radius == pytest.approx(radius, rel=1e-6)
    assert measured.loop_radius == pytest.approx(radius / np.abs(S) ** 2, rel=1e-6)
    assert 1 - measured.coherence == pytest.approx(1 - coherence, rel=1e-4, abs=1e-12)
    assert radius.min() > 1e-9
    predicted = case.found.predicted
    assert predicted is not None
    table = case.found.table()
    expected = {"frequency": case.found.frequency, "coherence": coherence}
    for name, values, circle in (("S", S, radius), ("T", 1 - S, radius), ("L", 1 / S - 1, radius / np.abs(S) ** 2)):
        expected |= {f"{name}.gain": np.abs(values), f"{name}.phase": np.angle(values), f"{name}.radius": circle}
    model = 1 / (1 + predicted)
    for name, values in (("S", model), ("T", 1 - model), ("L", predicted)):
        expected |= {f"predicted.{name}.gain": np.abs(values), f"predicted.{name}.phase": np.angle(values)}
    assert set(table.columns) == set(expected)
    for name, values in expected.items():
        assert table[name].to_numpy() == pytest.approx(values, rel=1e-6), name


def test_the_linear_model_is_the_documented_loop_seen_by_the_channel(case: Case) -> None:
    """Expected: 1/(b S a) − 1, a the forces of the channel and b its measure, b a = 1; the run agrees within noise.

    A deviation exceeds r radii of 95 % with the probability (1 + 2 r² F/m)^(−m/2), m = 2 (P − 1) and F of Fisher's
    distribution: 4 radii on any line in one of 300 seeds, if P = 3; all lines within a tenth of them in none.
    """
    L = linear(case.options, UNEVEN, POSE).response(2 * np.pi * case.found.frequency)
    seen = np.einsum("i,nij,j->n", case.sees, np.linalg.inv(np.eye(6) + L), case.forces)
    assert case.found.predicted == pytest.approx(1 / seen - 1, rel=1e-5)
    gap = np.abs(case.found.measured.S - seen)
    assert (gap < 4 * case.found.measured.radius + 2e-4).all()
    assert (gap > 0.1 * case.found.measured.radius).any()
    assert np.ptp(np.abs(seen)) > 0.04
    assert case.found.notes == ()
