"""Faults in the data of logs: found by place and number, mended to within the intervals, told, or refused.

Logs come from a Lagrangian; where each fault is, how large and how long, is chosen by the test, on both sides of the
limits that docs/identify.md states. Intervals of 95 % are those of the same log without the fault.
"""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import chi2

from gough_stewart import Estimate, GoughStewartError, Log, identify, leg_geometry, run
from gough_stewart.harness.errors import LogError
from gough_stewart.harness.identify import faults
from gough_stewart.harness.identify.blas import _controls, one_blas_thread
from gough_stewart.harness.identify.estimate import on_one_axis
from gough_stewart.harness.identify.faults import hold_of, without_held_rows
from gough_stewart.harness.identify.log import log_of, rows_apart
from gough_stewart.harness.identify.names import value_of
from gough_stewart.harness.identify.report import estimate_verdict
from gough_stewart.harness.identify.screen import check_units, screened
from tests.support.arrays import FloatArray
from tests.support.machine_logs import (
    HEAVE,
    MACHINE,
    NAMES,
    NOMINAL,
    Course,
    Sensing,
    Swing,
    clipped,
    exchanged,
    force_of,
    frozen,
    held,
    machine_log,
    part_of,
    random_machine,
    with_spikes,
    without_rows,
)

QUIET = Sensing(force_noise=0.0, length_noise=0.0, encoder=0.0)
ROWS = 2000
TIME = np.asarray(np.arange(ROWS) * 1e-3 + 7.3, dtype=float)
LATE = replace(machine_log(course=Course(duration=2.0), seed=4), time=TIME, where="late.csv")


@cache
def perfect() -> Estimate:
    return identify(machine_log(), NOMINAL, NAMES)


