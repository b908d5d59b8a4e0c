"""Experiment files and settings: what they may say, and what is told about those that are wrong."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs

SHIPPED = Path(__file__).parents[3] / "harness/experiment/shipped"
GOOD = (SHIPPED / "heave_step.toml").read_text("utf-8")
TIMES = "a string with one of the units s, ms, us, µs, ns, min"
SIGNALS = "position, orientation, velocity, angular_velocity, leg_length, leg_velocity"


def written(folder: Path, text: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(text)
    return path


PUSH = {"at": 0, "duration": 1}
GAINS = {"type": "pd", "proportional_gain": 1, "derivative_gain": 1}
# What is set in a good experiment, and the whole message, or its beginning.
WRONG: list[tuple[dict[str, Any], str]] = [
    ({"titel": "y"}, "titel: unknown key (= 'y'); did you mean 'title'?"),
    ({"loop.latency": 1}, "loop.latency: unknown key (= 1)"),
    ({"controller.damping": 1}, "controller.damping: unknown key (= 1); did you mean 'damping_ratio'?"),
    # a key that is named like its kind, and one that another kind has
    ({"controller.pd": 3}, "controller.pd: unknown key (= 3); expected one of type, feedforward, space, bandwidth, d"),
    ({"reference.file": "a.csv"}, "reference.file: unknown key (= 'a.csv'); expected one of type, time_scale, ampl"),
    ({"loop": {}}, "loop.duration: is missing; add it"),
    ({"loop": 3}, "loop: is 3; expected a table of keys"),
    ({"change": {"at": 1}}, "change: expected a valid list"),
    ({"controller": {"bandwidth": 2}}, "controller: the key type is missing; `gough-stewart experiments heave_step` "),
    ({"controller.type": "lqr"}, "controller: type is 'lqr'; expected one of "),
    ({"injection": {"type": "noise"}}, "injection: type is 'noise'; expected one of 'multisine', 'chirp', 'prbs'"),
    # units
    ({"loop.duration": "2 kg"}, f"loop.duration: is '2 kg'; expected a number of s, or {TIMES}; found the unit 'kg'"),
    ({"loop.duration": "long"}, f"loop.duration: is 'long'; expected a number of s, or {TIMES}"),
    ({"loop.duration": True}, "loop.duration: is True; expected a number of s"),
    ({"loop.duration": np.inf}, "loop.duration: is inf; expected a number of s"),
    ({"loop.duration": "-2 s"}, "loop.duration: is '-2 s'; expected > 0 s"),
    ({"reference.at": 0}, "reference.at: is 0; expected > 0 s"),
    ({"controller.bandwidth": "2 rad"}, "controller.bandwidth: is '2 rad'; expected a number of Hz, or a string with"),
    ({"plant.tolerance": "1e-10"}, "plant.tolerance: is '1e-10'; expected a number"),
    *(({f"{key}.tolerance": value}, f"{key}.tolerance: is {value}; expected")
      for key in ("plant", "ensemble") for value in (0, -1e-9, np.nan, np.inf)),
    ({"reference.at": 1.01e12}, "reference.at: is 1010000000000.0; expected a number of at most 1e+12 in SI units"),
    ({"start.velocity": [1e200, 0, 0]}, "start.velocity: is [1e+200, 0, 0]; value 1 of 3: expected a number of at mo"),
    ({"reference.position_change": [0, 1]}, "reference.position_change: is [0, 1]; expected a list of 3 [m]; found 2"),
    ({"reference.position_change": 0.05}, "reference.position_change: is 0.05; expected a list of 3 [m]; found one v"),
    ({"disturbance": [PUSH, {**PUSH, "force": [1, 2, "3 m"]}]}, "disturbance.2.force: is [1, 2, '3 m']; value 3 of 3: "
     "expected a number of N, or a string with one of the units N, kN; found the unit 'm'"),
    # words, whole numbers, signals
    ({"controller.feedforward": "magic"}, "controller.feedforward: is 'magic'; expected 'none', 'gravity' or 'comp"),
    ({"limits.condition_number": 1}, "limits.condition_number: is 1; expected"),
    ({"limits.stroke": "end"}, "limits.stroke: is 'end'; expected 'ignore', 'warn' or 'stop'"),
    ({"actuators.force_limit": "weak"}, "actuators.force_limit: is 'weak'; expected a number of N, or a string with "),
    ({"sensors.seed": 1.5}, "sensors.seed: is 1.5; expected a whole number"),
    ({"loop.delay": 1.5}, "loop.delay: is 1.5; expected a whole number of samples; write 1 or 2"),
    ({"loop.delay": "2 ms"}, "loop.delay: is '2 ms'; expected a whole number of samples, such as 2"),
    ({"change": [{"at": 1, "delay": 2.0}]}, "change.1.delay: is 2.0; expected a whole number of samples; write 2"),
    ({"loop.delay": -1}, "loop.delay: is -1; expected greater than or equal to 0"),
    ({"loop.delay": 1001}, "loop.delay: is 1001; expected less than or equal to 1000"),
    ({"sensors.noise": {"legs": 1}}, f"sensors.noise: no signal 'legs'; expected {SIGNALS}"),
    ({"sensors.noise": 3}, f"sensors.noise: is 3; expected a table of signals ({SIGNALS})"),
    ({"sensors.noise": {"leg_length": "1 deg"}}, "sensors.noise: leg_length: expected a number of m, or a string with"),
    ({"sensors.noise": {"leg_length": 1e-320}}, "sensors.noise: leg_length is 1e-320; expected 0, or at least 1e-15 m"),
    # conditions of several keys
    ({"platform": {"preset": "x", "file": "y"}}, "platform: expected preset or file, not both; leave one of them out"),
    ({"controller": {"type": "pd"}}, "controller: expected a bandwidth, or proportional_gain and derivative_gain"),
    ({"controller.proportional_gain": 1}, "controller: expected a bandwidth or gains, not both"),
    ({"controller": {**GAINS, "damping_ratio": 1}}, "controller: damping_ratio needs a bandwidth; remove it, or re"),
    ({"controller.model": {"platform_mass": 3}}, "controller: the key model was removed: controllers use the nominal"),
    ({"change": [{"at": 1}]}, "change.1: has no effect; expected parameters, factors, or settings of the loop"),
    ({"change": [{"at": 1, "factors": {"gravity": 2}}, {"at": "x", "factors": {"gravity": 2}}]}, "change.2.at: is 'x'"),
    # what changes, and what fails
    ({"change": [{"at": 1, "noise": {"leg_length": -1}}]}, "change.1.noise: leg_length"),
    *(({"change": [{"at": 1, **more, "manual_force": [1.0] * 6}]},
       "change.1: manual_force acts while the controller is off; expected enabled =")
      for more in ({}, {"enabled": True})),
    *(({"fault": [{"at": 1, **fault}]}, f"fault.1{says}") for fault, says in (
        ({}, ": has no effect; expected cut, a list of legs, or freeze, a table of signals"),
        ({"cut": [0]}, ".cut: is [0]; no leg 0; expected numbers from 1 to 6"),
        ({"cut": [3, 3]}, ".cut: is [3, 3]; is [3, 3]; expected each number once"),
        ({"freeze": {"position": [4]}}, ".freeze: no element of position 4; expected numbers from 1 to 3"),
        ({"freeze": {"length": [4]}}, ".freeze: no signal 'length'; expected position, orientation"),
        ({"freeze": {"position": []}}, ".freeze: position is []; expected numbers from 1 to 3"),
        ({"freeze": [1]}, ".freeze: is [1]; expected a table of signals"),
    )),
    # several faults, in their order
    ({"loop": {"duration": 0, "dely": 1}, "sensors": {"seed": "x"}, "change": [{"at": 1, "values": {}}]},
     "loop.duration: is 0; expected > 0 s; loop.dely: unknown key (= 1); did you mean 'delay'?; sensors.seed: is 'x'; "
     "expected a whole number; change.1.values: unknown key (= {}); expected one of at, parameters, factors, "
     "controller, delay, force_limit, noise, quantisation"),
    ({"require": {"force.peak": "800 N"}}, "require: the requirement 'force.peak 800 N' cannot be read; expected PATH"),
    ({"require": {"force.peak": 800}}, "require: force.peak is 800; expected a condition, such as '<= 1 mm', or a li"),
    ({"require": {"force": {"peak": ["<= 1 N", 3]}}}, "require: force.peak is ['<= 1 N', 3]; expected a condition"),
    ({"plant.parameters": {"platform_mass": "12 mm"}}, "plant.parameters: platform_mass is '12 mm'; expected a numbe"),
]  # fmt: skip


@pytest.mark.parametrize(("settings", "says"), WRONG)
def test_a_wrong_key_is_told_with_place_value_and_remedy(settings: dict[str, Any], says: str) -> None:
    with pytest.raises(gs.GoughStewartError) as caught:
        gs.load_experiment("heave_step", settings)
    where, _, message = str(caught.value).partition("': ")
    assert (where, message[: len(says)]) == ("experiment 'heave_step", says)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[loop\n", "is not TOML"),
        ('title = "x"\ntitle = "y"\n', "is not TOML: the key 'title' in line 2 is a duplicate"),
        ("platform_mass = 3\nbase_points = []\n", "is a platform file; expected an experiment that names it: platf"),
        ("platform_mass = 3\n", "title: is missing; add it; "),
    ],
)
def test_a_file_that_is_no_experiment_is_told_with_its_name(text: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(gs.GoughStewartError, match=f"^{re.escape(f'{tmp_path}/mine.toml: {says}')}"):
        gs.load_experiment(written(tmp_path, text))


def test_what_is_no_file_is_refused_with_the_nearest(tmp_path: Path) -> None:
    for name, says in (
        (tmp_path / "heave_ste.toml", r"heave_ste.toml: cannot read.*did you mean 'heave_step', which ships"),
        ("nothing_like_it", r"expected a TOML file, or a shipped experiment, which `gough-stewart experiments` lists"),
        (3, r"experiment is 3; expected an Experiment, the name of a shipped one such as"),
    ):
        with pytest.raises((gs.GoughStewartError, TypeError), match=says):
            gs.run(name)  # type: ignore[arg-type]


PID = {"controller.type": "pid", "controller.integral_time": 0.5}
# What is set in a good experiment that cannot run so, and the message from the part on.
IMPOSSIBLE: list[tuple[dict[str, Any], str]] = [
    ({"platform": {"preset": "motionbase"}}, "platform: preset 'motionbase'.*did you mean 'motion_base'"),
    ({"platform": {"file": "no.toml"}}, "platform: .*no.toml: cannot read.*; expected a TOML file, or one of the pres"),
    ({"platform": {"file": "liu200.toml"}}, "platform: .*cannot read.*; did you mean the preset 'liu2000'?"),
    ({"platform": {"file": "uneve.toml"}}, "platform: .*cannot read.*; did you mean 'uneven.toml'?"),
    ({"platform.parameters.platform_mass": -3}, "platform: platform_mass: is -3"),
    ({"platform.parameters.mass": 3}, "platform: mass: no such parameter"),
    ({"plant.parameters.platform_mas": 3}, "plant: platform_mas: no such parameter; did you mean 'platform_m"),
    ({"plant": {"file": "nowhere.toml"}}, r"plant: .*nowhere\.toml"),
    ({"loop.duration": 1e9}, "loop: duration 1e.09 s has 1e.12 plant steps"),
    ({"loop.sample_time": 0.5, "loop.duration": 2}, "controller: .*time constant"),
    ({**PID, "controller.integral_time": 0.001}, "controller: integral_time is 0.001 s; expected more than"),
    ({"controller.type": "pid"}, "controller: a PID needs an integral_time"),
    ({**PID, "controller.anti_windup_time": 1e-9}, "controller: anti_windup_time is 1e-09 s; expected at least the sa"),
    ({"controller": {"type": "python", "file": "nothing.py"}}, "controller: nothing.py: no such file"),
    ({"reference": {"type": "file", "file": "no.csv"}}, "reference: .*no.csv"),
    ({"loop.delay": 500, "loop.duration": 0.5}, "loop: delay of 500 samples in a run of 0.5 s"),
    (
        {"reference": {"type": "sine", "frequency": 500}},
        "reference: frequency of 500 Hz.*less than half the sample",
    ),
    ({"reference": None}, "reference: is missing; a controller needs one, for instance type = 'hold'"),
    ({"change": [{"at": 1, "parameters": {"leg_lower_mass": 3}}]}, "change: leg_lower_mass: cannot change during a"),
    ({"change": [{"at": 1, "parameters": {"gravity": 1}, "factors": {"gravity": 2}}]}, "change: gravity: is in par"),
    ({"change": [{"at": 1, "parameters": {"platform_mass": -1}}]}, "change: platform_mass: is -1"),
    ({"change": [{"at": 0.0, "delay": 2}]}, r"change\.1: at is 0 s, where settings are those of the tables"),
    ({"change": [{"at": 0.1, "controller": {"type": "pd", "bandwidth": 3, "space": "task"}}]},
     "change: .*has the structure .*; expected that of the experiment's"),
    ({"change": [{"at": 0.1, "controller": {"type": "open_loop"}}]}, "change: .*expected that of the experiment's"),
    ({"fault": [{"at": 5, "cut": [1]}]}, "fault: a fault at 5 s; expected a time from 0 to 2 s"),
    ({"fault": [{"at": 0.0505, "cut": [1]}]}, "fault: a fault at 0.0505 s; expected.*multiple"),
    ({"fault": [{"at": 0.1, "duration": 1e-9, "cut": [1]}]}, "fault: a fault of 1e-09 s at 0.1 s; expected at least"),
    ({"fault": [{"at": 0.1, "duration": 0.0205, "cut": [1]}]}, "fault: the end of a fault at 0.1205 s; expected.*mult"),
    ({"disturbance": [{"at": 3, "duration": 0.1}]}, "disturbance: a disturbance at 3 s"),
    ({"disturbance": [{"at": 1, "duration": 4.9e-4}]}, "disturbance: a disturbance of 0.00049 s"),
    ({"injection": {"type": "chirp", "leg": 1, "band": [4, 50], "amplitude": 1, "period": 1.5}}, "injection: a run of"),
]  # fmt: skip


@pytest.mark.parametrize(("settings", "says"), IMPOSSIBLE)
def test_an_impossible_experiment_names_its_part(
    settings: dict[str, Any], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: part, value and remedy, before anything runs."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "uneven.toml").touch()
    with pytest.raises(gs.GoughStewartError, match=rf"(?s)experiment 'heave_step': {says}"):
        gs.run("heave_step", settings)


def test_an_experiment_made_in_python_is_that_of_the_file(tmp_path: Path) -> None:
    """Expected: the same keys give the same experiment, in texts or numbers; settings find their kinds again."""
    controller = gs.PID(proportional_gain=[4e5, 5e5, 4e5, 5e5, 4e5, 6e5], derivative_gain=9e3, integral_time=0.5)
    reference: Any = {"type": "point_to_point", "orientation_change": [0, np.pi / 90, 0], "at": 0.1, "duration": 0.5}
    loop: Any = {"duration": 1, "sample_time": 2e-3, "plant_step": 5e-4}
    made = gs.Experiment(title="two degrees", reference=reference, controller=controller, loop=loop)
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
    assert made.model_dump() == gs.load_experiment(written(tmp_path, text)).model_dump()
    slower = gs.Experiment(**{**made.model_dump(exclude_unset=True), "loop": {**loop, "delay": 2}})
    assert slower.controller == made.controller
    with pytest.raises(gs.GoughStewartError, match=r"controller\.bandwith: unknown key .= 2.; did you mean"):
        gs.Experiment(title="x", controller={"type": "pd", "bandwith": 2}, loop=loop)  # type: ignore[arg-type]
    # units need no space
    dense = re.sub(r'"(-?[0-9.]+) ([a-zA-Z]+)"', r'"\1\2"', GOOD)
    assert dense != GOOD
    assert gs.load_experiment(written(tmp_path, dense)).model_dump() == gs.load_experiment("heave_step").model_dump()


def test_settings_are_a_mapping_or_texts_that_replace_and_add() -> None:
    """Expected: TOML values at their places, bare words as texts, arrays as lists, and what is in no text as it is."""
    texts = ["loop.delay=3", "plant.kind=fmu2", "reference.position_change=[0, 0, '5 mm']", "sensors.seed=7"]
    texts += ["sensors.noise={leg_length=1e-6, position='2 um'}", "title= a longer = title ", "ensemble.margins=true"]
    mapping: dict[str, Any] = {
        "loop.delay": np.int64(3),
        "plant.kind": "fmu2",
        "reference.position_change": np.array([0, 0, 0.005]),
        "sensors.seed": 7,
        "sensors.noise": {"leg_length": 1e-6, "position": "2 um"},
        "title": "a longer = title",
        "ensemble.margins": True,
    }
    found = gs.load_experiment("heave_step", iter(texts))
    assert found.model_dump() == gs.load_experiment("heave_step", mapping).model_dump()
    assert (found.loop.delay, found.plant.kind, found.sensors.seed) == (3, "fmu2", 7)
    assert found.model_dump()["reference"]["position_change"] == (0, 0, 0.005)
    assert found.sensors.noise == {"leg_length": 1e-6, "position": pytest.approx(2e-6)}
    assert found.changed["loop.delay"] == {"value": 3, "file": 1}
    assert gs.load_experiment("heave_step", "loop.delay=3").loop.delay == 3
    assert gs.load_experiment("heave_step", {"platform.file": "a.toml"}).platform.preset is None
    # of a key that is set twice the file's value stays known
    again = gs.run(found, {"plant.kind": "model", "loop.delay": 4, "loop.duration": 0.01, "reference.at": 5e-3})
    assert again.metadata["settings"]["loop.delay"] == {"value": 4, "file": 1}


def test_elements_of_lists_are_set_by_their_number_from_one() -> None:
    """Expected: the first and the last of two; none before, after or between."""
    two = [{"at": 0.1, "duration": 0.1, "force": [1, 2, 3]}, {"at": 0.3, "duration": 0.2, "torque": [4, 5, 6]}]
    loaded = gs.load_experiment("impulse", {"disturbance": two})
    moved = gs.load_experiment("impulse", {"disturbance": two, "disturbance.2.at": 0.4, "disturbance.1.duration": 0.05})
    assert [(wrench.at, wrench.duration) for wrench in moved.disturbance] == [(0.1, 0.05), (0.4, 0.2)]
    assert moved.disturbance[1].torque == loaded.disturbance[1].torque == (4, 5, 6)
    for key in ("disturbance.0.at", "disturbance.3.at", "disturbance.x.at", "disturbance.-1.at", "title.1.at"):
        with pytest.raises(gs.GoughStewartError, match=rf"^setting '{key}': {key[:-3]} is not a table"):
            gs.load_experiment("impulse", {"disturbance": two, key: 1})
    assert [wrench.at for wrench in loaded.disturbance] == [0.1, 0.3]  # given experiments are not changed


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        *(([text], f"--set {text}") for text in ("loop.duration", "=3", "loop..delay=1", "title.more=1", "a=1\nb=3")),
        *(({key: 1}, f"setting '{key}'") for key in ("", "loop..delay", "title.more")),
    ],
)
def test_settings_that_are_none_are_refused_by_their_name(settings: Any, says: str) -> None:
    with pytest.raises(gs.GoughStewartError) as caught:
        gs.load_experiment("impulse", settings)
    assert str(caught.value).startswith(says)


def test_a_title_that_no_file_can_have_is_refused_in_one_sentence() -> None:
    with pytest.raises(gs.GoughStewartError) as caught:
        gs.load_experiment("circle", {"title": "\udc80"})
    assert str(caught.value).endswith(r"title: is '\udc80'; expected text in UTF-8")


def test_a_file_a_name_and_an_experiment_run_alike(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: bit by bit the same records; the file names a platform of 13 kg beside it, settings leave it there."""
    circle = (SHIPPED / "circle.toml").read_text("utf-8")
    mine = written(tmp_path, circle.replace('preset = "liu2000"', 'file = "heavy.toml"'))
    heavy = (Path(__file__).parents[3] / "model/presets/liu2000.toml").read_text("utf-8")
    (tmp_path / "heavy.toml").write_text(heavy.replace("platform_mass = 10", "platform_mass = 13"), encoding="utf-8")
    short = {"loop.duration": 0.03, "loop.plant_step": 0.0005, "reference.frequency": 3.0, "plant.kind": "model"}
    from_file = gs.run(mine, short)
    assert (from_file.metadata["platform"]["platform_mass"], len(from_file["time"])) == (13, 61)
    for other in (
        gs.run(str(mine), short),
        gs.run(gs.load_experiment(mine), short),
        gs.run(gs.load_experiment(mine, short)),
        gs.run(gs.load_experiment(gs.load_experiment(mine), short)),
        gs.run("circle", {**short, "platform.parameters": {"platform_mass": 13}}),
    ):
        assert other.table.equals(from_file.table)
    # a file of a shipped name goes first
    monkeypatch.chdir(tmp_path)
    mine.rename("circle")
    files = [gs.load_experiment("circle", changed).platform.file for changed in ((), "platform.preset=liu2000")]
    assert files == ["heavy.toml", None]
    with pytest.raises(gs.GoughStewartError, match=r"preset and platform\.file are both set; expected one of them"):
        gs.load_experiment("circle", ["platform.preset=liu2000", "platform.file=heavy.toml"])


