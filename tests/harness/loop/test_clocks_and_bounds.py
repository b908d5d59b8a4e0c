"""Clocks, limits and bounds of whole runs, as an experiment states them: on both sides of each bound, word by word."""

from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.loop.timing import MOST_STEPS, Timing
from tests.support.arrays import FloatArray
from tests.support.uneven import UNEVEN
from tests.support.uneven_loops import experiment_of

T, STEP = 5e-3, 1e-3
LOOP: dict[str, Any] = {"duration": 0.04, "sample_time": T, "plant_step": STEP}


def run_of(controller: Any = None, *, loop: Any = (), **tables: Any) -> gs.Record:
    return gs.run(experiment_of("pd", loop={**LOOP, **dict(loop)}, **tables), controller=controller)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"loop": {"sample_time": 5.2e-3}}, r"plant_step 0\.001 s does not divide sample_time 0\.0052 s "
         r"\(5\.2 times\); expected a whole number, for instance a plant_step of 0\.00104 s"),
        ({"loop": {"sample_time": 4.8e-3}}, r"does not divide sample_time 0\.0048 s \(4\.8 times\)"),
        ({"loop": {"duration": 0.0402}}, r"does not divide duration 0\.0402 s \(40\.2 times\)"),
        ({"loop": {"duration": 0.0398}}, r"does not divide duration 0\.0398 s \(39\.8 times\)"),
        ({"loop": {"jitter": 5e-3}}, r"jitter is 0\.005 s; expected less than the sample_time of 0\.005 s, and at "
         r"least the plant_step of 0\.001 s"),
        ({"loop": {"jitter": 9e-4}}, r"jitter is 0\.0009 s; expected less than"),
        ({"sensors": {"sample_time": 2.2e-3}}, r"the sensors' sample_time is 0\.0022 s; expected a multiple of the "
         r"plant_step of 0\.001 s"),
        ({"sensors": {"sample_time": 2.8e-3}}, r"the sensors' sample_time is 0\.0028 s; expected a multiple"),
        ({"sensors": {"sample_time": 4e-4}}, r"the sensors' sample_time is 0\.0004 s; expected a multiple"),
        ({"change": [{"at": 0.0202, "parameters": {"platform_mass": 12.0}}]},
         r"0\.0202 s; expected a time from 0 to 0\.04 s that is a multiple of the plant_step of 0\.001 s"),
        ({"change": [{"at": 0.0198, "parameters": {"platform_mass": 12.0}}]}, r"0\.0198 s; expected a time from 0 to"),
        ({"change": [{"at": 0.041, "parameters": {"platform_mass": 12.0}}]}, r"0\.041 s; expected a time from 0 to"),
    ],
)  # fmt: skip
def test_times_that_do_not_fit_the_clock_are_refused_with_both(tables: dict[str, Any], message: str) -> None:
    """Expected: in the first half of a step and in the second; before the first possible time and behind the last."""
    with pytest.raises(gs.GoughStewartError, match=message):
        run_of(**tables)


def test_times_at_the_very_bounds_are_taken() -> None:
    """Expected: a jitter of one step and of all but one, readings at every step, changes at the first and last row."""
    changes = [{"at": at, "parameters": {"platform_mass": 12.0 + at}} for at in (0.0, 0.04)]
    for jitter, sensors in ((1e-3, 1e-3), (4e-3, 0.04)):
        record = run_of(loop={"jitter": jitter}, sensors={"sample_time": sensors}, change=changes)
        assert record["time"] == pytest.approx(np.arange(41) * STEP, abs=1e-15)
        assert record["platform_mass"] == pytest.approx([12.0] * 40 + [12.04], abs=0)