FAULTS: dict[str, tuple[Callable[[Log], Log], str]] = {
    "one spike of 20 mm": (
        lambda log: with_spikes(log, "leg_length", 0.02, 1),
        r": 1 spike in the leg length of leg \d, at \d\.\d+ s; interpolated",
    ),
    "two spikes of 20 mm": (
        lambda log: with_spikes(log, "leg_length", 0.02, 2),
        r"2 spikes in the leg length of leg 2, at 6\.232 s, 8\.154 s; interpolated",
    ),
    "fifty spikes of 30 µm": (
        lambda log: with_spikes(log, "leg_length", 30e-6, 50, seed=4),
        "50 spikes in the leg length of legs 1, 2, 3, 4, 5, 6, at .* and 46 more times",
    ),
    "20 spikes of 5 kN": (lambda log: with_spikes(log, "actuator_force", 5e3, 20), "20 spikes in the force of legs"),
    "clipped at 90 %": (clipped, r"clipped readings of the force of legs 1, 5, at 0\.648 to .*use a larger range"),
    "one row lost": (lambda log: without_rows(log, 4000), "1 missing row, at 4 s"),
    "30 rows lost": (
        lambda log: without_rows(log, 4000, 30),
        r"30 missing rows, at 4 s to 4\.029 s; up to 5 in a row",
    ),
    "one row lost, times renumbered": (
        lambda log: without_rows(log, 4000, renumbered=True),
        r"rows were lost .* at 4 s \(\+1\); the log is divided there",
    ),
    "one length frozen for 0.1 s": (
        lambda log: frozen(log, "leg_length", 4000, 100, slice(2, 3)),
        r"99 frozen readings of the leg length of leg 3, at 4\.001 to 4\.099 s; left out; check the encoder",
    ),
    "all readings frozen for 20 ms": (
        lambda log: frozen(frozen(log, "leg_length", 4000, 20), "actuator_force", 4000, 20),
        "19 frozen readings of the leg length of every leg",
    ),
    "one force frozen for 0.1 s": (
        lambda log: frozen(log, "actuator_force", 4000, 100, slice(4, 5)),
        "99 frozen readings of the force of leg 5",
    ),
    "one length frozen to the end": (
        lambda log: frozen(log, "leg_length", 9000, 1000, slice(1, 2)),
        "999 frozen readings of the leg length of leg 2, at 9",
    ),
    "sensors at 2 ms": (held, "leg lengths change at every 2. row only, so sensors are read every 2 ms"),
    "forces at 5 ms": (lambda log: held(log, 5, ("actuator_force",)), "forces change at every 5. row only"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_with_its_place_and_number_and_mended_to_within_the_intervals(fault: str) -> None:
    """Expected: place and number as chosen; values as without the fault, to a standard error where it is interpolated.

    Where rows are left out the noise is another, of which 3.5 standard errors are one in 2000.
    """
    change, message = FAULTS[fault]
    found, clean = identify(change(machine_log()), NOMINAL, NAMES), perfect()
    assert any(re.search(message, note) for note in found.notes), found.notes
    assert not [alarm for alarm in found.alarms if "interpolated" in alarm]
    many = 1.0 if "interpolated; check" in " ".join(found.notes) else 3.5
    assert (np.abs(found.values - clean.values) < many * found.standard_errors).all()
    # readings that are left out cost information, others hardly any
    assert (found.standard_errors < 2.5 * clean.standard_errors).all()


@pytest.mark.parametrize(
    "log",
    [
        machine_log(),
        machine_log(sensing=Sensing(force_noise=1e-3)),
        machine_log(sensing=QUIET),
        machine_log(sensing=replace(QUIET, encoder=1e-4)),
        machine_log(course=Course(HEAVE)),
        machine_log(random_machine(3, equal_friction=False)[0], Course(Swing(seed=11), duration=8.0)),
    ],
    ids=["perfect", "hardly any noise", "no noise", "an encoder of 0.1 mm", "heave", "another machine"],
)
def test_a_log_without_faults_has_none(log: Log) -> None:
    """Expected: nothing to mend, although encoders repeat readings at rest and friction steps as legs reverse."""
    found = screened([log], NOMINAL)
    assert not found.notes
    assert not found.alarms
    [part] = found.parts
    np.testing.assert_array_equal(part.length, log.leg_length)


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("heave_step", {"loop.duration": 1.0}),
        ("heave_tolerances", {}),
        ("saturation", {"loop.duration": 1.5}),
        ("impulse", {}),
    ],
)
def test_the_project_s_own_records_have_no_faults(name: str, settings: dict[str, object]) -> None:
    """Expected: none, with steps, saturation, an impulse, a payload that drops, rest, and coarse encoders."""
    log = log_of(run(name, settings))
    length, force, none = log.leg_length, force_of(log), np.zeros(log.leg_length.shape, dtype=bool)
    assert log.holds_force
    assert not faults.frozen(length, True, none).any()
    assert not faults.frozen(force, False, none).any()
    assert not faults.spikes(length, none, 2e-6 * length.max())[0].any()
    assert not faults.spikes(force, none, 5e-3 * float(np.sqrt((force**2).mean())))[0].any()
    assert not faults.lost_rows(length, none)
    assert {hold_of(column)[0] for column in length.T} == {1}


@pytest.mark.parametrize(("spikes", "alarms", "refused"), [(9, False, False), (12, True, False), (44, True, True)])
def test_interpolated_rows_are_noted_then_alarm_then_refuse(spikes: int, alarms: bool, refused: bool) -> None:
    """Expected: docs/identify.md, more than 0.5 % of 2000 rows is an alarm, more than 2 % is refused."""
    log = with_spikes(LATE, "leg_length", 0.02, spikes, seed=2)
    if refused:
        with pytest.raises(
            GoughStewartError, match=rf"late.csv: too many faults .* 2\.\d % of the rows .* {spikes} spikes"
        ):
            screened([log], NOMINAL)
        return
    found = screened([log], NOMINAL)
    assert len(found.notes) == 1
    assert f"late.csv: {spikes} spikes in the leg length of legs" in found.notes[0]
    assert bool(found.alarms) == alarms
    if alarms:
        share = 100 * spikes / ROWS
        assert found.alarms[0].startswith(f"late.csv: {share:.2g} % of the rows were interpolated and 0 % left out")


