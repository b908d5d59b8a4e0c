"""Settings of the loop that change during a run, and references that a hand goes on with."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs

AT_REST: dict[str, Any] = {
    **{"sensors.quantisation": {}, "loop.duration": 0.6, "reference": {"type": "hold"}, "loop.delay": 0},
    **{"controller.feedforward": "none", "loop.plant_step": 5e-4},
}
PD = {"type": "pd", "bandwidth": 3.0, "damping_ratio": 0.8, "derivative_on": "measurement"}
HEADER = "time,x,y,z,roll,pitch,yaw,jumps"


def test_other_gains_give_other_forces_of_the_same_error() -> None:
    """Expected: at rest the force goes from kp e to kp' e, kp'/kp = (3/2)², without a kick, at the later sample."""
    record = gs.run("heave_step", {**AT_REST, "loop.duration": 4, "change": [{"at": 3.5005, "controller": PD}]})
    before, after = record["actuator_force"][7001], record["actuator_force"][7002]
    assert np.ptp(record["actuator_force"][6900:7002], axis=0).max() < 1e-3 * np.abs(before).max()
    assert after == pytest.approx(2.25 * before, rel=1e-3)


def test_more_damping_in_motion_gives_no_kick() -> None:
    """Expected: the derivative's force goes on where it was, then to the other damping within its filter's time."""
    sine = {"type": "sine", "position_amplitude": [0, 0, 0.02], "frequency": 0.5}
    settings = {**AT_REST, "loop.duration": 2.1, "loop.plant_step": 1e-3, "reference": sine, "controller": PD}
    more = {"at": 2.0, "controller": {**PD, "damping_ratio": 1.2}}
    force, unchanged = (
        gs.run("heave_step", {**settings, "controller.feedforward": "none", "change": changes})["controller.force"]
        for changes in ([more], [])
    )
    difference = np.abs(force - unchanged).max(axis=1)
    assert difference[:2000].max() == 0.0
    assert difference[2000] < 0.03 * difference[2000:].max()


def test_a_delay_and_a_limit_that_change() -> None:
    """Expected: of forces that ramp with the samples, those of three samples ago from the change on; then the limit."""
    ramp = {"type": "open_loop", "force": [4000.0] * 6}
    changes = [{"at": 0.001 * k, "controller": {**ramp, "force": [4000.0 + k] * 6}} for k in range(1, 40)]
    more = [{"at": 0.020, "delay": 3}, {"at": 0.030, "force_limit": 4020.0}]
    settings = {**AT_REST, "controller": ramp, "loop.duration": 0.04, "loop.plant_step": 1e-3}
    force = gs.run("heave_step", {**settings, "change": [*changes, *more]})["actuator_force"][:40, 0]
    expected = [*range(20), *range(17, 27), *[20] * 10]
    # the command of 20 ms has its place in the line; what was limited later comes later
    expected[30:33] = [27, 28, 29]
    assert force - 4000 == pytest.approx(expected, abs=1e-9)


def test_settings_of_one_change_stay_in_the_next_and_end_with_the_run() -> None:
    """Expected: noise from 10 ms on, multiples of 1 mm from 20 ms, both after 30 ms; nothing after the last sample."""
    noisy, coarse = {"at": 0.01, "noise": {"leg_length": 5e-3}}, {"at": 0.02, "quantisation": {"leg_length": 1e-3}}
    changes = [noisy, coarse, {"at": 0.03, "delay": 1}, {"at": 0.0405, "delay": 5}]
    record = gs.run("heave_step", {**AT_REST, "loop.duration": 0.0405, "change": changes})
    read, true = record["measured.leg_length"][:80], record["leg_length"][:80]
    error, off = np.abs([read - true, read - 1e-3 * np.round(read / 1e-3)]).reshape(2, 4, -1).max(-1)  # each 10 ms
    assert ((error > 3e-3).tolist(), (off > 1e-9).tolist()) == ([False, True, True, True], [True, True, False, False])


def test_a_hand_goes_on_from_the_motion_to_its_targets(tmp_path: Path) -> None:
    """Expected: the motion before the first target, which is reached; a jump moves the reference at once."""
    (tmp_path / "targets.csv").write_text(f"{HEADER}\n0.5,0.05,0,2,0,0,0.1,0\n4.0,0.05,0,2.01,0,0,0.1,1\n")
    sine = {"type": "sine", "position_amplitude": [0, 0.02, 0], "frequency": 0.5}
    hand = {"type": "by_hand", "file": str(tmp_path / "targets.csv"), "sample_time": 0.002, "motion": sine}
    common = {"loop.duration": 4.1, "loop.delay": 0}
    record, motion = (gs.run("pitch_sine", {**common, "reference": reference}) for reference in (hand, sine))
    begin, jump = 250, 2000
    for name in ("reference.position", "reference.orientation", "reference.velocity"):
        assert np.array_equal(record[name][: begin + 1], motion[name][: begin + 1])
    pose, angles = record["reference.position"], record["reference.orientation"]
    assert pose[jump - 1] == pytest.approx([0.05, 0, 2], abs=1e-4)
    assert angles[jump - 1] == pytest.approx([0, 0, 0.1], abs=1e-4)
    assert pose[jump] - pose[jump - 1] == pytest.approx([0, 0, 0.01], abs=1e-4)


def test_settings_change_beside_any_plant_but_not_in_an_ensemble() -> None:
    """Expected: beside SciPy's plant the commands of the compiled one, to its tolerance; members say so."""
    changes = {**AT_REST, "change": [{"at": 0.1, "delay": 2, "controller": {**PD, "bandwidth": 2.0}}]}
    here, there, unchanged = (
        gs.run("heave_step", settings)["controller.force"]
        for settings in (changes, {**changes, "plant.kind": "scipy"}, AT_REST)
    )
    assert np.abs(here - unchanged).max() > 1e-3 * np.abs(here).max()
    assert there == pytest.approx(here, abs=1e-7 * np.abs(here).max())
    with pytest.raises(gs.GoughStewartError, match="which only those of linear controllers can"):
        gs.run("heave_step", changes, controller=gs.sampled(gs.pid(gs.Gains(2e5, 2e4)), 1e-3))
    members = {"members": 2, "seed": 1, "platform_mass": {"factor": {"uniform": [0.9, 1.1]}}}
    with pytest.raises(gs.GoughStewartError, match="which members of an ensemble cannot"):
        gs.ensemble("heave_step", {**changes, "ensemble": members})