def test_samples_are_late_by_up_to_the_jitter_and_hold_in_between() -> None:
    """Expected: a sample acts from 0 to 3 steps late; it measures there, and believes itself in time."""
    told = list[float]()

    def law(sample: gs.Sample) -> FloatArray:
        told.append(sample.time)
        return np.full(6, 10.0 + len(told))

    record = run_of(law, loop={"duration": 0.5, "jitter": 3.9e-3})
    assert told == pytest.approx(np.arange(100) * T, abs=1e-15)
    starts = np.flatnonzero(np.diff(record["controller.force"][:, 4], prepend=0.0))
    late = starts - 5 * np.arange(100)
    assert late[0] == 0
    # whole steps of up to 3.9: four shares of a quarter of 99, to five standard errors; none of more than 3
    assert set(late.tolist()) == {0, 1, 2, 3}
    assert np.abs(np.bincount(late) / 100 - 1 / 4).max() < 0.22
    assert record["measured.leg_length"][starts] == pytest.approx(record["leg_length"][starts], abs=0)
    other = run_of(law, loop={"duration": 0.5, "jitter": 3.9e-3}, sensors={"seed": 1})
    assert (np.flatnonzero(np.diff(other["controller.force"][:, 4], prepend=0.0)) != starts).any()


def test_forces_that_are_large_together_are_no_fault() -> None:
    """Expected: six of 4e29 N, whose sum is beyond 1e30, are cut to the limit; one of 1.1e30 N ends the run."""
    for force, status in ((4e29, "completed"), (-4e29, "completed"), (1.1e30, "diverged"), (-1.1e30, "diverged")):
        one = np.full(6, np.sign(force) * 4e29)
        one[4] = force
        record = run_of(lambda _sample, one=one: one, actuators={"force_limit": 90.0})
        outcome = record.metadata["outcome"]
        assert outcome["status"] == status
        assert record["controller.force"][0] == pytest.approx(one, rel=1e-15)
        if status == "completed":
            assert record["actuator_force"][1] == pytest.approx(np.sign(force) * np.full(6, 90.0))
            assert record["flag.force_limited"].all()
        else:
            assert outcome["cause"] == f"the controller's forces are {one.tolist()} N"
            assert outcome["time"] == 0


def test_the_first_leg_beyond_its_stroke_ends_a_run_that_shall_stop() -> None:
    """Expected: the first row with a length outside of the nominal stroke, of either side; the message has its length.

    At home the shortest leg is 2 mm above its limit, or the longest one 2 mm below its own, and a force drives it out.
    """
    length = gs.leg_geometry(UNEVEN, UNEVEN.home_position, UNEVEN.home_orientation).length
    shortest, longest = int(length.argmin()), int(length.argmax())
    for leg, sign, limits in ((shortest, -1, (length.min() - 2e-3, 9.0)), (longest, 1, (0.1, length.max() + 2e-3))):
        stroke = {"leg_length_min": float(limits[0]), "leg_length_max": float(limits[1])}
        whole = experiment_of("pd").platform.model_dump(exclude_unset=True)
        whole["parameters"] |= stroke
        push = sign * 400 * (np.arange(6) == leg)
        records = [
            run_of(
                lambda _sample, push=push: push,
                loop={"duration": 0.2},
                platform=whole,
                reference={"type": "hold"},
                actuators={"force_limit": "none"},
                limits={"stroke": how, "reference": "warn"},
            )
            for how in ("warn", "stop", "ignore")
        ]
        beyond = (records[0]["leg_length"] < limits[0]) | (records[0]["leg_length"] > limits[1])
        first = int(beyond.any(axis=1).argmax())
        assert first > 3
        outcome = records[1].metadata["outcome"]
        if beyond[first].sum() == 1:
            assert beyond[first, leg]
        named = int(beyond[first].argmax())
        said = (
            f"leg {named + 1} is {records[0]['leg_length'][first, named]:.6g} m long; its stroke is {limits[0]:g} to "
        )
        assert outcome["cause"].startswith(said + f"{limits[1]:g} m")
        assert (outcome["status"], outcome["time"]) == ("stopped", pytest.approx(first * STEP))
        assert records[1]["time"][-1] == pytest.approx(first * STEP)
        for record in (records[0], records[2]):
            assert record.metadata["outcome"]["status"] == "completed"
            assert (record["flag.stroke_exceeded"] == beyond).all()