@pytest.mark.parametrize(
    ("missing", "alarms", "refused"), [(160, False, False), (420, True, False), (1050, True, True)]
)
def test_rows_left_out_are_noted_then_alarm_then_refuse(missing: int, alarms: bool, refused: bool) -> None:
    """Expected: more than 15 % left out is an alarm, more than half is refused; a third of a log is frozen in full."""
    length, force = LATE.leg_length.copy(), force_of(LATE).copy()
    length[800 : 800 + missing, :], force[800 : 800 + missing, :] = length[800], force[800]
    log = replace(LATE, leg_length=length, actuator_force=force)
    if refused:
        with pytest.raises(
            LogError, match=r"too many faults .* 0 % of the rows were to be interpolated and 5\d % left"
        ):
            screened([log], NOMINAL)
        return
    found = screened([log], NOMINAL)
    assert f"{missing - 1} frozen readings of the leg length of every leg, at 8.101 to" in found.notes[0]
    assert bool(found.alarms) == alarms
    assert [len(part.time) for part in found.parts] == [801, ROWS - 800 - missing]
    assert [part.time[0] for part in found.parts] == pytest.approx([7.3, 8.1 + 1e-3 * missing])


def test_one_spike_is_told_in_the_singular_and_many_with_their_first_times() -> None:
    """Expected: leg 5 at row 1200, 8.5 s; four spikes apart: three times and how many more."""
    length = LATE.leg_length.copy()
    length[1200, 4] += 1e-3
    one = screened([replace(LATE, leg_length=length)], NOMINAL).notes
    assert one == [
        "late.csv: 1 spike in the leg length of leg 5, at 8.5 s; interpolated; check the encoder and its cable"
    ]
    force = force_of(LATE).copy()
    force[[300, 600, 900, 1200], [1, 1, 5, 5]] += 4e3
    found = screened([replace(LATE, actuator_force=force)], NOMINAL)
    assert found.notes == [
        "late.csv: 4 spikes in the force of legs 2, 6, at 7.6 s, 7.9 s, 8.2 s and 1 more times; interpolated; check "
        "the force sensor and its cable"
    ]
    mended = found.parts[0].force
    # noise of 1 % of about 4 kN
    assert np.abs(mended - force_of(LATE)).max() < 6 * 0.01 * 5e3
    assert (mended != force).sum() == 4


@pytest.mark.parametrize(("size", "found"), [(6.0, 0), (14.0, 1)])
def test_spikes_begin_at_eight_standard_deviations(size: float, found: int) -> None:
    """Expected: of leg 4, whose noise is 2 µm; the other legs have ten times as much or more."""
    rng = np.random.default_rng(8)
    noise = 2e-6 * np.array([10, 20, 30, 1, 50, 60]) * rng.standard_normal((3000, 6))
    values = np.sin(np.arange(3000) * 2e-3)[:, None] * 0.1 + noise
    # clear of the reading's own noise
    values[1500, 3] += size * 2e-6 - noise[1500, 3]
    at, mended = faults.spikes(values, np.zeros(values.shape, dtype=bool), 1e-7)
    assert np.argwhere(at).tolist() == [[1500, 3]] * found
    # what is smaller than the least error that counts, or known already, is none
    assert not faults.spikes(values, np.zeros(values.shape, dtype=bool), 1e-3)[0].any()
    assert not faults.spikes(values, np.ones(values.shape, dtype=bool), 1e-7)[0].any()
    assert (mended != values).sum() == found


