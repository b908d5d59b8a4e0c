"""Motions of experiments held against the limits of their platform, and experiments whose motion fits."""

from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.uneven import PARAMETERS

SWAY = {
    "type": "sine",
    "position_amplitude": [0.1, -0.16, 0.2],
    "orientation_amplitude": [0.05, -0.08, 0.07],
    "frequency": 1.1,
    "phase": 0.3,
    "fade_in": 0.4,
}


WIDE: dict[str, float] = {"leg_velocity_max": 3.0, "leg_acceleration_max": 30.0, "actuator_power_max": 2000.0}


def experiment(stated: dict[str, float] = WIDE, folder: Path = Path(), **tables: Any) -> gs.Experiment:
    """Of the uneven platform that states these limits beside its own; plant steps of 4 ms."""
    values = {
        "title": "sway",
        "platform": {"parameters": {**PARAMETERS, **stated}},
        "reference": SWAY,
        "controller": {"type": "pd", "bandwidth": 1.5},
        "loop": {"duration": 1.2, "sample_time": 0.008, "plant_step": 0.004},
    }
    return gs.Experiment(**(values | tables)).from_file("sway.toml", folder)


def test_the_force_limit_is_that_of_the_actuators() -> None:
    """Expected: the force share counted of 500 N, where the platform states 640 N; none without a limit."""
    of_platform, of_file = (gs.check(experiment(actuators={"force_limit": f})).shares for f in ("platform", "0.5 kN"))
    assert np.allclose(of_file.of["actuator_force_max"], of_platform.of["actuator_force_max"] * 640 / 500, rtol=1e-12)
    assert np.allclose(of_file.of["stroke"], of_platform.of["stroke"], rtol=1e-12)
    assert "actuator_force_max" not in gs.check(experiment(actuators={"force_limit": "none"})).shares.of


FITS: dict[str, tuple[dict[str, float], Literal["time", "amplitude"]]] = {
    "slower for the velocity": ({"leg_velocity_max": 0.7}, "time"),
    "smaller for the velocity": ({"leg_velocity_max": 0.7}, "amplitude"),
    "slower for the acceleration": ({"leg_acceleration_max": 3.0}, "time"),
    "smaller for power and acceleration": ({"actuator_power_max": 20.0, "leg_acceleration_max": 3.0}, "amplitude"),
    "smaller for the stroke": ({"leg_length_max": 3.35}, "amplitude"),
}


@pytest.mark.parametrize("what", FITS)
def test_a_fitted_motion_uses_all_of_its_limit_on_the_rows_of_its_own_run_and_not_more(what: str) -> None:
    """Expected: 100 % − 1e-6 to 100 %; the run that was refused is prepared."""
    limits, fit = FITS[what]
    reference = {**SWAY, "time_scale": 0.9, "amplitude_scale": -1.1}
    found = gs.check(experiment(limits, reference=reference))
    assert not found.within
    with pytest.raises(gs.GoughStewartError, match="it would fit if it were"):
        gs.run(found.experiment)
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
    """Expected: 90 % of the limits of speed and effort, where the motion is played 4 % too fast for its margin."""
    fast = {"reference.time_scale": 0.96, "loop.duration": 2.6, "loop.sample_time": 0.005}
    found = gs.check("fastest_path", fast)
    assert (found.within, found.keeps_margin) == (True, False)
    assert verdict(found).startswith("Can be done, but not with its margin of 10 %; leg ")
    fitted = found.fitted("time")
    assert fitted.keeps_margin
    dynamic = ("leg_velocity_max", "leg_acceleration_max", "actuator_force_max", "actuator_power_max")
    used = max(fitted.shares.peak(name).share for name in dynamic if name in fitted.shares.of)
    assert 0.9 - 1e-6 <= used <= 0.9 + 1e-9


def test_a_motion_that_fits_is_left_alone() -> None:
    found = gs.check(experiment())
    assert found.within
    assert (found.time_factor, found.amplitude_factor) == (1, 1)
    assert found.settings_that_fit("time") == found.settings_that_fit("amplitude") == {}
    # this platform states every limit
    assert found.not_stated == ()
    assert verdict(found).startswith("Can be done; leg ")


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
    found = gs.check(experiment({"actuator_force_max": 20.0}))
    assert (found.time_factor, found.amplitude_factor) == (None, None)
    assert verdict(found).endswith("; no slower and no smaller motion fits")
    for fit in ("time", "amplitude"):
        with pytest.raises(
            gs.GoughStewartError, match=rf"sway.toml: no {fit}_scale makes the motion fit; actuator_force_max is"
        ):
            found.fitted(fit)
    with pytest.raises(gs.GoughStewartError, match="neither slower nor smaller helps"):
        gs.run(found.experiment)


def test_no_motion_cannot_be_checked() -> None:
    with pytest.raises(gs.GoughStewartError, match=r"reference: is missing; add one"):
        gs.check("paper_open_loop")


def test_limits_of_motion_warn_before_a_run_that_is_to_go_on() -> None:
    """Expected: one line for the velocity, before the run and in the record; without the key a refusal."""
    tables: dict[str, Any] = {"loop": {"duration": 0.2, "sample_time": 0.008}}
    said: list[str] = []
    record = gs.run(experiment({"leg_velocity_max": 0.1}, limits={"reference": "warn"}, **tables), warn=said.append)
    assert len(said) == 1
    assert "the velocity of leg" in said[0]
    assert record.metadata["warnings"] == said
    with pytest.raises(gs.GoughStewartError, match="the velocity of leg"):
        gs.run(experiment({"leg_velocity_max": 0.1}, **tables))
    assert "warnings" not in gs.run(experiment({}, **tables)).metadata