def test_readings_of_slower_encoders_are_noisy_and_held() -> None:
    """Expected: noise changes every 10 ms of the encoders, quantised after it; signals without either are exact."""
    noise, step = {"leg_length": 2e-4, "orientation": 1e-3}, {"leg_length": 1e-4, "velocity": 1e-3}
    record = run_of(
        lambda _sample: np.full(6, 45.0),
        loop={"duration": 0.5},
        sensors={"noise": noise, "quantisation": step, "sample_time": 0.01, "seed": 6},
    )
    at = np.arange(0, 500, 5)
    ticks = at // 10 * 10
    for name in ("position", "angular_velocity", "leg_velocity"):
        assert record[f"measured.{name}"][at] == pytest.approx(record[name][ticks], abs=0)
    exact = np.rint(record["velocity"][ticks] / 1e-3) * 1e-3
    assert record["measured.velocity"][at] == pytest.approx(exact, abs=1e-15)
    off = {name: (record[f"measured.{name}"][at] - record[name][ticks])[::2] for name in noise}
    for name, sigma in noise.items():
        # 300 and 150 numbers: the standard error of a deviation is σ/√(2 n); beyond 4.5 in one of 10⁵ seeds
        found, n = off[name].std(), off[name].size
        expected = np.sqrt(sigma**2 + (step.get(name, 0.0) ** 2) / 12)
        assert abs(found - expected) < 4.5 * expected / np.sqrt(2 * n)
        assert record[f"measured.{name}"][at][1::2] == pytest.approx(record[f"measured.{name}"][at][::2], abs=0)
    lengths = record["measured.leg_length"][at] / 1e-4
    assert np.abs(lengths - np.round(lengths)).max() < 1e-6
    assert len(np.unique(off["orientation"])) == off["orientation"].size


@pytest.mark.parametrize(
    ("clocks", "match"),
    [
        ((0.004, 0.02, 0.01), "does not divide duration"),
        ((1.0, float("nan"), 0.01), "sample_time is nan"),
        ((1.0, 0.01, 0.0), "plant_step is 0.0"),
        ((1.0, float("inf"), 0.01), "sample_time is inf"),
        ((-1.0, -1.0, -1.0), "duration is -1.0; expected a time > 0 s"),  # the first of several, in this order
        ((1.005, 0.025, 0.01), "plant_step 0.01 s does not divide sample_time 0.025 s"),
        ((1e9, 0.01, 0.01), r"duration 1e\+09 s has 1e\+11 plant steps of 0.01 s; expected at most 1000000"),
    ],
)
def test_clocks_that_do_not_fit_are_refused(clocks: tuple[float, float, float], match: str) -> None:
    with pytest.raises(gs.GoughStewartError, match=match):
        Timing(*clocks)


def test_clocks_fit_within_rounding_and_up_to_the_most_steps() -> None:
    """Expected: 0.1/0.001 and the like, which are no whole numbers to the last bit; a million steps."""
    assert Timing(0.3, 0.1, 0.001).steps_a_sample == 100
    assert Timing(1 + 5e-10, 0.01, 0.001).steps == 1000
    assert Timing(float(MOST_STEPS), 1.0, 1.0).steps == 1_000_000
    with pytest.raises(gs.GoughStewartError, match="expected at most 1000000"):
        Timing(MOST_STEPS + 1.0, 1.0, 1.0)


def test_the_last_sample_comes_before_the_end() -> None:
    """Expected: in a run that ends a step after its last sample, that one is never late."""
    rows = [Timing(0.041, 0.01, 0.001, jitter=0.009, seed=seed).rows_of_samples for seed in range(20)]
    assert {int(each[-1]) for each in rows} == {40}
    assert len({int(each[-2]) for each in rows}) > 4


@pytest.mark.parametrize("jitter", [np.nextafter(0.01, 0), float("nan")])
def test_a_jitter_to_the_next_sample_within_rounding_or_none_at_all_is_refused(jitter: float) -> None:
    with pytest.raises(gs.GoughStewartError, match="expected less than the sample_time"):
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