@pytest.mark.parametrize(("rows", "found"), [(4, True), (7, True), (9, False)])
def test_spikes_of_up_to_seven_rows_are_mended_and_nine_rows_are_none(rows: int, found: bool) -> None:
    """Expected: all of its rows and no others, mended to the true length within five deviations; one in 20,000 misses.

    Least squares alone would follow seven rows among the sixteen around them.
    """
    rng = np.random.default_rng(6)
    true = 2.5 + 0.1 * np.sin(4.4 * 4e-3 * np.arange(400)[:, None] + np.arange(6))
    values = true + 1e-5 * rng.standard_normal((400, 6))
    values[200 : 200 + rows, 3] -= 4e-4
    at, mended = faults.spikes(values, np.zeros(values.shape, dtype=bool), 0.0)
    assert np.argwhere(at).tolist() == [[200 + k, 3] for k in range(rows)] * found
    if found:
        assert np.abs(mended - true)[200 : 200 + rows, 3].max() < 5e-5


def test_a_step_is_no_spike() -> None:
    """Expected: of 20 steps and 5 pulses, the pulses; a pulse is a spike, a leg that reverses is none."""
    rng = np.random.default_rng(2)
    force = 4.0 * rng.standard_normal((4000, 6))
    for k in range(20):
        force[150 * (k + 1) :, k % 6] += 260.0 * (-1) ** k
    pulses = 3100 + 100 * np.arange(5)
    force[pulses, 2] += 400.0
    at, _ = faults.spikes(force, np.zeros(force.shape, dtype=bool), 1.0)
    assert np.argwhere(at).tolist() == [[k, 2] for k in pulses]


def test_noise_is_measured_leg_by_leg_between_both_sides() -> None:
    """Expected: the standard deviations that made it, 5 % either way, five standard errors of a median of 6000 rows.

    A quantised signal without noise has the deviation of its step, over the root of twelve.
    """
    rng = np.random.default_rng(9)
    sizes = np.array([1.0, 3.0, 0.5, 2.0, 7.0, 4.0])
    smooth = 50 * np.sin(np.arange(6000)[:, None] * np.array([1, 2, 3, 1, 2, 3]) * 1e-3)
    assert_allclose(faults.noise_of(smooth + sizes * rng.standard_normal((6000, 6))), sizes, rtol=0.05)
    steps = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    coarse = steps * np.rint(smooth / steps)
    assert_allclose(faults.step_of(coarse), steps, rtol=1e-9)
    slow = steps * np.rint(1e-3 * smooth / steps + 1e-3 * np.arange(6000)[:, None])
    assert_allclose(faults.noise_of(slow), steps / np.sqrt(12), rtol=1e-9)
    assert faults.step_of(np.ones((9, 6))).tolist() == [0.0] * 6


def test_clipped_readings_are_those_at_an_end_that_is_not_the_actuators() -> None:
    """Expected: leg 6 at the most, leg 1 at the least; none at the actuators' own limit, none of a leg that is free."""
    t = np.arange(4000) * 1e-3
    force = np.stack([(100 + k) * np.sin(2 * np.pi * (0.5 + 0.1 * k) * t) for k in range(6)], axis=1)
    force += 0.2 * np.random.default_rng(1).standard_normal(force.shape)
    force[:, 5], force[:, 0] = np.minimum(force[:, 5], 80.0), np.maximum(force[:, 0], -70.0)
    at = faults.clipped(force, np.full(6, np.inf))
    assert at.any(axis=0).tolist() == [True, False, False, False, False, True]
    assert at[force[:, 5] == 80.0, 5].all()
    assert at[force[:, 0] == -70.0, 0].all()
    assert not at[force[:, 5] < 75.0, 5].any()
    assert not at[force[:, 0] > -65.0, 0].any()
    assert faults.clipped(force, np.full(6, 80.0)).any(axis=0).tolist() == [True, False, False, False, False, False]
    assert faults.clipped(force, np.full(6, 90.0)).any(axis=0).tolist() == [True, False, False, False, False, True]


