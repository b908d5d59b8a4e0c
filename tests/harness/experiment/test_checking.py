"""Motions of experiments held against the limits of their platform, and experiments whose motion fits."""

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

import gough_stewart as gs
from tests.support import motions
from tests.support.uneven import UNEVEN

ALONG = {"position_amplitude": [0.1, -0.16, 0.2], "orientation_amplitude": [0.05, -0.08, 0.07]}
SWAY: dict[str, Any] = {"type": "sine", **ALONG, "frequency": 1.1, "phase": 0.3, "fade_in": 0.4}
# Of one axis, which has no other phases.
HEAVE = {**SWAY, "position_amplitude": [0, 0, 0.2], "orientation_amplitude": [0, 0, 0]}
WIDE: dict[str, float] = {"leg_velocity_max": 3.0, "leg_acceleration_max": 30.0, "actuator_power_max": 2000.0}


def experiment(
    stated: dict[str, float] = WIDE, folder: Path = Path(), reference: dict[str, Any] = SWAY
) -> gs.Experiment:
    """Of the uneven platform that states these limits beside its own; plant steps of 4 ms."""
    loop = {"duration": 1.2, "sample_time": 0.008, "plant_step": 0.004}
    stating: dict[str, Any] = stated
    return motions.experiment(replace(UNEVEN, **stating), reference, folder, loop=loop)


FITS: dict[str, tuple[dict[str, float], Literal["time", "amplitude"]]] = {
    "slower for the velocity": ({"leg_velocity_max": 0.7}, "time"),
    "smaller for the velocity": ({"leg_velocity_max": 0.7}, "amplitude"),
    "slower for the acceleration": ({"leg_acceleration_max": 3.0}, "time"),
    "smaller for power and acceleration": ({"actuator_power_max": 20.0, "leg_acceleration_max": 3.0}, "amplitude"),
    "smaller for the stroke": ({"leg_length_max": 3.35}, "amplitude"),
}


@pytest.mark.parametrize("what", FITS)
def test_a_fitted_motion_uses_all_of_its_limit_on_the_rows_of_its_own_run_and_not_more(what: str) -> None:
    """Expected: 100 % − 1e-6 to 100 %; the run that was refused is prepared, or allowed with a warning."""
    limits, fit = FITS[what]
    reference = {**SWAY, "time_scale": 0.9, "amplitude_scale": -1.1}
    found = gs.check(experiment(limits, reference=reference))
    assert not found.within
    with pytest.raises(gs.GoughStewartError, match="it would fit if it were"):
        gs.run(found.experiment)
    if what == "slower for the velocity":
        (text,) = gs.run(found.experiment, {"limits.reference": "warn"}).metadata["warnings"]
        assert "the velocity of leg" in text
    fitted = found.fitted(fit)
    assert fitted.within
    assert 1 - 1e-6 <= fitted.shares.total.max() <= 1
    assert "warnings" not in gs.run(fitted.experiment).metadata
    choice = fitted.experiment.reference
    assert choice is not None
    if fit == "time":
        assert choice.amplitude_scale == -1.1
        # the whole motion is run: as long as before in its own time, but for a plant step
        grown = fitted.experiment.loop.duration / choice.time_scale
        assert grown == pytest.approx(1.2 / 0.9, abs=0.004)
        assert grown >= 1.2 / 0.9 - 1e-9
        assert found.time_factor == pytest.approx(choice.time_scale / 0.9, rel=1e-3)
    else:
        assert (choice.time_scale, fitted.experiment.loop.duration) == (0.9, 1.2)
        assert found.amplitude_factor == pytest.approx(choice.amplitude_scale / -1.1, rel=1e-6)


def verdict(found: gs.MotionCheck) -> str:
    return found.report().verdict.text


def test_a_fitted_fastest_path_keeps_its_margin() -> None:
    """Expected: 90 % of the limits of speed and acceleration, where it is played 4 % too fast for its margin."""
    fast: dict[str, Any] = {"reference.time_scale": 0.96, "reference.ramp": 0}
    fast |= {"loop.duration": 1.2, "loop.sample_time": 0.01}
    fast["reference.poses"] = [[0.0] * 6, [0.3, 0.1, 0.2, 0, 0.14, 0]]
    limits = {"actuator_power_max": None, "actuator_force_max": None, "leg_acceleration_max": 5.0}
    fast |= {f"platform.parameters.{name}": limit for name, limit in limits.items()}
    found = gs.check("fastest_path", fast)
    assert (found.within, found.keeps_margin) == (True, False)
    assert verdict(found).startswith("Can be done, but not with its margin of 10 %; leg ")
    assert found.time_factor == pytest.approx(1 / 0.96, rel=1e-3)
    assert found.amplitude_factor == pytest.approx(0.96**2, rel=1e-3)  # by the acceleration
    fitted = found.fitted("time")
    assert fitted.keeps_margin
    # the run goes on after the path, as before
    assert fitted.experiment.loop.duration == pytest.approx(1.2 / 0.96, abs=0.015)
    used = max(fitted.shares.peak(name).share for name in ("leg_velocity_max", "leg_acceleration_max"))
    assert 0.9 - 1e-6 <= used <= 0.9 + 1e-9


