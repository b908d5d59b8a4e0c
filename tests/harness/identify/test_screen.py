"""Faults of logs by a Lagrangian, on both sides of docs/identify.md's limits: found, mended, told or refused."""
# Intervals of 95 % are those of the same log without the fault.

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import chi2

from gough_stewart import GoughStewartError, Log, identify, load_preset, read_log, run
from gough_stewart.harness.identify import screen
from gough_stewart.harness.identify.fit import _controls, one_blas_thread
from tests.harness.identify.machine_logs import (
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
    perfect_estimate,
    random_machine,
    value_of,
    with_spikes,
    without_rows,
)
from tests.support.arrays import FloatArray

QUIET = Sensing(force_noise=0.0, length_noise=0.0, encoder=0.0)
ROWS = 2000
NONE = np.zeros((ROWS, 6), dtype=bool)


# Faults of a log, and what is said of each.
FAULTS: dict[str, tuple[tuple[Callable[[Log], Log], ...], tuple[str, ...]]] = {
    "spikes and a lost row": (
        (
            lambda log: with_spikes(log, "leg_length", 30e-6, 20, seed=4),
            lambda log: with_spikes(log, "actuator_force", 5e3, 15),
            lambda log: without_rows(log, 4000),
        ),
        (
            "20 spikes in the leg length of legs .* and 17 more times; interpolated; check the encoder",
            "15 spikes in the force of legs .*; interpolated",
            "1 missing row, at 4 s; up to 5 in a row",
        ),
    ),
    "clipped, rows lost by their times and without, a length frozen to the end": (
        (
            clipped,
            lambda log: frozen(log, "leg_length", 9000, 1000, slice(1, 2)),
            lambda log: without_rows(log, 6000, renumbered=True),
            lambda log: without_rows(log, 4000, 30),
        ),
        (
            r"clipped readings of the force of legs 1, 5, at 0\.648 to .*use a larger range",
            r"999 frozen readings of the leg length of leg 2, at 9",
            r"rows were lost .* at 6 s \(\+1\); the log is divided there",
            r"30 missing rows, at 4 s to 4\.029 s; up to 5 in a row",
        ),
    ),
    "one length and one force frozen for 0.1 s": (
        (
            lambda log: frozen(log, "leg_length", 4000, 100, slice(2, 3)),
            lambda log: frozen(log, "actuator_force", 6000, 100, slice(4, 5)),
        ),
        (
            r"99 frozen readings of the leg length of leg 3, at 4\.001 to 4\.099 s; left out; check the encoder",
            "99 frozen readings of the force of leg 5, at 6",
        ),
    ),
    "all readings frozen for 20 ms": (
        (lambda log: frozen(frozen(log, "leg_length", 4000, 20), "actuator_force", 4000, 20),),
        ("19 frozen readings of the leg length of every leg",),
    ),
    "lengths at 2 ms": (
        (lambda log: held(log, 2, ("leg_length",)),),
        ("leg lengths change at every 2. row only, so sensors are read every 2 ms",),
    ),
    "forces at 5 ms": ((lambda log: held(log, 5, ("actuator_force",)),), ("forces change at every 5. row only",)),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_with_its_place_and_number_and_mended_to_within_the_intervals(fault: str) -> None:
    """Expected: place and number as chosen; values as without it, to a standard error where it is interpolated."""
    # where rows are left out the noise is another, of which 3.5 standard errors are one in 2000
    changes, messages = FAULTS[fault]
    log = machine_log()
    for change in changes:
        log = change(log)
    estimate, clean = identify(log, NOMINAL, NAMES), perfect_estimate()
    for message in messages:
        assert any(re.search(message, note) for note in estimate.notes), estimate.notes
    assert not [alarm for alarm in estimate.alarms if "interpolated" in alarm]
    many = 1.0 if fault.startswith("spikes") else 3.5
    assert (np.abs(estimate.values - clean.values) < many * estimate.standard_errors).all()
    # readings that are left out cost information, others hardly any
    assert (estimate.standard_errors < 2.5 * clean.standard_errors).all()


@pytest.mark.parametrize(
    "sensing",
    [Sensing(), Sensing(force_noise=1e-3), QUIET, replace(QUIET, encoder=1e-4)],
    ids=["perfect", "hardly any noise", "no noise", "an encoder of 0.1 mm"],
)
def test_a_log_without_faults_has_none(sensing: Sensing) -> None:
    """Expected: nothing to mend, although encoders repeat readings at rest and friction steps as legs reverse."""
    machine = random_machine(3, equal_friction=False)[0] if sensing == Sensing() else MACHINE
    for swing in (Swing(seed=11), HEAVE):
        log = machine_log(machine, Course(swing, duration=6.0), sensing)
        usable = screen.screened([log], NOMINAL)
        assert (usable.notes, usable.alarms) == ([], [])
        np.testing.assert_array_equal(usable.parts[0].length, log.leg_length)


@pytest.mark.parametrize(
    ("name", "settings"),
    [("heave_step", {"loop.duration": 1.0}), ("saturation", {"loop.duration": 1.5}), ("impulse", {})],
)
def test_the_project_s_own_records_have_no_faults(name: str, settings: dict[str, object]) -> None:
    """Expected: none, with steps, saturation, an impulse, a payload that drops, rest, and coarse encoders."""
    record = run(name, settings)
    length = np.asarray(
        record["measured.leg_length" if "measured.leg_length[1]" in record.table.columns else "leg_length"]
    )
    force, none = np.asarray(record["actuator_force"]), np.zeros(length.shape, dtype=bool)
    assert not screen.frozen(length, True, none).any()
    assert not screen.frozen(force, False, none).any()
    assert not screen.spikes(length, none, 2e-6 * length.max())[0].any()
    assert not screen.spikes(force, none, 5e-3 * float(np.sqrt((force**2).mean())))[0].any()
    assert not screen.lost_rows(length, none)
    assert {screen.hold_of(column)[0] for column in length.T} == {1}


@pytest.mark.parametrize(
    ("spikes", "missing", "has_alarm", "refusal"),
    [
        (9, 0, False, ""),
        (12, 0, True, ""),
        (44, 0, True, r"late.csv: too many faults .* 2\.\d % of the rows .* 44 spikes"),
        (0, 160, False, ""),
        (0, 420, True, ""),
        # the rows that follow are fewer than the filter's
        (0, 1050, True, r"too many faults .* 0 % of the rows were to be interpolated and 60 % left"),
    ],
)
def test_mended_and_missing_rows_are_noted_then_alarm_then_refuse(
    spikes: int, missing: int, has_alarm: bool, refusal: str
) -> None:
    """Expected: docs/identify.md, over 0.5 % interpolated or 15 % left out is an alarm; over 2 % or half is refused."""
    time = np.asarray(np.arange(ROWS) * 1e-3 + 7.3, dtype=float)
    log = replace(machine_log(course=Course(duration=2.0), seed=4), time=time, where="late.csv")
    log = with_spikes(log, "leg_length", 0.02, spikes, seed=2)
    if missing:
        length, force = log.leg_length.copy(), force_of(log).copy()
        length[800 : 800 + missing], force[800 : 800 + missing] = length[800], force[800]
        log = replace(log, leg_length=length, actuator_force=force)
    if refusal:
        with pytest.raises(GoughStewartError, match=refusal):
            screen.screened([log], NOMINAL)
        return
    usable = screen.screened([log], NOMINAL)
    assert bool(usable.alarms) == has_alarm
    if spikes:
        [note] = usable.notes
        assert f"late.csv: {spikes} spikes in the leg length of legs" in note
        share = f"late.csv: {100 * spikes / ROWS:.2g} % of the rows were interpolated and 0 % left out"
        assert all(alarm.startswith(share) for alarm in usable.alarms)
    else:
        assert f"{missing - 1} frozen readings of the leg length of every leg, at 8.101 to" in usable.notes[0]
        assert [len(part.time) for part in usable.parts] == [801, ROWS - 800 - missing]
        assert [part.time[0] for part in usable.parts] == pytest.approx([7.3, 8.1 + 1e-3 * missing])


def test_spikes_are_eight_standard_deviations_of_up_to_seven_rows_and_no_steps() -> None:
    """Expected: of leg 4, whose noise is 2 µm; of others ten times as much; of 20 steps and 5 pulses, the pulses."""
    # of long ones all rows and no others, mended to the true length within five deviations; one in 20,000 misses
    rng = np.random.default_rng(8)
    noise = 2e-6 * np.array([10, 20, 30, 1, 50, 60]) * rng.standard_normal((ROWS, 6))
    for size, number in ((6.0, 0), (14.0, 1)):
        values = np.sin(np.arange(ROWS) * 2e-3)[:, None] * 0.1 + noise
        # clear of the reading's own noise
        values[1500, 3] += size * 2e-6 - noise[1500, 3]
        at, mended = screen.spikes(values, NONE, 1e-7)
        assert np.argwhere(at).tolist() == [[1500, 3]] * number
        # what is smaller than the least error that counts, or known already, is none
        assert not screen.spikes(values, NONE, 1e-3)[0].any()
        assert not screen.spikes(values, ~NONE, 1e-7)[0].any()
        assert (mended != values).sum() == number
    for rows, is_spike in ((4, True), (7, True), (9, False)):
        true = 2.5 + 0.1 * np.sin(4.4 * 4e-3 * np.arange(400)[:, None] + np.arange(6))
        values = true + 1e-5 * rng.standard_normal((400, 6))
        values[200 : 200 + rows, 3] -= 4e-4
        at, mended = screen.spikes(values, NONE[:400], 0.0)
        assert np.argwhere(at).tolist() == [[200 + k, 3] for k in range(rows)] * is_spike
        assert not is_spike or np.abs(mended - true)[200 : 200 + rows, 3].max() < 5e-5
    force = 4.0 * rng.standard_normal((4000, 6))
    for k in range(20):
        force[150 * (k + 1) :, k % 6] += 260.0 * (-1) ** k
    pulses = 3100 + 100 * np.arange(5)
    force[pulses, 2] += 400.0
    at, _ = screen.spikes(force, np.zeros(force.shape, dtype=bool), 1.0)
    assert np.argwhere(at).tolist() == [[k, 2] for k in pulses]


def test_clipped_readings_are_those_at_an_end_that_is_not_the_actuators() -> None:
    """Expected: leg 6 at the most, leg 1 at the least; none at the actuators' own limit, none of a leg that is free."""
    t = np.arange(4000) * 1e-3
    force = np.stack([(100 + k) * np.sin(2 * np.pi * (0.5 + 0.1 * k) * t) for k in range(6)], axis=1)
    force += 0.2 * np.random.default_rng(1).standard_normal(force.shape)
    force[:, 5], force[:, 0] = np.minimum(force[:, 5], 80.0), np.maximum(force[:, 0], -70.0)
    at = screen.clipped(force, np.full(6, np.inf))
    assert at.any(axis=0).tolist() == [True, False, False, False, False, True]
    assert at[force[:, 5] == 80.0, 5].all()
    assert at[force[:, 0] == -70.0, 0].all()
    assert not at[force[:, 5] < 75.0, 5].any()
    assert not at[force[:, 0] > -65.0, 0].any()
    assert screen.clipped(force, np.full(6, 80.0)).any(axis=0).tolist() == [True, *[False] * 5]
    assert screen.clipped(force, np.full(6, 90.0)).any(axis=0).tolist() == [True, *[False] * 4, True]


@pytest.mark.parametrize(("rows", "number"), [(1.0, 1), (1.4, 0), (1.6, 0), (3.0, 1), (-1.0, 1)])
def test_rows_are_lost_where_all_legs_jump_by_their_velocity_times_whole_rows(rows: float, number: int) -> None:
    """Expected: row and number, −1 if logged twice; not of parts of a row, of a leg alone, or near bad readings."""
    t = np.asarray(np.arange(1000) * 1e-3, dtype=float)

    def legs(time: FloatArray) -> FloatArray:
        return np.stack([2 + 0.1 * np.sin((6 + 1.3 * k) * time + k) for k in range(6)], axis=1)

    none = NONE[:1000]
    jumping = legs(np.asarray(np.where(np.arange(1000) < 500, t, t + rows * 1e-3), dtype=float))
    places = screen.lost_rows(jumping, none)
    assert len(places) == number
    if places:
        assert (places[0].row, places[0].legs) == (500, tuple(range(6)))
        assert places[0].number == pytest.approx(rows, abs=0.1)
    bad = none.copy()
    bad[501, 4] = True
    assert not screen.lost_rows(jumping, bad)
    alone = legs(t)
    alone[500:, 2] += 1e-3
    assert not screen.lost_rows(alone, none)
    assert not screen.lost_rows(jumping[:30], none[:30])


def test_a_row_that_one_length_alone_lost_is_an_alarm_and_jitter_is_no_lost_row() -> None:
    """Expected: leg 3 at row 4000, by one row; times that jitter by 0.3 ms shake all rows, and lose none."""
    log = machine_log()
    length = log.leg_length.copy()
    length[4000:-1, 2] = log.leg_length[4001:, 2]
    [alarm] = screen.screened([replace(log, leg_length=length)], NOMINAL).alarms
    assert "rows of the length of leg 3 alone were lost (+) or repeated (−) at 4 s (+1)" in alarm
    jitter = 0.3e-3 * np.random.default_rng(1).standard_normal((len(log), 1))
    shaken = log.leg_length + jitter * np.gradient(log.leg_length, 1e-3, axis=0)
    usable = screen.screened([replace(log, leg_length=shaken)], NOMINAL)
    assert not any("lost" in text for text in (*usable.notes, *usable.alarms))


def test_a_leg_that_rests_while_others_move_is_frozen_only_up_to_the_end() -> None:
    """Expected: of smooth motions one that pauses for a while and goes on from there has not jumped."""
    t = np.arange(1200) * 1e-3
    length = np.stack([2 + 0.1 * np.sin((3 + k) * t + k) for k in range(6)], axis=1)
    none = NONE[:1200]
    pausing = length.copy()
    pausing[500:600, 3] = pausing[500, 3]
    pausing[600:, 3] = length[500:1100, 3]
    assert not screen.frozen(pausing, True, none).any()
    resting = length.copy()
    resting[900:, 3] = resting[900, 3]
    assert np.argwhere(screen.frozen(resting, True, none)).tolist() == [[k, 3] for k in range(901, 1200)]
    assert not screen.frozen(resting, False, none).any()


def test_held_readings_are_those_of_one_rhythm_brought_to_their_own_rows() -> None:
    """Expected: 4 rows from row 3 on, 1 for a coarse encoder; of a log rows 2, 5, 8 …; legs in turn are refused."""
    time = np.asarray(np.arange(ROWS) * 1e-3, dtype=float)
    smooth = np.sin(2 * np.pi * time) + 1e-3 * np.random.default_rng(1).standard_normal(len(time))
    assert screen.hold_of(smooth[np.maximum(0, (np.arange(ROWS) - 3) // 4 * 4 + 3)]) == (4, 3)
    assert screen.hold_of(0.05 * np.rint(smooth / 0.05)) == (1, 0)
    log = machine_log(course=Course(duration=4.0))
    at = np.maximum((np.arange(4000) - 2) // 3 * 3 + 2, 0)
    third = replace(log, leg_length=log.leg_length[at], actuator_force=force_of(log)[at])
    usable = screen.screened([third], NOMINAL)
    [part] = usable.parts
    np.testing.assert_array_equal(part.length, log.leg_length[2::3])
    np.testing.assert_array_equal(part.force, force_of(log)[2::3])
    assert_allclose(part.time, 0.002 + 0.003 * np.arange(len(part.time)))
    assert usable.notes == [
        "machine: leg lengths change at every 3. row only, so sensors are read every 3 ms",
        "machine: forces change at every 3. row only, so sensors are read every 3 ms",
    ]
    shifted = third.leg_length.copy()
    shifted[1:, 5] = third.leg_length[:-1, 5]
    with pytest.raises(GoughStewartError, match=r"held for 3 rows, but legs change at different rows \(1, 3\)"):
        identify(replace(third, leg_length=shifted), NOMINAL, "platform_mass")


def test_a_record_whose_sensors_are_slower_than_its_loop_is_read_at_its_sensors(tmp_path: Path) -> None:
    """Expected: rows 2 ms apart with the encoders' readings; the forces of a smooth motion at their times."""
    # mean forces of the loop's samples until the next reading, half a reading early, would be off by 1 ms
    settings = {"loop.duration": 3.0, "loop.sample_time": 1e-3, "loop.plant_step": 5e-4, "sensors.sample_time": 2e-3}
    record = run("circle_computed_torque", settings)
    record.write_parquet(tmp_path / "record.parquet")
    usable = screen.screened([read_log(tmp_path)], load_preset("liu2000"))
    [part] = usable.parts
    assert "leg lengths change at every 2. row only" in usable.notes[0]
    assert not part.holds_force
    np.testing.assert_allclose(np.diff(part.time), 2e-3, rtol=1e-9)
    at = np.rint(part.time / 5e-4).astype(int)
    np.testing.assert_allclose(part.length, record["measured.leg_length"][at], rtol=1e-14)
    # the second difference of lengths at every second sample weighs accelerations of four samples 1 : 3 : 3 : 1
    force = np.asarray(record["actuator_force"])
    middle = slice(300, -300)
    between = sum(w * force[at[middle] + 2 * k] for w, k in ((1 / 8, -2), (3 / 8, -1), (3 / 8, 0), (1 / 8, 1)))
    np.testing.assert_allclose(part.force[middle], between, atol=2e-4 * np.ptp(force))


def test_noise_of_one_encoder_is_no_other_machine() -> None:
    """Expected: of 20 µm in leg 3 the rows of a quiet log, no alarm, and values within 4.5 standard errors."""
    log = machine_log()
    length = log.leg_length.copy()
    length[:, 2] += 20e-6 * np.random.default_rng(1).standard_normal(len(log))
    estimate, clean = identify(replace(log, leg_length=length), NOMINAL, NAMES), perfect_estimate()
    assert estimate.notes[0] == clean.notes[0]
    assert estimate.alarms == ()
    truth = np.array([value_of(MACHINE, name) for name in estimate.names])
    assert (np.abs(estimate.values - truth) < 4.5 * estimate.standard_errors).all()
    # five legs are as well known as before
    assert estimate.standard_errors[0] < 1.2 * clean.standard_errors[0]


@pytest.mark.parametrize(("factor", "said"), [(1 / 4.4482216, "like lbf: write the unit"), (4.4482216, "read as lbf")])
def test_forces_in_pounds_are_an_alarm_that_names_them(factor: float, said: str) -> None:
    """Expected: of 4.448 N each, from a nominal platform whose payload is not known; not of forces in N."""
    log = machine_log(course=Course(duration=5.0))
    estimate = identify(replace(log, actuator_force=factor * force_of(log)), NOMINAL, NAMES)
    assert said in estimate.alarms[0]
    assert not any("lbf" in alarm for alarm in perfect_estimate().alarms)


def test_exchanged_columns_of_forces_are_named() -> None:
    """Expected: the two legs whose columns were exchanged; else a platform with a mass off by 1 % comes of it."""
    with pytest.raises(GoughStewartError, match="the forces of legs 3 and 6 look exchanged"):
        identify(exchanged(machine_log(), 2, 5), NOMINAL, NAMES)
    # of a column that is there twice, one is right
    twice = force_of(machine_log()).copy()
    twice[:, 2] = twice[:, 5]
    [part] = screen.screened([replace(machine_log(), actuator_force=twice)], NOMINAL).parts
    assert screen.compared_forces([part], NOMINAL) == []


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


def test_a_gap_of_any_length_takes_no_memory_and_logs_are_shown_one_after_the_other() -> None:
    """Expected: the parts beside a gap of eleven days; the last 3/10 of each log validate; the second is a row on."""
    log = machine_log(course=Course(duration=5.0))
    time = np.asarray(log.time)
    gap = replace(log, time=np.where(np.arange(len(log)) >= 2500, time + 1e6, time), where="gap")
    estimate = identify([gap, log], MACHINE, "platform_mass", validation=0.3)
    assert "gap: 1000000000 missing rows, at 2.5 s to" in estimate.notes[0]
    shown = np.asarray(estimate.details["time"])
    assert (np.diff(shown) > 0).all()
    second = int(np.argmax(np.diff(shown) < 1e5)), np.flatnonzero(np.diff(shown) > 1e5)
    assert len(second[1]) == 1
    row = float(np.median(np.diff(shown)))
    assert_allclose(np.delete(np.diff(shown), second[1]), row, rtol=1e-6)
    (first, _), (start, end) = estimate.details["validating"]
    assert first > 1e6
    length = float(np.ptp(time))
    assert end - start == pytest.approx(0.3 * length, abs=0.5)


@pytest.mark.evidence
def test_intervals_of_held_readings_cover_the_machine() -> None:
    """Expected: of five logs the sum of (θ̂ − θ)ᵀ C⁻¹ (θ̂ − θ) is χ² of 65 degrees, within quantiles 5e-4, 1 − 5e-4."""
    truth = np.array([value_of(MACHINE, n) for n in perfect_estimate().names])
    distance = 0.0
    for seed in range(5):
        estimate = identify(held(machine_log(seed=seed)), NOMINAL, NAMES)
        error = estimate.values - truth
        distance += float(error @ np.linalg.solve(estimate.covariance, error))
    assert chi2.ppf(5e-4, 5 * len(truth)) < distance < chi2.isf(5e-4, 5 * len(truth))