@pytest.mark.parametrize(("rows", "number"), [(1.0, 1), (1.4, 0), (1.6, 0), (2.0, 1), (3.0, 1), (-1.0, 1)])
def test_rows_are_lost_where_all_legs_jump_by_their_velocity_times_whole_rows(rows: float, number: int) -> None:
    """Expected: the row and the number; −1 is a row that was logged twice. Not of parts of a row, or near bad readings.

    A jump of one leg alone is another fault.
    """
    t = np.asarray(np.arange(1000) * 1e-3, dtype=float)

    def legs(time: FloatArray) -> FloatArray:
        return np.stack([2 + 0.1 * np.sin((6 + 1.3 * k) * time + k) for k in range(6)], axis=1)

    none = np.zeros((1000, 6), dtype=bool)
    lost = legs(np.asarray(np.where(np.arange(1000) < 500, t, t + rows * 1e-3), dtype=float))
    found = faults.lost_rows(lost, none)
    assert len(found) == number
    if found:
        assert (found[0].row, found[0].legs) == (500, tuple(range(6)))
        assert found[0].number == pytest.approx(rows, abs=0.1)
    bad = none.copy()
    bad[501, 4] = True
    assert not faults.lost_rows(lost, bad)
    alone = legs(t)
    alone[500:, 2] += 1e-3
    assert not faults.lost_rows(alone, none)
    assert not faults.lost_rows(lost[:30], none[:30])


def test_a_row_that_one_length_alone_lost_is_an_alarm_and_jitter_is_no_lost_row() -> None:
    """Expected: leg 3 at row 4000, by one row; times that jitter by 0.3 ms shake all rows, and lose none."""
    log = machine_log()
    length = log.leg_length.copy()
    length[4000:-1, 2] = log.leg_length[4001:, 2]
    found = screened([replace(log, leg_length=length)], NOMINAL)
    [alarm] = found.alarms
    assert "rows of the length of leg 3 alone were lost (+) or repeated (−) at 4 s (+1)" in alarm
    assert len(found.parts) == 1
    late = 0.3e-3 * np.random.default_rng(1).standard_normal((len(log), 1))
    shaken = log.leg_length + late * np.gradient(log.leg_length, 1e-3, axis=0)
    shaken_log = screened([replace(log, leg_length=shaken)], NOMINAL)
    assert not any("lost" in text for text in (*shaken_log.notes, *shaken_log.alarms))


def test_a_leg_that_rests_while_others_move_is_frozen_only_up_to_the_end() -> None:
    """Expected: of smooth motions one that pauses for a while and goes on from there has not jumped."""
    t = np.arange(1200) * 1e-3
    length = np.stack([2 + 0.1 * np.sin((3 + k) * t + k) for k in range(6)], axis=1)
    none = np.zeros(length.shape, dtype=bool)
    pausing = length.copy()
    pausing[500:600, 3] = pausing[500, 3]
    pausing[600:, 3] = length[500:1100, 3]
    assert not faults.frozen(pausing, True, none).any()
    resting = length.copy()
    resting[900:, 3] = resting[900, 3]
    assert np.argwhere(faults.frozen(resting, True, none)).tolist() == [[k, 3] for k in range(901, 1200)]
    assert not faults.frozen(resting, False, none).any()


