"""The clocks of a run: rows, samples, jitter, and encoders with a clock of their own."""

import numpy as np
import pytest

from gough_stewart.harness.control.makers import Sample
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.loop.loop import Sensors
from gough_stewart.harness.loop.timing import MOST_STEPS, Timing
from gough_stewart.model.vectors import FloatArray
from tests.support.fake_plants import LENGTH
from tests.support.loops import FORCES, loop_of, reference, run_with


@pytest.mark.parametrize(
    ("clocks", "match"),
    [
        ((1.0, 0.01, 0.02), "does not divide sample_time .*for instance a plant_step of 0.01 s"),
        ((0.004, 0.02, 0.01), "does not divide duration"),
        ((-1.0, 0.01, 0.01), "duration is -1.0"),
        ((1.0, float("nan"), 0.01), "sample_time is nan"),
        ((1.0, 0.01, 0.0), "plant_step is 0.0"),
        ((1.0, float("inf"), 0.01), "sample_time is inf"),
        ((-1.0, -1.0, -1.0), "duration is -1.0; expected a time > 0 s"),  # the first of several, in this order
        ((1.0, -1.0, -1.0), "sample_time is -1.0; expected a time > 0 s"),
        ((1.005, 0.025, 0.01), "plant_step 0.01 s does not divide sample_time 0.025 s"),
        ((1e9, 0.01, 0.01), r"duration 1e\+09 s has 1e\+11 plant steps of 0.01 s; expected at most 1000000"),
    ],
)
def test_clocks_that_do_not_fit_are_refused(clocks: tuple[float, float, float], match: str) -> None:
    with pytest.raises(ControllerError, match=match):
        Timing(*clocks)


def test_clocks_fit_within_rounding_and_up_to_the_most_steps() -> None:
    """Expected: 0.1/0.001 and the like, which are no whole numbers to the last bit; a million steps."""
    assert Timing(0.3, 0.1, 0.001).steps_a_sample == 100
    assert Timing(1 + 5e-10, 0.01, 0.001).steps == 1000
    assert Timing(float(MOST_STEPS), 1.0, 1.0).steps == 1_000_000
    with pytest.raises(ControllerError, match="expected at most 1000000"):
        Timing(MOST_STEPS + 1.0, 1.0, 1.0)


def test_the_last_sample_comes_before_the_end() -> None:
    """Expected: in a run that ends a step after its last sample, that one is never late."""
    rows = [Timing(0.041, 0.01, 0.001, jitter=0.009, seed=seed).rows_of_samples for seed in range(20)]
    assert {int(each[-1]) for each in rows} == {40}
    assert len({int(each[-2]) for each in rows}) > 4


def test_a_law_knows_nothing_of_its_lateness() -> None:
    """Expected: nominal time and reference, the state of the late row; commands act from there on."""
    seen = []

    def law(sample: Sample) -> FloatArray:
        seen.append(sample)
        return FORCES * (1.0 + len(seen) % 2)

    timing = Timing(0.2, 0.01, 0.001, jitter=0.006, seed=3)
    run = run_with(law, loop_of(timing=timing))
    rows = timing.rows_of_samples
    assert (rows != np.arange(0, 200, 10)).any()
    assert [each.time for each in seen] == pytest.approx(np.arange(20) * 0.01)
    assert np.array([each.reference["leg_length"] for each in seen]) == pytest.approx(
        reference(np.arange(20) * 0.01)[:, LENGTH], abs=1e-12
    )
    assert np.array([each.measured["leg_length"] for each in seen]) == pytest.approx(run.results[rows, LENGTH], abs=0)
    assert np.flatnonzero(np.diff(run.inputs[:200, 3])).tolist() == (rows[1:] - 1).tolist()
    assert run.sample_of_row.tolist() == [int((rows <= k).sum()) - 1 for k in range(201)]


@pytest.mark.parametrize("encoder", [0.004, 0.025])
def test_encoders_with_a_clock_of_their_own_hold_their_latest_reading(encoder: float) -> None:
    """Expected: at a sample the lengths of the encoders' last tick, quantised, whether they are faster or slower."""
    sensors = Sensors(quantisation={"leg_length": 1e-4}, sample_time=encoder)
    swing = lambda sample: np.sin(40 * sample.time + np.arange(6))  # noqa: E731
    run = run_with(swing, loop_of(0.3, 0.01, 0.001, sensors=sensors))
    ticks = np.floor(np.arange(0, 300, 10) / round(encoder / 1e-3) + 1e-9).astype(int) * round(encoder / 1e-3)
    assert run.measured[:, LENGTH] == pytest.approx(np.rint(run.results[ticks, LENGTH] / 1e-4) * 1e-4, abs=1e-12)
    assert (run.measured[:, :12] == run.results[ticks, :12]).all()


@pytest.mark.parametrize("jitter", [np.nextafter(0.01, 0), float("nan")])
def test_a_jitter_to_the_next_sample_within_rounding_or_none_at_all_is_refused(jitter: float) -> None:
    with pytest.raises(ControllerError, match="expected less than the sample_time"):
        Timing(1.0, 0.01, 0.001, jitter=jitter)


@pytest.mark.parametrize(
    ("jitter", "plant_step", "largest"),
    [
        (1e-3, 1e-3, 1),
        (5e-3, 1e-3, 5),
        (4.9e-3, 1e-3, 4),
        (0.3e-3, 0.1e-3, 3),  # 2.9999999999999996 as a quotient
        (1.3e-3, 0.1e-3, 13),
        (np.nextafter(2e-3, 0), 1e-3, 2),
        (9.9e-3, 1e-3, 9),
    ],
)
def test_the_largest_delay_is_the_whole_number_of_steps_in_the_jitter(
    jitter: float, plant_step: float, largest: int
) -> None:
    """Expected: each number of steps from 0 to ⌊jitter / plant step⌋, within rounding, and no other."""
    for shape in (jitter, np.array([jitter, 0.0])):
        timing = Timing(20.0, 0.01, plant_step, jitter=shape, seed=3)
        rows = timing.rows_of_samples.reshape(2000, -1)[:, 0]
        assert set(rows - timing.steps_a_sample * np.arange(2000)) == set(range(largest + 1))
