"""Clocks of whole runs, as an experiment states them: on both sides of each bound, word by word."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import gough_stewart as gs
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


@pytest.mark.parametrize(
    ("jitter", "plant_step", "steps_a_sample", "largest"),
    [
        *((1e-3, 1e-3, 5, 1), (4e-3, 1e-3, 5, 4), (4.9e-3, 1e-3, 5, 4), (1.3e-3, 1e-4, 20, 13)),
        (0.3e-3, 0.1e-3, 5, 3),  # 2.9999999999999996 as a quotient
        (float(np.nextafter(2e-3, 0)), 1e-3, 5, 2),
    ],
)
def test_samples_are_late_by_any_whole_number_of_steps_in_the_jitter(
    jitter: float, plant_step: float, steps_a_sample: int, largest: int
) -> None:
    """Expected: each number of steps from 0 to ⌊jitter / plant step⌋, within rounding, and no other; alike often."""
    step = steps_a_sample * plant_step
    starts = starts_of(duration=160 * step, sample_time=step, jitter=jitter, plant_step=plant_step)
    late = starts - steps_a_sample * np.arange(160)
    assert late[0] == 0
    assert set(late.tolist()) == set(range(largest + 1))
    share = 1 / (largest + 1)  # to five standard errors
    assert np.abs(np.bincount(late) / 160 - share).max() < 5 * np.sqrt(share * (1 - share) / 160)


def test_the_last_sample_comes_before_the_end() -> None:
    """Expected: in a run that ends a step after its last sample, that one is never late; others are."""
    rows = [starts_of(duration=0.041, jitter=4e-3, seed=seed) for seed in range(12)]
    assert {int(starts[-1]) for starts in rows} == {40}
    assert len({int(starts[-2]) for starts in rows}) > 2