def test_a_motion_that_fits_is_left_alone() -> None:
    found = gs.check(experiment(reference=HEAVE))
    assert found.within
    assert (found.time_factor, found.amplitude_factor) == (1, 1)
    assert found.settings_that_fit("time") == found.settings_that_fit("amplitude") == {}
    # this platform states every limit
    assert found.not_stated == ()
    assert verdict(found).startswith("Can be done; leg ")
    for share, status in ((0.89, "good"), (0.91, "marginal")):
        stated = {**WIDE, "leg_velocity_max": float(np.abs(found.needs["leg_velocity_peak"]).max()) / share}
        report = gs.check(experiment(stated, reference=HEAVE)).report()
        assert report.verdict.status == status
        assert report.number("limits.leg_velocity_max").margin == pytest.approx(1 - share)
    for name, need, word in (("leg_velocity_max", "leg_velocity_peak", "speed"),
                             ("actuator_force_max", "actuator_force_peak", "force")):  # fmt: skip
        stated = {**WIDE, name: float(np.abs(found.needs[need]).max()) / 0.95}
        assert f" needs 95 % of its {word} at " in verdict(gs.check(experiment(stated, reference=HEAVE)))
    # without any limit only singular poses are checked
    names = ("leg_length_min", "leg_length_max", "joint_angle_max", "actuator_force_max")
    report = gs.check(experiment({}, reference=HEAVE), {f"platform.parameters.{name}": None for name in names}).report()
    assert report.verdict.status == "told"
    assert "as far as is known: the platform states no limit of its legs; " in report.verdict.text
    assert ": stroke, joint angle, leg velocity, leg acceleration, force and power." in report.notes[0].text


def test_a_slower_recording_is_run_to_its_end_and_not_beyond(tmp_path: Path) -> None:
    """Expected: a table of 1.2 s, whose last row a duration in whole steps may miss by one step."""
    time = np.linspace(0, 1.2, 61)
    pose = np.array([0.08, -0.05, 2.9, 0.04, -0.07, 0.11]) + 0.05 * np.sin(np.outer(time, [7, 6, 5, 4, 3, 2]))
    head = "time,position[1],position[2],position[3],orientation[1],orientation[2],orientation[3]"
    np.savetxt(tmp_path / "motion.csv", np.column_stack([time, pose]), delimiter=",", header=head, comments="")
    reference = {"type": "file", "file": "motion.csv"}
    fitted = gs.check(experiment({"leg_velocity_max": 0.13}, tmp_path, reference=reference)).fitted("time")
    assert 1 - 1e-6 <= fitted.shares.total.max() <= 1
    assert fitted.experiment.reference is not None
    scale = fitted.experiment.reference.time_scale
    assert 1.2 * scale - 0.004 < fitted.experiment.loop.duration <= 1.2 * scale


def test_a_static_force_beyond_its_limit_is_helped_by_nothing() -> None:
    found = gs.check(experiment({"actuator_force_max": 20.0}, reference=HEAVE))
    assert (found.time_factor, found.amplitude_factor) == (None, None)
    assert verdict(found).endswith("; no slower and no smaller motion fits")
    for fit in ("time", "amplitude"):
        with pytest.raises(
            gs.GoughStewartError, match=rf"motion.toml: no {fit}_scale makes the motion fit; actuator_force_max is"
        ):
            found.fitted(fit)
    with pytest.raises(gs.GoughStewartError, match="neither slower nor smaller helps"):
        gs.run(found.experiment)


