"""Single tables of an experiment at work: start, limits, strokes that are stated on one side, what a run warns of."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.errors import ExperimentError, SettingError
from gough_stewart.harness.experiment.files import warnings_of
from tests.support.uneven import UNEVEN

PARTS = {
    name: np.asarray(value).tolist()
    for name, value in UNEVEN.as_dict().items()
    if value is not None and name not in ("name", "source")
}
HOLD: dict[str, Any] = {
    "platform": {"preset": "liu2000", "parameters": PARTS},
    "reference": {"type": "hold"},
    "controller": {"type": "pd", "bandwidth": 2, "feedforward": "gravity"},
    "loop": {"duration": 0.02, "sample_time": 2e-3, "plant_step": 1e-3, "delay": 1},
    "sensors": {},
}


def run(**tables: Any) -> gs.Record:
    """A short run of the uneven platform."""
    return gs.run("heave_step", {**HOLD, **tables})


def static(machine: gs.Platform, pose: np.ndarray[Any, Any]) -> Any:
    """Forces of rest."""
    return gs.static_leg_forces(machine, pose[:3], pose[3:])


def test_every_key_of_the_start_is_in_the_first_row() -> None:
    """Expected: what is written, with units; what is not, from the reference, which moves at its beginning."""
    sine = {"type": "sine", "position_amplitude": [0.01, 0.02, 0.03], "orientation_amplitude": [0.04, 0.05, 0.06]}
    reference = {**sine, "frequency": 1.5, "phase": 0.4}
    start = {
        "position": ["90 mm", -0.06, "2.91 m"],
        "orientation": ["2 deg", 0.03, -0.02],
        "velocity": ["0.1 m/s", "-20 mm/s", 0.03],
        "angular_velocity": ["1 deg/s", 0.2, -0.3],
    }
    meant = {
        "position": [0.09, -0.06, 2.91],
        "orientation": [np.pi / 90, 0.03, -0.02],
        "velocity": [0.1, -0.02, 0.03],
        "angular_velocity": [np.pi / 180, 0.2, -0.3],
    }
    free = run(reference=reference)
    for name in meant:
        assert free[name][0] == pytest.approx(free[f"reference.{name}"][0])
        one = run(reference=reference, start={name: start[name]})
        for other, values in meant.items():
            assert one[other][0] == pytest.approx(values if other == name else free[other][0]), (name, other)


def test_a_closed_loop_starts_at_rest_and_an_open_one_with_its_own_forces() -> None:
    """Expected: until the first command acts, the static forces of the start's pose and the machine; clipped."""
    pose = np.array([0.12, -0.06, 2.93, 0.02, 0.05, -0.04])
    start = {"position": pose[:3].tolist(), "orientation": pose[3:].tolist()}
    machine = gs.load_experiment("heave_step", {**HOLD, "plant": {"parameters": {"platform_mass": 14.0}}})
    record = gs.run(machine, {"start": start})
    heavier = type(UNEVEN)(**{**UNEVEN.as_dict(), "platform_mass": 14.0})
    assert record["actuator_force"][0] == pytest.approx(static(heavier, pose), rel=1e-9)
    limited = gs.run(machine, {"start": start, "actuators.force_limit": 50.0, "limits.reference": "warn"})
    assert limited["actuator_force"][0] == pytest.approx(np.clip(static(heavier, pose), -50, 50), rel=1e-9)
    force = [55.0, 45.0, 50.0, 40.0, 60.0, 35.0]
    own = run(controller={"type": "open_loop", "force": force}, start=start)
    assert own["actuator_force"][0].tolist() == pytest.approx(force)
    assert own["controller.feedforward"][3].tolist() == pytest.approx(force)


def test_force_limits_come_from_the_platform_the_file_or_nowhere() -> None:
    """Expected: of the nominal platform, not the machine's."""
    plant = {"parameters": {"actuator_force_max": 900.0}}
    for value, meant in (("platform", 640.0), ("none", None), ("0.3 kN", 300.0)):
        assert run(actuators={"force_limit": value}, plant=plant).metadata["force_limit"] == meant
    assert run(plant=plant).metadata["force_limit"] == 640


@pytest.mark.parametrize("side", ["leg_length_min", "leg_length_max"])
def test_a_stroke_may_be_stated_on_one_side(side: str) -> None:
    """Expected: flags and a warning for the legs beyond that side alone; of the first row, leg and length."""
    weak = {"type": "pd", "proportional_gain": 200, "derivative_gain": 20}
    fall = 1 if side == "leg_length_min" else -1
    gravity = {"parameters": {"gravity": (fall * UNEVEN.gravity).tolist()}}
    tables: dict[str, Any] = {"controller": weak, "plant": gravity, "loop": {**HOLD["loop"], "duration": 0.1}}
    other = "leg_length_max" if side == "leg_length_min" else "leg_length_min"
    parts = {name: value for name, value in PARTS.items() if name != other}
    home = gs.leg_geometry(UNEVEN, UNEVEN.home_position, UNEVEN.home_orientation).length
    bound = float(home.min() - 0.003 if fall > 0 else home.max() + 0.003)
    platform = {"preset": "liu2000", "parameters": {**parts, side: bound}}
    found = {how: run(platform=platform, **tables, limits={"stroke": how}) for how in ("warn", "ignore")}
    record = found["warn"]
    beyond = record["leg_length"] < bound if fall > 0 else record["leg_length"] > bound
    assert beyond.any()
    assert not beyond.all()
    assert (record["flag.stroke_exceeded"] == beyond).all()
    row = int(beyond.any(axis=1).argmax())
    leg = int(beyond[row].argmax())
    said = [line for line in warnings_of(record) if "stroke" in line]
    time, length = record["time"][row], record["leg_length"][row, leg]
    assert said == [
        f"leg {leg + 1} left its stroke at {time:.6g} s with a length of {length:.6g} m; see flag.stroke_exceeded"
    ]
    assert not [line for line in warnings_of(found["ignore"]) if "stroke" in line]
    assert (found["ignore"]["flag.stroke_exceeded"] == beyond).all()