@pytest.mark.parametrize(
    ("text", "more", "said"),
    [
        ("time,x\n0,1\n", {}, "has no column y; expected time, x, y"),
        (f"{HEADER}\n0.0011,0,0,2,0,0,0,0\n", {}, "at multiples of sample_time, 0.002 s"),
        (f"{HEADER}\n0.1,0,0,2,0,0,0,0\n0,0,0,2,0,0,0,0\n", {}, "rows in order of time"),
        (f"{HEADER}\n-0.002,0,0,2,0,0,0,0\n", {}, "expected rows in order of time"),
        (f"{HEADER}\n0,0,0,2,0,0,0,0\n", {"motion": {"type": "sine", "frequency": 300}}, "frequency of 300 Hz at a"),
        (f"{HEADER}\n0,0,0,2,0,0,0,0\n", {"time_scale": 2}, "expected no time_scale and amplitude_scale"),
    ],
)
def test_targets_that_are_none_are_refused(text: str, more: dict[str, Any], said: str, tmp_path: Path) -> None:
    """Expected: file, what was found, what was expected."""
    (tmp_path / "targets.csv").write_text(text)
    hand = {"type": "by_hand", "file": str(tmp_path / "targets.csv"), "sample_time": 0.002, "motion": {"type": "hold"}}
    with pytest.raises(gs.GoughStewartError, match=said):
        gs.run("pitch_sine", {"loop.duration": 0.2, "reference": {**hand, **more}})