def test_requirements_have_paths_with_dots_or_quoted(tmp_path: Path) -> None:
    """Expected: each condition in words, also of a changed experiment."""
    text = """
    [require]
    tracking.position.norm_peak = "<= 1 mm"
    "force.peak" = ["<= 800 N for 95 % of members", "> 0"]
    """
    found = gs.load_experiment(written(tmp_path, GOOD + text))
    conditions = ("tracking.position.norm_peak <= 1 mm", "force.peak <= 800 N for 95 % of members", "force.peak > 0")
    assert found.requirements == conditions
    assert gs.load_experiment(tmp_path / "mine.toml", {"loop.delay": 3}).requirements == conditions
    assert found.model_dump(mode="json")["require"]["tracking.position.norm_peak"] == ["<= 1 mm"]


def test_parameters_of_platforms_may_have_units() -> None:
    """Expected: the conversions written out here; numbers without unit are SI."""
    tables: dict[str, Any] = {
        "platform.parameters": {"platform_mass": "900 kg", "platform_com": ["10 mm", 0, "2 cm"]},
        "plant.parameters": {"leg_coulomb_friction": ["0.5 kN", 400, 300, 300, 300, 300], "gravity": [0, 0, "-9 m/s2"]},
        "change": [{"at": 0.1, "parameters": {"platform_mass": "1.1 t"}}],
    }
    found = gs.load_experiment("heave_step", tables)
    assert found.platform.parameters == {
        "platform_mass": 900,
        "platform_com": pytest.approx([0.01, 0, 0.02], rel=1e-15),
    }
    assert found.plant.parameters == {"leg_coulomb_friction": [500, 400, *[300] * 4], "gravity": [0, 0, -9]}
    assert found.change[0].parameters["platform_mass"] == pytest.approx(1100, rel=1e-15)
    arrays = gs.load_experiment("heave_step", {"platform.parameters": {"platform_com": np.array([0.0, 0.1, 0.2])}})
    assert arrays.model_dump(mode="json")["platform"]["parameters"]["platform_com"] == [0, 0.1, 0.2]
