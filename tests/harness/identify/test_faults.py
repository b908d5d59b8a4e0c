"""Faults in the data of logs: found by place and number, mended to within the intervals, or refused.

Logs come from a Lagrangian; where each fault is, how large and how long, is chosen by the test. Intervals of 95 % are
those of the same log without the fault.
"""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from gough_stewart.harness.errors import LogError
from gough_stewart.harness.experiment.run import run
from gough_stewart.harness.identify import faults
from gough_stewart.harness.identify.estimate import Estimate
from gough_stewart.harness.identify.faults import hold_of, without_held_rows
from gough_stewart.harness.identify.identify import identify
from gough_stewart.harness.identify.log import Log, log_of
from gough_stewart.harness.identify.names import value_of
from gough_stewart.harness.identify.screen import screened
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


@pytest.mark.parametrize("number", [1, 3, -1])
def test_lost_and_repeated_rows_are_counted(number: int) -> None:
    """Expected: the row and the number; −1 is a row that was logged twice, so all legs stand still then."""
    log = machine_log()
    rows = np.arange(len(log))
    rows = np.insert(rows, 5000, 4999) if number < 0 else np.delete(rows, slice(5000, 5000 + number))
    (found,) = faults.lost_rows(log.leg_length[rows], np.zeros((len(rows), 6), dtype=bool))
    assert found.row == 5000
    assert found.number == pytest.approx(number, abs=0.1)


def test_readings_are_held_only_if_all_change_in_one_rhythm() -> None:
    """Expected: 4 rows from row 3 on; 1 for a coarse encoder, which changes at any row."""
    time = np.arange(2000) * 1e-3
    smooth = np.sin(2 * np.pi * time) + 1e-3 * np.random.default_rng(1).standard_normal(len(time))
    assert hold_of(smooth[np.maximum(0, (np.arange(2000) - 3) // 4 * 4 + 3)]) == (4, 3)
    assert hold_of(0.05 * np.rint(smooth / 0.05)) == (1, 0)
    assert hold_of(smooth) == (1, 0)


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


def test_exchanged_columns_of_forces_are_named() -> None:
    """Expected: the two legs whose columns were exchanged; before, a platform with a mass off by 1 % came of it."""
    with pytest.raises(LogError, match="the forces of legs 3 and 6 look exchanged"):
        identify(exchanged(machine_log(), 2, 5), NOMINAL, NAMES)


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


def test_times_of_32_bits_are_refused_by_that_name() -> None:
    """Expected: at 10,000 s such numbers are 1/1024 s apart, which is no time for rows of 1 ms; at 1 s they are."""
    log = machine_log()
    assert log.time is not None
    coarse = (np.asarray(log.time) + 1e4).astype(np.float32).astype(float)
    with pytest.raises(LogError, match=r"times are numbers of 32 bits, 0\.00098 s apart at 100"):
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