def test_readings_are_held_only_if_all_change_in_one_rhythm() -> None:
    """Expected: 4 rows from row 3 on; 1 for a coarse encoder, which changes at any row."""
    time = np.arange(2000) * 1e-3
    smooth = np.sin(2 * np.pi * time) + 1e-3 * np.random.default_rng(1).standard_normal(len(time))
    assert hold_of(smooth[np.maximum(0, (np.arange(2000) - 3) // 4 * 4 + 3)]) == (4, 3)
    assert hold_of(0.05 * np.rint(smooth / 0.05)) == (1, 0)
    assert hold_of(smooth) == (1, 0)


def test_held_readings_are_brought_to_their_own_rows() -> None:
    """Expected: forces of row 2, 5, 8 …; lengths of legs that are read in turn are refused with their rows."""
    values = np.random.default_rng(4).standard_normal((300, 6)).cumsum(axis=0)
    third = values[(np.arange(300) - 2) // 3 * 3 + 2]
    assert {hold_of(column) for column in third[2:].T} == {(3, 0)}
    time = np.asarray(np.arange(300) * 0.002, dtype=float)
    log = part_of(Log(values, time, third, where="slow"))
    found, notes = without_held_rows(replace(log, length=third))
    np.testing.assert_array_equal(found.length, third[2::3])
    assert_allclose(found.time, 0.004 + 0.006 * np.arange(100))
    assert notes == [
        "slow: leg lengths change at every 3. row only, so sensors are read every 6 ms",
        "slow: forces change at every 3. row only, so sensors are read every 6 ms",
    ]
    shifted = third.copy()
    shifted[1:, 5] = third[:-1, 5]
    with pytest.raises(GoughStewartError, match=r"held for 3 rows, but legs change at different rows \(1, 3\)"):
        without_held_rows(replace(log, length=shifted))
    assert without_held_rows(replace(log, force=values))[1] == []


def test_a_faster_signal_is_brought_to_the_rows_of_the_slower_one() -> None:
    """Expected: the smooth forces at the times of the kept rows, 2 ms apart, to the ripple of the filter."""
    log = machine_log(replace(MACHINE, leg_coulomb_friction=0.0), sensing=QUIET)
    found, notes = without_held_rows(part_of(held(log, 2, ("leg_length",))))
    assert len(notes) == 1
    assert log.time is not None
    np.testing.assert_allclose(np.diff(found.time), 2e-3, rtol=1e-9)
    at = np.searchsorted(log.time, found.time - 1e-9)
    np.testing.assert_array_equal(found.length, log.leg_length[at])
    np.testing.assert_allclose(found.force, force_of(log)[at], atol=0.05)


def test_a_record_whose_sensors_are_slower_than_its_loop_is_read_at_its_sensors() -> None:
    """Expected: rows 2 ms apart with the encoders' readings; the forces of a smooth motion at their times.

    Mean forces of the loop's samples until the next reading, half a reading early, would be off by 1 ms.
    """
    settings = {"loop.duration": 3.0, "loop.sample_time": 1e-3, "loop.plant_step": 5e-4, "sensors.sample_time": 2e-3}
    record = run("circle_computed_torque", settings)
    log, notes = without_held_rows(part_of(log_of(record)))
    assert "leg lengths change at every 2. row only" in notes[0]
    assert not log.holds_force
    np.testing.assert_allclose(np.diff(log.time), 2e-3, rtol=1e-9)
    at = np.rint(log.time / 5e-4).astype(int)
    np.testing.assert_allclose(log.length, record["measured.leg_length"][at], rtol=1e-14)
    # the second difference of lengths at every second sample weighs accelerations of four samples 1 : 3 : 3 : 1
    force = np.asarray(record["actuator_force"])
    middle = slice(300, -300)
    between = sum(w * force[at[middle] + 2 * k] for w, k in ((1 / 8, -2), (3 / 8, -1), (3 / 8, 0), (1 / 8, 1)))
    np.testing.assert_allclose(log.force[middle], between, atol=2e-4 * np.ptp(force))


@pytest.mark.evidence
def test_intervals_of_held_readings_cover_the_machine() -> None:
    """Expected: of five logs the sum of (θ̂ − θ)ᵀ C⁻¹ (θ̂ − θ) is χ² of 65 degrees, within quantiles 5e-4, 1 − 5e-4.

    One right program in 1000 fails. Before, 3 of 12 intervals held the truth.
    """
    truth = np.array([value_of(MACHINE, n) for n in perfect().names])
    distance = 0.0
    for seed in range(5):
        found = identify(held(machine_log(seed=seed)), NOMINAL, NAMES)
        error = found.values - truth
        distance += float(error @ np.linalg.solve(found.covariance, error))
    assert chi2.ppf(5e-4, 5 * len(truth)) < distance < chi2.isf(5e-4, 5 * len(truth))


def test_noise_of_one_encoder_is_no_other_machine() -> None:
    """Expected: of 20 µm in leg 3 the rows of a quiet log, no alarm, and values within 4.5 standard errors.

    Before, noise of one leg looked like motion, and the log was refused as that of another platform.
    """
    log = machine_log()
    length = log.leg_length.copy()
    length[:, 2] += 20e-6 * np.random.default_rng(1).standard_normal(len(log))
    found, clean = identify(replace(log, leg_length=length), NOMINAL, NAMES), perfect()
    assert found.notes[0] == clean.notes[0]
    assert found.alarms == ()
    truth = np.array([value_of(MACHINE, name) for name in found.names])
    assert (np.abs(found.values - truth) < 4.5 * found.standard_errors).all()
    # five legs are as well known as before
    assert found.standard_errors[0] < 1.2 * clean.standard_errors[0]


@pytest.mark.parametrize(("factor", "said"), [(1 / 4.4482216, "like lbf: write the unit"), (4.4482216, "read as lbf")])
def test_forces_in_pounds_are_an_alarm_that_names_them(factor: float, said: str) -> None:
    """Expected: of 4.448 N each, from a nominal platform whose payload is not known; not of forces in N."""
    log = machine_log(course=Course(duration=6.0))
    found = identify(replace(log, actuator_force=factor * force_of(log)), NOMINAL, NAMES)
    assert said in found.alarms[0]
    assert estimate_verdict(found).text.count("lbf") >= 1
    assert not any("lbf" in alarm for alarm in perfect().alarms)


def test_linear_algebra_has_one_thread_while_it_identifies_and_its_threads_afterwards() -> None:
    """Expected: of each OpenBLAS that NumPy and SciPy have, two, then one, then two."""
    controls = _controls()
    assert controls
    before = [get_number() for get_number, _ in controls]
    try:
        for _, set_number in controls:
            set_number(2)
        with one_blas_thread():
            assert {get_number() for get_number, _ in controls} == {1}
        assert {get_number() for get_number, _ in controls} == {2}
    finally:
        for (_, set_number), number in zip(controls, before, strict=True):
            set_number(number)


def test_exchanged_columns_of_forces_are_named() -> None:
    """Expected: the two legs whose columns were exchanged; before, a platform with a mass off by 1 % came of it."""
    with pytest.raises(GoughStewartError, match="the forces of legs 3 and 6 look exchanged"):
        identify(exchanged(machine_log(), 2, 5), NOMINAL, NAMES)


def test_times_of_32_bits_are_refused_by_that_name() -> None:
    """Expected: at 10,000 s such numbers are 1/1024 s apart, which is no time for rows of 1 ms; at 1 s they are."""
    log = machine_log()
    assert log.time is not None
    coarse = (np.asarray(log.time) + 1e4).astype(np.float32).astype(float)
    with pytest.raises(GoughStewartError, match=r"times are numbers of 32 bits, 0\.00098 s apart at 100"):
        screened([replace(log, time=coarse)], NOMINAL)
    fine = np.asarray(log.time).astype(np.float32).astype(float)
    assert len(screened([replace(log, time=fine)], NOMINAL).parts) == 1


def test_a_gap_of_any_length_takes_no_memory() -> None:
    """Expected: the parts before and after a gap of eleven days, each with its own rows."""
    log = machine_log()
    assert log.time is not None
    late = replace(log, time=np.where(np.arange(len(log)) >= 5000, log.time + 1e6, log.time))
    found = screened([late], NOMINAL)
    assert [len(part.time) for part in found.parts] == [5000, 5000]
    assert "1000000000 missing rows, at 5 s to" in found.notes[0]


def test_units_are_judged_between_a_third_and_three_times() -> None:
    """Expected: docs: a leg's lengths, here the third's, within a factor of 3 of home; forces within 50."""
    home = np.asarray(leg_geometry(MACHINE, MACHINE.home_position, MACHINE.home_orientation).length)
    free, jitter = replace(MACHINE, actuator_force_max=None), 1 + 1e-3 * np.sin(np.arange(50.0))[:, None]
    right = Log(home * jitter, None, force_of(LATE)[1000] * jitter)

    def check(length: float = 1.0, force: float = 1.0, limit: float | None = None) -> None:
        lengths = right.leg_length * np.where(np.arange(6) == 2, length, 1.0)
        machine = free if limit is None else replace(free, actuator_force_max=limit * np.abs(force_of(right)).max())
        check_units(replace(right, leg_length=lengths, actuator_force=force * force_of(right)), machine)

    for factor, ratio, limit in ((0.35, 1 / 40, None), (2.9, 30.0, None), (1.0, -1.0, 1 / 2.9)):
        check(factor, ratio, limit)
    for factor in (0.32, 3.1):
        with pytest.raises(GoughStewartError, match="leg 3 has a median length of"):
            check(factor)
    for ratio in (1 / 100, 70.0):
        with pytest.raises(GoughStewartError, match="expected similar forces"):
            check(force=ratio)
    with pytest.raises(GoughStewartError, match="exceeds actuator_force_max"):
        check(force=-1.0, limit=1 / 3.1)


def test_gaps_are_counted_in_rows_and_their_sample_time_is_the_whole_log_s() -> None:
    _, number, h = rows_apart(without_rows(LATE, 700, 3))
    assert number[699] == 4
    assert (np.delete(number, 699) == 1).all()
    assert h == pytest.approx(1e-3, rel=1e-9)


@pytest.mark.parametrize("duration", [0.1, 0.3])
def test_a_log_too_short_to_tell_is_told_to_be_too_short(duration: float) -> None:
    """Expected: no blame of joints, legs and signs, which are right; how long is left, and what to do.

    Before, "the log contradicts this platform".
    """
    log = machine_log(course=Course(duration=6.0)).rows(slice(2500, 2500 + round(1000 * duration)))
    with pytest.raises(
        LogError, match=r"machine: too short: .* 0\.\d+ s are left to fit, .* record some seconds"
    ) as caught:
        identify(log, NOMINAL, "platform_mass")
    assert "contradicts" not in str(caught.value)
    left = float(str(caught.value).split(" s are left")[0].rsplit(" ", 1)[1])
    # up to two lengths of both filters, and a fifth of the log, are not fitted
    assert 0.3 * duration < left < 0.85 * duration


def test_parts_are_fitted_up_to_their_share_and_shown_one_after_the_other() -> None:
    """Expected: three tenths of each log at its end; the second log begins a row after the first ends."""
    [part] = screened([LATE], NOMINAL, 0.3).parts
    end = 7.3 + 0.7 * 1.999
    assert part.is_fitted(np.array([7.3, end - 1e-6, end + 1e-6, 9.299])).tolist() == [True, True, False, False]
    assert screened([LATE], NOMINAL, 0.0).parts[0].is_fitted(TIME).all()
    time = np.asarray(np.arange(5) * 0.1, dtype=float)
    parts = [part_of(LATE, which, until) for which, until in ((0, 0.25), (0, np.inf), (1, 3.15), (2, -np.inf))]
    found, spans = on_one_axis(parts, [time, time + 1, time + 3, np.zeros(0)])
    assert_allclose(found, [0, 0.1, 0.2, 0.3, 0.4, 1, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9])
    assert_allclose(spans, [(0.3, 0.4), (1.7, 1.9)])
    for wrong in (-0.1, 1.0):
        with pytest.raises(GoughStewartError, match="expected a share of the log, 0 or more and less than 1"):
            screened([LATE], NOMINAL, wrong)
