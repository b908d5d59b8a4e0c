"""Clocks of whole runs, as an experiment states them: on both sides of each bound, word by word."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.uneven_loops import experiment_of

T, STEP = 5e-3, 1e-3
LOOP: dict[str, Any] = {"duration": 0.04, "sample_time": T, "plant_step": STEP}


def run_of(controller: Any = None, *, loop: Any = (), **tables: Any) -> gs.Record:
    return gs.run(experiment_of("pd", loop={**LOOP, **dict(loop)}, **tables), controller=controller)


def starts_of(**loop: Any) -> NDArray[np.intp]:
    """The rows at which samples act of a law whose forces are others at each."""
    count = iter(range(1, 100_000))
    seed = loop.pop("seed", 3)
    record = run_of(lambda _sample: np.full(6, 10.0 + next(count)), loop=loop, sensors={"seed": seed})
    return np.flatnonzero(np.diff(record["controller.force"][:, 4], prepend=0.0))


REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"loop": {"sample_time": 5.2e-3}}, r"plant_step 0\.001 s does not divide sample_time 0\.0052 s \(5\.2 times\); "
     r"expected a whole number, for instance a plant_step of 0\.00104 s"),
    ({"loop": {"sample_time": 1e-10}}, "does not divide sample_time 1e-10 s"),
    ({"sensors": {"sample_time": 1e-10}}, "the sensors' sample_time is 1e-10 s; expected a multiple"),
    ({"loop": {"sample_time": 4.8e-3}}, r"does not divide sample_time 0\.0048 s \(4\.8 times\)"),
    ({"loop": {"duration": 0.0398}}, r"does not divide duration 0\.0398 s \(39\.8 times\)"),
    ({"loop": {"duration": 1000.005}}, r"duration 1000 s has 1e\+06 plant steps of 0.001 s; .*1000000, .* about 4 GB"),
    ({"loop": {"jitter": 5e-3}}, r"jitter is 0\.005 s; expected less than the sample_time of 0\.005 s, and at "
     r"least the plant_step of 0\.001 s"),
    ({"loop": {"jitter": float(np.nextafter(5e-3, 0))}}, r"expected less than the sample_time"),
    ({"loop": {"jitter": 9e-4}}, r"jitter is 0\.0009 s; expected less than"),
    ({"sensors": {"sample_time": 2.2e-3}}, r"the sensors' sample_time is 0\.0022 s; expected a multiple of the "
     r"plant_step of 0\.001 s"),
    ({"sensors": {"sample_time": 2.8e-3}}, r"the sensors' sample_time is 0\.0028 s; expected a multiple"),
    ({"change": [{"at": 0.0202, "parameters": {"platform_mass": 12.0}}]},
     r"0\.0202 s; expected a time from 0 to 0\.04 s that is a multiple of the plant_step of 0\.001 s"),
    ({"change": [{"at": 0.0198, "parameters": {"platform_mass": 12.0}}]}, r"0\.0198 s; expected a time from 0 to"),
    ({"change": [{"at": 0.041, "parameters": {"platform_mass": 12.0}}]}, r"0\.041 s; expected a time from 0 to"),
]  # fmt: skip


@pytest.mark.parametrize(("tables", "message"), REFUSED)
def test_times_that_do_not_fit_the_clock_are_refused_with_both(tables: dict[str, Any], message: str) -> None:
    """Expected: in the first half of a step and in the second; before the first possible time and behind the last."""
    with pytest.raises(gs.GoughStewartError, match=message):
        run_of(**tables)


def test_times_at_the_very_bounds_are_taken() -> None:
    """Expected: all taken, within rounding: 0.3 s and 0.1 s have no whole numbers of 0.1 ms to the last bit."""
    changes = [{"at": at, "parameters": {"platform_mass": 12.0 + at}} for at in (0.0, 0.04)]
    for jitter, sensors in ((1e-3, 1e-3), (4e-3, 0.04)):
        record = run_of(loop={"jitter": jitter}, sensors={"sample_time": sensors}, change=changes)
        assert record["time"] == pytest.approx(np.arange(41) * STEP, abs=1e-15)
        assert record["platform_mass"] == pytest.approx([12.0] * 40 + [12.04], abs=0)
    clocks = {"duration": 0.3 * (1 + 1e-10), "sample_time": 0.1, "plant_step": 1e-4}
    assert len(run_of(lambda _sample: np.full(6, 45.0), loop=clocks, limits={"position_error": 9.0})["time"]) == 3001


def test_samples_are_late_by_up_to_the_jitter_and_hold_in_between() -> None:
    """Expected: a sample acts from 0 to 3 steps late; it measures there, and believes itself in time."""
    times = list[float]()

    def law(sample: gs.Sample) -> FloatArray:
        times.append(sample.time)
        return np.full(6, 10.0 + len(times))

    record = run_of(law, loop={"duration": 0.5, "jitter": 3.9e-3})
    assert times == pytest.approx(np.arange(100) * T, abs=1e-15)
    starts = np.flatnonzero(np.diff(record["controller.force"][:, 4], prepend=0.0))
    late = starts - 5 * np.arange(100)
    assert late[0] == 0
    # whole steps of up to 3.9: four shares of a quarter of 99, to five standard errors; none of more than 3
    assert set(late.tolist()) == {0, 1, 2, 3}
    assert np.abs(np.bincount(late) / 100 - 1 / 4).max() < 0.22
    assert record["measured.leg_length"][starts] == pytest.approx(record["leg_length"][starts], abs=0)


@pytest.mark.parametrize(
    ("jitter", "plant_step", "steps_a_sample", "largest"),
    [
        *((1e-3, 1e-3, 5, 1), (4e-3, 1e-3, 5, 4), (4.9e-3, 1e-3, 5, 4), (1.3e-3, 1e-4, 20, 13)),
        (0.3e-3, 0.1e-3, 5, 3),  # 2.9999999999999996 as a quotient
        (float(np.nextafter(2e-3, 0)), 1e-3, 5, 2),
    ],
)
def test_the_largest_delay_is_the_whole_number_of_steps_in_the_jitter(
    jitter: float, plant_step: float, steps_a_sample: int, largest: int
) -> None:
    """Expected: each number of steps from 0 to ⌊jitter / plant step⌋, within rounding, and no other."""
    step = steps_a_sample * plant_step
    starts = starts_of(duration=160 * step, sample_time=step, jitter=jitter, plant_step=plant_step)
    assert set((starts - steps_a_sample * np.arange(160)).tolist()) == set(range(largest + 1))


def test_the_last_sample_comes_before_the_end() -> None:
    """Expected: in a run that ends a step after its last sample, that one is never late; others are."""
    rows = [starts_of(duration=0.041, jitter=4e-3, seed=seed) for seed in range(12)]
    assert {int(starts[-1]) for starts in rows} == {40}
    assert len({int(starts[-2]) for starts in rows}) > 2


def test_readings_of_slower_encoders_are_noisy_and_held() -> None:
    """Expected: noise changes every 10 ms of the encoders, quantised after it; signals without either are exact."""
    noise, step = {"leg_length": 2e-4, "orientation": 1e-3}, {"leg_length": 1e-4, "velocity": 1e-3}
    sensors = {"noise": noise, "quantisation": step, "sample_time": 0.01, "seed": 6}
    record = run_of(lambda _sample: np.full(6, 45.0), loop={"duration": 0.5}, sensors=sensors)
    at = np.arange(0, 500, 5)
    ticks = at // 10 * 10
    for name in ("position", "angular_velocity", "leg_velocity"):
        assert record[f"measured.{name}"][at] == pytest.approx(record[name][ticks], abs=0)
    exact = np.rint(record["velocity"][ticks] / 1e-3) * 1e-3
    assert record["measured.velocity"][at] == pytest.approx(exact, abs=1e-15)
    off = {name: (record[f"measured.{name}"][at] - record[name][ticks])[::2] for name in noise}
    for name, sigma in noise.items():
        # 300 and 150 numbers: the standard error of a deviation is σ/√(2 n); beyond 4.5 in one of 10⁵ seeds
        deviation, n = off[name].std(), off[name].size
        expected = np.sqrt(sigma**2 + (step.get(name, 0.0) ** 2) / 12)
        assert abs(deviation - expected) < 4.5 * expected / np.sqrt(2 * n)
        assert record[f"measured.{name}"][at][1::2] == pytest.approx(record[f"measured.{name}"][at][::2], abs=0)
    lengths = record["measured.leg_length"][at] / 1e-4
    assert np.abs(lengths - np.round(lengths)).max() < 1e-6
    assert len(np.unique(off["orientation"])) == off["orientation"].size