def test_a_platform_that_is_held_aside_is_not_said_to_hang() -> None:
    """Expected: the distance in the record's end; a force across gravity moves it sideways, along gravity down."""
    for force, word in (([300.0, -200.0, 0.0], "rests"), ([0.0, 0.0, -300.0], "hangs")):
        record = gs.run(
            "heave_step",
            {
                "platform.parameters": {"gravity": [0, 0, -9.81]},
                "reference": {"type": "hold"},
                "controller": {"type": "pd", "bandwidth": 4, "damping_ratio": 1, "feedforward": "none"},
                "plant.parameters": {"gravity": [0, 0, -1e-3]},
                "disturbance": [{"at": 0, "duration": 3, "force": [100 * each for each in force]}],
                "loop": {"duration": 2.5, "sample_time": 5e-3},
                "actuators.force_limit": "none",
                "sensors": {},
            },
        )
        (said,) = [line for line in warnings_of(record) if "its reference at the end" in line]
        mean = record["error.position"][int(0.8 * len(record["time"])) :].mean(axis=0)
        where = "below" if word == "hangs" else "off"
        assert said.startswith(f"the platform {word} {1000 * np.linalg.norm(mean):.3g} mm {where} its reference")


def test_an_ensemble_in_which_nothing_varies_is_refused() -> None:
    """Expected: noise or jitter alone are enough."""
    nothing: dict[str, Any] = {**HOLD, "ensemble": {"members": 2}}
    with pytest.raises(
        ExperimentError, match=r"ensemble: nothing varies; expected a distribution, for instance platform"
    ):
        gs.run("heave_step", nothing, member=0)
    noisy = gs.run("heave_step", {**nothing, "sensors": {"noise": {"leg_length": 1e-6}}}, member=1)
    assert (noisy["measured.leg_length"] != noisy["leg_length"]).all()
    jitter = gs.run("heave_step", {**nothing, "loop": {**HOLD["loop"], "jitter": 1e-3}}, member=1)
    assert jitter.metadata["seed"] == {"entropy": 0, "spawn_key": [1]} or jitter.metadata["seed"] == 0
    with pytest.raises(
        ExperimentError, match=r"limits\.stroke: is 'stop', which is for single runs only; expected 'warn'"
    ):
        gs.run("heave_step", {**nothing, "limits": {"stroke": "stop"}}, member=0)


def test_a_platform_file_is_known_by_two_of_its_keys(tmp_path: Path) -> None:
    """Expected: joints and mass make a platform; one of them is an unknown key of an experiment."""
    start = 'title = "x"\nloop.duration = 1\ncontroller = {type = "pd", bandwidth = 1}\n'
    for lines, says in (
        ("platform_mass = 3\nbase_points = []\n", "is a platform file; expected an experiment that names it"),
        ("platform_mass = 3\n", "platform_mass: unknown key"),
        ("base_points = []\n", "base_points: unknown key"),
        ("platform_mass = 3\nplatform_points = []\n", "platform_mass: unknown key"),
    ):
        (tmp_path / "x.toml").write_text(start + lines)
        with pytest.raises(ExperimentError, match=says):
            gs.load_experiment(tmp_path / "x.toml")


def test_elements_of_lists_are_set_by_their_number_from_one() -> None:
    """Expected: the first and the last of two; none before, after or between."""
    two = [{"at": 0.1, "duration": 0.1, "force": [1, 2, 3]}, {"at": 0.3, "duration": 0.2, "torque": [4, 5, 6]}]
    loaded = gs.load_experiment("impulse", {"disturbance": two})
    moved = gs.load_experiment("impulse", {"disturbance": two, "disturbance.2.at": 0.4, "disturbance.1.duration": 0.05})
    assert [each.at for each in moved.disturbance] == [0.1, 0.4]
    assert [each.duration for each in moved.disturbance] == [0.05, 0.2]
    assert moved.disturbance[1].torque == loaded.disturbance[1].torque == (4, 5, 6)
    for key in ("disturbance.0.at", "disturbance.3.at", "disturbance.x.at", "disturbance.-1.at", "title.1.at"):
        with pytest.raises(SettingError, match=rf"^setting '{key}': {key[:-3]} is not a table of the experiment$"):
            gs.load_experiment("impulse", {"disturbance": two, key: 1})
    # given experiments are not changed
    assert [each.at for each in loaded.disturbance] == [0.1, 0.3]


def test_texts_of_settings_are_toml_or_words() -> None:
    """Expected: values of their types; words without quotes, and blanks around them, as texts."""
    texts = ["title= a longer = title ", "loop.duration=0.25", 'controller.bandwidth="3 Hz"', "ensemble.margins=true"]
    texts += ["ensemble.platform_mass={normal=1}", "sensors.noise={leg_length=1e-6, position='2 um'}"]
    found = gs.load_experiment("heave_step", texts)
    assert found.title == "a longer = title"
    assert found.loop.duration == 0.25
    assert found.controller.model_dump()["bandwidth"] == 3
    assert found.ensemble is not None
    assert found.ensemble.margins is True
    assert found.sensors.noise == {"leg_length": 1e-6, "position": pytest.approx(2e-6)}
    for text, says in (
        ("loop.duration", "expected key=value, for instance loop.duration=2"),
        ("a=1\n", "expected one line"),
    ):
        with pytest.raises(SettingError) as caught:
            gs.load_experiment("heave_step", [text])
        assert str(caught.value) == f"--set {text}: {says}"
