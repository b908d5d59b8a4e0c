"""What is let pass, is told and is refused, from both sides of each limit that the documentation states."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gough_stewart.harness.errors import IdentificationError, LogError
from gough_stewart.harness.identify import faults
from gough_stewart.harness.identify.estimate import on_one_axis
from gough_stewart.harness.identify.faults import hold_of, without_held_rows
from gough_stewart.harness.identify.fit import scales
from gough_stewart.harness.identify.identify import identify
from gough_stewart.harness.identify.log import Log, rows_apart
from gough_stewart.harness.identify.names import expanded
from gough_stewart.harness.identify.regressor import check_independent
from gough_stewart.harness.identify.screen import check_units, screened
from gough_stewart.model.kinematics import leg_geometry
from tests.support.machine_logs import (
    MACHINE,
    NOMINAL,
    Course,
    force_of,
    machine_log,
    part_of,
    with_spikes,
    without_rows,
)
from tests.support.uneven import UNEVEN

ROWS = 2000
LOG = machine_log(course=Course(duration=2.0), seed=4)
TIME = np.asarray(np.arange(ROWS) * 1e-3 + 7.3, dtype=float)
LATE = replace(LOG, time=TIME, where="late.csv")


@pytest.mark.parametrize(
    ("spikes", "alarms", "refused"), [(9, False, False), (12, True, False), (38, True, False), (44, True, True)]
)
def test_interpolated_rows_are_noted_then_alarm_then_refuse(spikes: int, alarms: bool, refused: bool) -> None:
    """Expected: docs/identify.md, more than 0.5 % of 2000 rows is an alarm, more than 2 % is refused."""
    log = with_spikes(LATE, "leg_length", 0.02, spikes, seed=2)
    if refused:
        with pytest.raises(LogError, match=rf"late.csv: too many faults .* 2\.\d % of the rows .* {spikes} spikes"):
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


@pytest.mark.parametrize(("rows", "found"), [(1, True), (4, True), (7, True), (9, False)])
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


def test_rows_are_lost_where_all_legs_jump_by_their_own_velocity() -> None:
    """Expected: six unequal legs, 2 rows lost before row 500; a jump of one leg alone, or a spike, is another fault."""
    t = np.arange(1002) * 1e-3
    smooth = np.stack([2 + 0.1 * np.sin((1 + 0.3 * k) * t + k) for k in range(6)], axis=1)
    none = np.zeros((1000, 6), dtype=bool)
    [found] = faults.lost_rows(np.delete(smooth, [500, 501], axis=0), none)
    assert found.row == 500
    assert found.number == pytest.approx(2.0, abs=0.01)
    alone = smooth[:1000].copy()
    alone[500:, 2] += 1e-3
    assert not faults.lost_rows(alone, none)
    bad = none.copy()
    bad[501, 4] = True
    assert not faults.lost_rows(np.delete(smooth, [500, 501], axis=0), bad)
    assert not faults.lost_rows(smooth[:30], none[:30])


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
        with pytest.raises(LogError, match="leg 3 has a median length of"):
            check(factor)
    for ratio in (1 / 100, 70.0):
        with pytest.raises(LogError, match="expected similar forces"):
            check(force=ratio)
    with pytest.raises(LogError, match="exceeds actuator_force_max"):
        check(force=-1.0, limit=1 / 3.1)


def test_gaps_are_counted_in_rows_and_their_sample_time_is_the_whole_log_s() -> None:
    _, number, h = rows_apart(without_rows(LATE, 700, 3))
    assert number[699] == 4
    assert (np.delete(number, 699) == 1).all()
    assert h == pytest.approx(1e-3, rel=1e-9)


@pytest.mark.parametrize("duration", [0.1, 0.2, 0.3])
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
    with pytest.raises(LogError, match=r"held for 3 rows, but legs change at different rows \(1, 3\)"):
        without_held_rows(replace(log, length=shifted))
    assert without_held_rows(replace(log, force=values))[1] == []


def test_parts_are_fitted_up_to_their_share_and_shown_one_after_the_other() -> None:
    """Expected: three tenths of each log at its end; the second log begins a row after the first ends."""
    [part] = screened([LATE], NOMINAL, 0.3).parts
    end = 7.3 + 0.7 * 1.999
    assert part.is_fitted(np.array([7.3, end - 1e-6, end + 1e-6, 9.299])).tolist() == [True, True, False, False]
    assert screened([LATE], NOMINAL, 0.0).parts[0].is_fitted(TIME).all()
    time = np.asarray(np.arange(5) * 0.1, dtype=float)
    parts = [part_of(LOG, which, until) for which, until in ((0, 0.25), (0, np.inf), (1, 3.15), (2, -np.inf))]
    found, spans = on_one_axis(parts, [time, time + 1, time + 3, np.zeros(0)])
    assert_allclose(found, [0, 0.1, 0.2, 0.3, 0.4, 1, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9])
    assert_allclose(spans, [(0.3, 0.4), (1.7, 1.9)])
    for wrong in (-0.1, 1.0):
        with pytest.raises(LogError, match="expected a share of the log, 0 or more and less than 1"):
            screened([LATE], NOMINAL, wrong)


def test_names_mean_all_of_their_elements_in_order() -> None:
    assert expanded([" platform_inertia ", "base_tilt", "platform_com[2]"], UNEVEN) == (
        *(f"platform_inertia[{k}]" for k in ("1,1", "1,2", "1,3", "2,2", "2,3", "3,3")),
        *("base_tilt[1]", "base_tilt[2]", "platform_com[2]"),
    )
    assert expanded(["leg_coulomb_friction[1..6]"], UNEVEN) == tuple(f"leg_coulomb_friction[{k}]" for k in range(1, 7))
    assert expanded(["leg_coulomb_friction", "leg_viscous_friction[3]"], UNEVEN)[0] == "leg_coulomb_friction"
    assert len(expanded(["force_gain", "base_points"], UNEVEN)) == 6 + 18
    with pytest.raises(IdentificationError, match="no names; expected parameters"):
        expanded([], UNEVEN)


def test_rows_are_lost_in_whole_numbers_only() -> None:
    """Expected: 1.4 and 1.6 rows are a time that the legs cannot have moved for; 1 and 2 are."""
    t = np.arange(1000) * 1e-3
    for rows, number in ((1.0, 1), (1.4, 0), (1.6, 0), (2.0, 1)):
        late = np.where(np.arange(1000) < 500, t, t + rows * 1e-3)
        legs = np.stack([2 + 0.1 * np.sin((6 + 1.3 * k) * late + k) for k in range(6)], axis=1)
        assert len(faults.lost_rows(legs, np.zeros((1000, 6), dtype=bool))) == number


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


def test_sizes_of_changes_are_those_of_the_platform_and_of_the_log() -> None:
    """Expected: written out for 40 N of changes and 0.25 m/s, from the platform's own numbers."""
    size = UNEVEN.characteristic_length
    expected = {
        "platform_mass": 11.5,
        "platform_com[2]": size,
        "platform_inertia[1,3]": 11.5 * size**2,
        "leg_armature": 11.5 / 6 + 1.2,
        "leg_viscous_friction": 160.0,
        "leg_viscous_friction[4]": 160.0,
        "leg_coulomb_friction[6]": 40.0,
        "force_gain[2]": 1.0,
        "force_offset[3]": 40.0,
        "delay": 0.01,
        "base_tilt[2]": 0.1,
        "leg_upper_com": 0.58,
        "leg_lower_mass": 2.3,
    }
    assert_allclose(scales(UNEVEN, list(expected), 40.0, 0.25), list(expected.values()), rtol=1e-12)


def test_what_depends_on_others_is_named_with_all_of_them() -> None:
    """Expected: the combination by which the last column was made, with either sign, without those it does not have."""
    rng = np.random.default_rng(3)
    columns = rng.standard_normal((50, 3)) * np.array([3.0, 2.0, 2.5])
    made = np.column_stack([columns, 0.3 * columns[:, 0] - 0.4 * columns[:, 2]])
    with pytest.raises(IdentificationError) as caught:
        check_independent(made, ["a", "b", "c", "d"], "dead", "<{}>")
    assert caught.value.names == ("d",)
    said = str(caught.value).removeprefix("<d has the same effect as a combination of ").removesuffix(">")
    assert sorted(said.split(", ")) == ["a", "c"]
    check_independent(columns, ["a", "b", "c"], "dead", "")
