"""Experiment files: what they may say, and what is told about those that are wrong."""

import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gough_stewart.harness.control.controllers import PID
from gough_stewart.harness.errors import ExperimentError, ReachError
from gough_stewart.harness.experiment.file import (
    experiment_from,
    experiment_names,
    experiment_of,
    load_experiment,
    shipped_experiment,
    shipped_text,
    with_settings,
)
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.experiment.schema import Experiment, LoopChoice
from gough_stewart.harness.motion.references import PointToPoint, Step
from gough_stewart.harness.quantities import UNITS, number
from gough_stewart.model.platform_toml import preset_text

SHIPPED = experiment_names()
GOOD = shipped_text("heave_step")


def written(folder: Path, text: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_experiments_can_be_prepared(name: str) -> None:
    """Expected: as many rows and samples as the clocks say."""
    prepared = prepare(shipped_experiment(name))
    timing = prepared.loop.timing
    assert len(timing.times) == timing.steps + 1
    assert prepared.loop.feedforward.shape == (len(timing.samples), 6)


def test_the_control_page_names_every_shipped_experiment() -> None:
    """Expected: the list of docs/control.md."""
    page = (Path(__file__).parents[3] / "docs" / "control.md").read_text()
    assert [name for name in SHIPPED if f"`{name}`" not in page] == []


# What is replaced in heave_step, by what, and what the message has to name: key, value, remedy.
BROKEN = {
    "unknown key": ('title = "heave', 'titel = "heave', "titel: unknown key.*did you mean 'title'"),
    "unknown key in a table": ("delay = 1", "latency = 1", "loop.latency: unknown key .= 1."),
    "unknown key of a reference": ('at = "0.2 s"', 'when = "0.2 s"', "reference.when: unknown key"),
    "unknown key of a controller": (
        "damping_ratio",
        "damping",
        "controller.damping: unknown key.*did you mean 'damping_ratio'",
    ),
    "unknown table": ("[sensors.quantisation]", "[sensor]", "sensor: unknown key.*did you mean 'sensors'"),
    "wrong unit": (
        'duration = "2 s"',
        'duration = "2 kg"',
        "loop.duration: is '2 kg'.*units s, ms.*found the unit 'kg'",
    ),
    "radians for hertz": ('"2 Hz"', '"2 rad"', "controller.bandwidth: is '2 rad'.*found the unit 'rad'"),
    "a text without a unit": ('duration = "2 s"', 'duration = "long"', "loop.duration: is 'long'"),
    "a truth value": ('duration = "2 s"', "duration = true", "loop.duration: is True; expected a number of s"),
    "a list for a number": ('duration = "2 s"', "duration = [2]", r"loop.duration: is \[2\]"),
    "not finite": ('duration = "2 s"', "duration = inf", "loop.duration: is inf"),
    "negative": ('duration = "2 s"', 'duration = "-2 s"', "loop.duration: is '-2 s'; expected > 0 s"),
    "too few numbers": (
        '["0 m", "0 m", "0.05 m"]',
        '["0 m", "0.05 m"]',
        "reference.position_change.*list of 3 .m.; found 2",
    ),
    "a number for a list": ('["0 m", "0 m", "0.05 m"]', "0.05", "reference.position_change.*found one value"),
    "a wrong unit in a list": ('"0.05 m"]', '"0.05 deg"]', "value 3 of 3.*found the unit 'deg'"),
    "no controller": ("[controller]", "[sensors.noise]\n[controllers]", "controllers: unknown key"),
    "an unknown controller": ('type = "pd"', 'type = "lqr"', "controller: type is 'lqr'; expected one of.*'pd'"),
    "no type": ('type = "pd"\n', "", "controller: the key type is missing"),
    "no gains": (
        'bandwidth = "2 Hz"',
        "",
        "controller.*expected a bandwidth, or proportional_gain and derivative_gain",
    ),
    "gains twice": (
        'bandwidth = "2 Hz"',
        'bandwidth = "2 Hz"\nproportional_gain = 1',
        "a bandwidth or gains, not both",
    ),
    "an unknown choice": ('"gravity"', '"magic"', "controller.feedforward: is 'magic'; expected 'none', 'gravity' or"),
    "a fraction of a sample": ("delay = 1", "delay = 1.5", "loop.delay: is 1.5"),
    "an unknown signal": ("leg_length = ", "leg_lenght = ", "sensors.quantisation.*no signal 'leg_lenght'"),
    "a wrong unit of a signal": ('leg_length = "10 um"', 'leg_length = "1 deg"', "leg_length.*found the unit 'deg'"),
    "a step at once": ('at = "0.2 s"', "at = 0", "reference.at: is 0; expected > 0 s"),
    "a truth value for a ratio": ("damping_ratio = 0.8", "damping_ratio = true", "controller.damping_ratio: is True"),
    "a text for a tolerance": (
        "tolerance = 1e-10",
        "tolerance = '1e-10'",
        "plant.tolerance: is '1e-10'; expected a number",
    ),
    "an infinite condition number": (
        "[loop]",
        "[limits]\ncondition_number = inf\n[loop]",
        "limits.condition_number: is inf",
    ),
    "a velocity out of this world": (
        "[loop]",
        "[start]\nvelocity = [1e200, 0, 0]\n[loop]",
        "start.velocity.*at most 1e.12",
    ),
    "an unknown force limit": (
        "[loop]",
        "[actuators]\nforce_limit = 'weak'\n[loop]",
        "actuators.force_limit: is 'weak'.*'platform'",
    ),
    "a step of rounding": (
        'leg_length = "10 um"',
        "leg_length = 1e-320",
        "leg_length is 1e-320; expected 0, or at least 1e-15",
    ),
    "a number for a table": ("title = ", "limits = 3\ntitle = ", "limits: is 3; expected a table of keys"),
    "a change of nothing": ("[loop]", "[[change]]\nat = 1\n[loop]", "change.1: has no effect"),
    "a model of the controller's own": (
        'feedforward = "gravity"',
        "model = {platform_mass = 3}",
        r"controller: the key model was removed.*\[plant.parameters\]",
    ),
    "a damping ratio beside gains": (
        'bandwidth = "2 Hz"',
        "proportional_gain = 1\nderivative_gain = 1",
        "controller: damping_ratio needs a bandwidth",
    ),
    "a missing key": ('duration = "2 s"', "", "loop.duration: is missing"),
    "no TOML": ("[loop]", "[loop", "is not TOML"),
    "a key that is there twice": (
        "title = ",
        'title = "x"\ntitle = ',
        "is not TOML: the key 'title' in line . is a duplicate",
    ),
    "another unit without a space": ('duration = "2 s"', 'duration = "2kg"', "found the unit 'kg'"),
}


@pytest.mark.parametrize("what", BROKEN)
def test_a_broken_file_names_key_value_and_remedy(what: str, tmp_path: Path) -> None:
    old, new, match = BROKEN[what]
    assert old in GOOD
    path = written(tmp_path, GOOD.replace(old, new, 1))
    with pytest.raises(ExperimentError, match=rf"(?s)mine\.toml: .*{match}"):
        load_experiment(path)


# Files that can be read and still make no experiment: settings, and what the message has to name.
IMPOSSIBLE = {
    "a preset that is not there": (
        ["platform.preset=motionbase"],
        "platform: preset 'motionbase'.*did you mean 'motion_base'",
    ),
    "a platform file that is not there": (
        ["platform.preset=", "platform.file=no.toml"],
        "platform: .*no.toml: cannot read",
    ),
    "preset and file": (["platform.file=no.toml"], "platform: expected preset or file, not both"),
    "a platform with a negative mass": (["platform.parameters.platform_mass=-3"], "platform: platform_mass: is -3"),
    "an unknown parameter": (["platform.parameters.mass=3"], "platform: mass: no such parameter"),
    "a plant step that does not divide": (
        ["loop.plant_step=0.0003"],
        "loop: plant_step 0.0003 s does not divide sample_time",
    ),
    "a duration that is no whole number": (
        ["loop.duration=1.0005"],
        "loop: plant_step 0.001 s does not divide duration",
    ),
    "a filter faster than the samples": (["loop.sample_time=0.5", "loop.duration=2"], "controller: .*time constant"),
    "an integral that is too fast": (
        ["controller.type=pid", "controller.integral_time=0.001"],
        "controller: integral_time is 0.001 s; expected more than",
    ),
    "a PID without integral": (["controller.type=pid"], "controller: a PID needs an integral_time"),
    "a controller that is not there": (
        ['controller={type="python", file="nothing.py"}'],
        "controller: nothing.py: no such file",
    ),
    "a reference file that is not there": (['reference={type="file", file="no.csv"}'], "reference: .*no.csv"),
    "a change of what is fixed": (
        ["change=[{at=1, parameters={leg_lower_mass=3}}]"],
        "change: leg_lower_mass: cannot change during a run",
    ),
    "a change to what cannot be": (["change=[{at=1, parameters={platform_mass=-1}}]"], "change: platform_mass: is -1"),
    "a change between rows": (
        ["change=[{at=0.10005, factors={platform_mass=2}}]"],
        "change: a change at 0.10005 s; expected.*multiple",
    ),
    "a disturbance after the end": (["disturbance=[{at=3, duration=0.1}]"], "disturbance: a disturbance at 3 s"),
    "a delay longer than the run": (
        ["loop.delay=1000", "loop.duration=0.5"],
        "loop: delay of 1000 samples in a run of 0.5 s",
    ),
    "a disturbance of no time": (["disturbance=[{at=1, duration=1e-9}]"], "disturbance: a disturbance of 1e-09 s"),
    "a sine beyond the samples": (
        ["reference={type='sine', frequency=1000, position_amplitude=[0, 0, 0.01]}"],
        "reference: frequency of 1000 Hz.*less than half the sample rate, 500 Hz",
    ),
    "an anti-windup faster than the samples": (
        ["controller.type=pid", "controller.integral_time=0.5", "controller.anti_windup_time=1e-9"],
        "controller: anti_windup_time is 1e-09 s; expected at least the sample_time",
    ),
    "a run that no memory holds": (
        ["loop.duration=1e9"],
        "loop: sample_time|loop: duration 1e.09 s has 1e.12 plant steps",
    ),
    "a closed loop without reference": (["reference="], "reference"),
}


@pytest.mark.parametrize("what", IMPOSSIBLE)
def test_an_impossible_experiment_names_its_part(what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    settings, match = IMPOSSIBLE[what]
    values = tomllib.loads(GOOD)
    values = with_settings(values, [s for s in settings if not s.endswith("=")])
    for setting in settings:
        if setting.endswith("="):
            *path, last = setting[:-1].split(".")
            table: Any = values
            for name in path:
                table = table[name]
            del table[last]
    with pytest.raises(ExperimentError, match=rf"(?s){match}"):
        prepare(experiment_from(values))


def test_a_reference_out_of_reach_is_refused_with_time_and_leg() -> None:
    """Expected: the step of 2 m at 0.2 s leaves the stroke of every leg; the first is named."""
    with pytest.raises(ReachError, match=r"0\.2 s.*leg 1") as caught:
        prepare(shipped_experiment("heave_step", ["reference.position_change=[0, 0, 2.0]"]))
    assert caught.value.time == pytest.approx(0.2)
    assert caught.value.leg == 1


def test_an_experiment_made_in_python_is_that_of_the_file() -> None:
    """Expected: the same keys give the same experiment, in texts or numbers; settings find their kinds again."""
    made = Experiment(
        title="two degrees",
        reference=PointToPoint(orientation_change=[0, np.pi / 90, 0], at=0.1, duration=0.5),
        controller=PID(proportional_gain=[4e5, 5e5, 4e5, 5e5, 4e5, 6e5], derivative_gain=9e3, integral_time=0.5),
        loop=LoopChoice(duration=1, sample_time=2e-3, plant_step=5e-4),
    )
    text = """
    title = "two degrees"
    reference = {type = "point_to_point", orientation_change = [0, "2 deg", 0], at = "100 ms", duration = 0.5}
    loop = {duration = 1, sample_time = "2 ms", plant_step = 0.5e-3}
    [controller]
    type = "pid"
    proportional_gain = ["400 kN/m", 5e5, 4e5, 5e5, 4e5, 6e5]
    derivative_gain = "9 kN.s/m"
    integral_time = 0.5
    """
    assert made == experiment_from(tomllib.loads(text))
    slower = experiment_of(made, {"loop.delay": 2, "reference.duration": "0.8 s"})
    assert slower.controller == made.controller
    assert slower.reference == PointToPoint(orientation_change=[0, np.pi / 90, 0], at=0.1, duration=0.8)
    assert slower.loop.delay == 2


def test_an_experiment_made_in_python_is_refused_by_the_keys_of_the_file() -> None:
    controller: Any = {"type": "pd", "bandwith": 2}
    with pytest.raises(ExperimentError, match=r"controller\.bandwith: unknown key .= 2.; did you mean 'bandwidth'"):
        Experiment(title="x", controller=controller, loop=LoopChoice(duration=1))
    with pytest.raises(ExperimentError, match=r"^duration: is -1; expected > 0 s$"):
        LoopChoice(duration=-1)


def test_a_controller_in_the_place_of_an_open_loop_takes_its_forces_away() -> None:
    """Expected: of the plan only the feedforward stays; here the open loop's 1 N … 6 N beside none."""
    settings = ["controller={type='open_loop', force=[1, 2, 3, 4, 5, 6]}"]
    experiment = shipped_experiment("hold_against_gravity", settings)
    assert prepare(experiment).loop.feedforward[7].tolist() == [1, 2, 3, 4, 5, 6]
    replaced = prepare(experiment, lambda _sample: np.zeros(6))
    assert replaced.controller is not None
    assert not replaced.loop.feedforward.any()


def test_units_need_no_space(tmp_path: Path) -> None:
    """Expected: the same numbers with and without."""
    dense = re.sub(r'"(-?[0-9.]+) ([a-zA-Z]+)"', r'"\1\2"', GOOD)
    assert dense != GOOD
    assert (
        load_experiment(written(tmp_path, dense)).model_dump() == load_experiment(written(tmp_path, GOOD)).model_dump()
    )


def test_a_platform_file_is_no_experiment(tmp_path: Path) -> None:
    with pytest.raises(ExperimentError, match=r"mine.toml: is a platform file; expected an experiment that names it"):
        load_experiment(written(tmp_path, preset_text("liu2000")))


def test_a_missing_file_names_a_shipped_one_of_that_name(tmp_path: Path) -> None:
    with pytest.raises(ExperimentError, match=r"heave_ste.toml: cannot read.*did you mean 'heave_step', which ships"):
        load_experiment(tmp_path / "heave_ste.toml")
    with pytest.raises(ExperimentError, match=r"no such experiment; did you mean 'heave_step'"):
        shipped_experiment("heave_stp")


def test_settings_replace_and_add() -> None:
    """Expected: TOML values at their places, bare words as texts, arrays of tables by 1-based number."""
    settings = [
        "loop.delay=3",
        "plant.kind=fmu2",
        "reference.position_change=[0, 0, '5 mm']",
        "sensors.noise.leg_length='2 um'",
        "sensors.seed=7",
    ]
    experiment = shipped_experiment("heave_step", settings)
    assert (experiment.loop.delay, experiment.plant.kind, experiment.sensors.seed) == (3, "fmu2", 7)
    assert isinstance(experiment.reference, Step)
    assert experiment.reference.position_change == (0, 0, 0.005)
    assert experiment.sensors.noise == {"leg_length": pytest.approx(2e-6)}
    assert shipped_experiment("impulse", ["disturbance.1.force=['3 kN', 0, 0]"]).disturbance[0].force == (3000, 0, 0)


@pytest.mark.parametrize(
    "setting",
    ["loop.duration=0.1\nother=3", "loop.duration", "=3", "loop..delay=1", "title.more=1", "disturbance.2.at=1"],
)
def test_settings_that_are_none_are_refused(setting: str) -> None:
    with pytest.raises(ExperimentError, match="--set"):
        shipped_experiment("impulse", [setting])


@pytest.mark.parametrize("unit", UNITS)
def test_units_are_multiples_of_the_si_unit(unit: str) -> None:
    """Expected: the SI unit itself counts 1; a number alone is SI."""
    assert number(f"2.5 {unit}", unit) == 2.5
    assert number(2.5, unit) == 2.5


def test_hertz_are_not_radians_a_second() -> None:
    """Expected: 2π rad/s = 1 Hz = 60 rpm; 180 deg = π rad."""
    assert number(f"{2 * np.pi} rad/s", "Hz") == pytest.approx(1.0)
    assert number("60 rpm", "Hz") == pytest.approx(1.0)
    assert number("180 deg", "rad") == pytest.approx(np.pi)


@given(value=st.floats(-1e6, 1e6))
def test_millimetres_are_thousandths(value: float) -> None:
    """Expected: the definition."""
    assert number(f"{value!r} mm", "m") == pytest.approx(value * 1e-3)


def test_disturbances_add_up_where_they_overlap() -> None:
    """Expected: 2 kN from 0.5 s, 2 + 1 from 0.52, 1 from 0.55, none from 0.62."""
    settings = [
        "disturbance=[{at=0.5, duration=0.05, force=[2000, 0, 0]}, {at=0.52, duration=0.1, force=[1000, 0, 5]}]"
    ]
    changes = prepare(shipped_experiment("impulse", settings)).loop.changes
    assert [change.time for change in changes] == pytest.approx([0.5, 0.52, 0.55, 0.62])
    wrenches = np.array([change.external_wrench for change in changes])
    assert wrenches[:, 0].tolist() == [2000, 3000, 1000, 0]
    assert wrenches[:, 2].tolist() == [0, 5, 5, 0]


def test_factors_are_of_the_values_just_before() -> None:
    """Expected: 10 kg · 1.5 · 2 = 30 kg."""
    settings = ["change=[{at=2, factors={platform_mass=2}}, {at=1, factors={platform_mass=1.5}}]"]
    changes = prepare(shipped_experiment("payload_change", settings)).loop.changes
    assert [change.parameters["platform_mass"] for change in changes] == [15.0, 30.0]


def test_a_change_to_six_values_of_friction_changes_each_leg() -> None:
    """Expected: the mean 3.5 of 1 to 6, and each value over it; a plant takes both."""
    change = "change=[{at=1, parameters={leg_viscous_friction=[1, 2, 3, 4, 5, 6]}}]"
    prepared = prepare(
        shipped_experiment("heave_step", [change, "plant.parameters.leg_coulomb_friction=[6,5,4,3,2,1]"])
    )
    (made,) = prepared.loop.changes
    assert made.parameters["leg_viscous_friction"] == 3.5
    assert np.allclose(np.array(made.parameters["leg_viscous_friction_factor"]), np.arange(1, 7) / 3.5, rtol=1e-15)
    assert np.allclose(prepared.machine.leg_coulomb_friction_factor, np.arange(6, 0, -1) / 3.5, rtol=1e-15)