def test_a_payload_is_a_point_mass_on_the_platform() -> None:
    """Expected: at rest, the vertical forces carry the weight of both; inertia by the parallel axes of a dumbbell."""
    hold = {"reference": {"type": "hold"}, "loop.duration": 0.1}
    bare, loaded = gs.check("pitch_sine", hold), gs.check("pitch_sine", hold, payload="300 kg", payload_height="50 cm")
    m, before, after = 300.0, bare.platform, loaded.platform
    assert after.platform_mass == pytest.approx(before.platform_mass + m)
    said = loaded.report(charts=False)
    assert said.lead.endswith("motion_base with a payload of 300 kg at 0.5 m, nominal model, no external forces, 0.1 s")
    assert {setting.key for setting in said.settings} == {"reference", "loop.duration"}
    share = m / after.platform_mass
    arm = np.array([0, 0, 0.5]) - before.platform_com
    np.testing.assert_allclose(after.platform_com, before.platform_com + share * arm, atol=1e-12)
    dumbbell = before.platform_mass * share * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    np.testing.assert_allclose(after.platform_inertia, before.platform_inertia + dumbbell, atol=1e-9)
    more = loaded.needs["actuator_force_peak"] - bare.needs["actuator_force_peak"]
    legs = before.platform_points - (before.base_points - before.home_position)
    rise = legs[:, 2] / np.linalg.norm(legs, axis=1)
    assert more @ rise == pytest.approx(m * 9.81, rel=1e-6)
    alone: Any = {"payload_height": "1 m"}
    for wrong in (*({"payload": mass} for mass in ("3 m", 0.0, np.inf)), {"payload": 1, "payload_height": "x"}, alone):
        with pytest.raises(gs.GoughStewartError, match="payload"):
            gs.check("pitch_sine", hold, **wrong)


def test_the_worst_phases_are_those_of_a_search_among_motions_with_a_phase_for_each_axis() -> None:
    """Expected: for small amplitudes a leg's speed is linear, and its largest has all axes in phase or opposed."""
    small: dict[str, Any] = {"position_amplitude": (1e-4, 0, 2e-4), "orientation_amplitude": (0, 1e-4, 0)}
    small["frequency"] = 1.3
    found = gs.check("pitch_sine", {"reference": gs.Sine(**small), "loop.duration": 2})
    assert found.worst_phases is not None
    rows = {row.need: row for row in found.worst_phases}
    platform = found.platform
    points = platform.platform_points
    legs = platform.home_position + points - platform.base_points
    directions = legs / np.linalg.norm(legs, axis=1)[:, None]
    by_axis = np.stack([1e-4 * directions[:, 0], 2e-4 * directions[:, 2], 1e-4 * np.cross(points, directions)[:, 1]])
    speeds = 2 * np.pi * 1.3 * np.abs(by_axis).sum(axis=0)
    assert rows["speed"].worst == pytest.approx(speeds.max(), rel=1e-3)
    assert rows["speed"].leg == int(speeds.argmax()) + 1
    assert rows["speed"].as_given == pytest.approx(np.abs(found.needs["leg_velocity_peak"]).max(), rel=1e-3)
    assert rows["stroke"].worst == pytest.approx(2 * np.abs(by_axis).sum(axis=0).max(), rel=1e-3)
    # the same by a check of its own, with these phases
    phases = np.zeros(6)
    phases[[0, 2, 4]] = list(rows["power"].phases.values())
    again = {**small, "position_phase": tuple(phases[:3]), "orientation_phase": tuple(phases[3:])}
    own = gs.check("pitch_sine", {"reference": gs.Sine(**again), "loop.duration": 2})
    assert own.needs["motoring_power_peak"].max() == pytest.approx(rows["power"].worst, rel=1e-3)
    assert rows["power"].leg == int(own.needs["motoring_power_peak"].argmax()) + 1
    assert list(rows["power"].phases) == ["x", "z", "pitch"]
    assert gs.check("pitch_sine").worst_phases is None  # of one axis
    with pytest.raises(gs.GoughStewartError, match=r"reference: is missing; add one"):
        gs.check("paper_open_loop")


def test_the_worst_phases_of_a_slower_sine_are_found_after_its_whole_fade_in() -> None:
    """Expected: those of a sine of a third of the frequency, without a fade."""
    sizes: dict[str, Any] = {"position_amplitude": (0, 0, 0.03), "orientation_amplitude": (0, 0.02, 0)}
    slower = gs.Sine(**sizes, frequency=1.5, fade_in=2, time_scale=3)
    rows, expected = (
        gs.check("pitch_sine", {"reference": sine, "loop.duration": 1}).worst_phases
        for sine in (slower, gs.Sine(**sizes, frequency=0.5))
    )
    assert rows is not None
    assert expected is not None
    assert [row.worst for row in rows] == pytest.approx([row.worst for row in expected], rel=1e-9)
