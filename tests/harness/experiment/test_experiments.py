"""Experiment files and settings: what they may say, and what is told about those that are wrong."""

import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs

SHIPPED = gs.experiment_names()
GOOD = (Path(__file__).parents[3] / "harness/experiment/shipped/heave_step.toml").read_text("utf-8")


def written(folder: Path, text: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(text)
    return path


def test_the_control_page_names_every_shipped_experiment() -> None:
    """Expected: the list of docs/experiment-file.md."""
    page = (Path(__file__).parents[3] / "docs" / "experiment-file.md").read_text()
    assert [name for name in SHIPPED if f"`{name}`" not in page] == []


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
    with pytest.raises(gs.GoughStewartError, match=rf"(?s)mine\.toml: .*{match}"):
        gs.load_experiment(path)


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
    """Expected: part, value and remedy, before anything runs; a setting `key=` takes a key out of the file."""
    monkeypatch.chdir(tmp_path)
    settings, match = IMPOSSIBLE[what]
    values = tomllib.loads(GOOD)
    for *path, last in [setting[:-1].split(".") for setting in settings if setting.endswith("=")]:
        table: Any = values
        for name in path:
            table = table[name]
        del table[last]
    with pytest.raises(gs.GoughStewartError, match=rf"(?s){match}"):
        gs.run(gs.Experiment(**values), [setting for setting in settings if not setting.endswith("=")])


def test_a_reference_out_of_reach_is_refused_with_time_and_leg() -> None:
    """Expected: the step of 2 m at 0.2 s leaves the stroke of every leg; the first is named."""
    with pytest.raises(gs.GoughStewartError, match=r"0\.2 s.*leg 1") as caught:
        gs.run("heave_step", {"reference.position_change": [0, 0, 2.0]})
    data: Any = caught.value
    assert (data.time, data.leg) == (pytest.approx(0.2), 1)


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
    read = gs.load_experiment(written(tmp_path, text))
    assert made.model_dump() == read.model_dump()
    slower = gs.Experiment(**{**made.model_dump(exclude_unset=True), "loop": {**loop, "delay": 2}})
    assert slower.controller == made.controller
    wrong: Any = {"type": "pd", "bandwith": 2}
    with pytest.raises(gs.GoughStewartError, match=r"controller\.bandwith: unknown key .= 2.; did you mean"):
        gs.Experiment(title="x", controller=wrong, loop=loop)


def test_units_need_no_space(tmp_path: Path) -> None:
    """Expected: the same numbers with and without."""
    dense = re.sub(r'"(-?[0-9.]+) ([a-zA-Z]+)"', r'"\1\2"', GOOD)
    assert dense != GOOD
    expected = gs.load_experiment(written(tmp_path, GOOD)).model_dump()
    assert gs.load_experiment(written(tmp_path, dense)).model_dump() == expected


def test_a_platform_file_is_known_by_two_of_its_keys(tmp_path: Path) -> None:
    """Expected: joints and mass make a platform; one of them is an unknown key of an experiment."""
    start = 'title = "x"\nloop.duration = 1\ncontroller = {type = "pd", bandwidth = 1}\n'
    for lines, says in (
        (
            "platform_mass = 3\nbase_points = []\n",
            "mine.toml: is a platform file; expected an experiment",
        ),
        ("platform_mass = 3\n", "platform_mass: unknown key"),
        ("base_points = []\n", "base_points: unknown key"),
    ):
        with pytest.raises(gs.GoughStewartError, match=says):
            gs.load_experiment(written(tmp_path, start + lines))


def test_what_is_no_experiment_is_refused_with_the_nearest(tmp_path: Path) -> None:
    for name, says in (
        (tmp_path / "heave_ste.toml", r"heave_ste.toml: cannot read.*did you mean 'heave_step', which ships"),
        ("heave_stp", r"cannot read this experiment.*'heave_step'"),
        ("nothing_like_it", r"expected a TOML file, or a shipped experiment, which `gough-stewart experiments` lists"),
        (3, r"experiment is 3; expected an Experiment, the name of a shipped one such as"),
    ):
        with pytest.raises((gs.GoughStewartError, TypeError), match=says):
            gs.run(name)  # type: ignore[arg-type]


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
    found = gs.load_experiment("heave_step", texts)
    assert found.model_dump() == gs.load_experiment("heave_step", mapping).model_dump()
    assert (found.loop.delay, found.plant.kind, found.sensors.seed) == (3, "fmu2", 7)
    assert found.model_dump()["reference"]["position_change"] == (0, 0, 0.005)
    assert found.sensors.noise == {"leg_length": 1e-6, "position": pytest.approx(2e-6)}
    assert found.changed["loop.delay"] == {"value": 3, "file": 1}
    assert gs.load_experiment("heave_step", "loop.delay=3").loop.delay == 3
    # of a key that is set twice the file's value stays known
    again = gs.run(found, {"plant.kind": "model", "loop.delay": 4, "loop.duration": 0.01, "reference.at": 5e-3})
    assert again.metadata["settings"]["loop.delay"] == {"value": 4, "file": 1}


def test_elements_of_lists_are_set_by_their_number_from_one() -> None:
    """Expected: the first and the last of two; none before, after or between."""
    two = [{"at": 0.1, "duration": 0.1, "force": [1, 2, 3]}, {"at": 0.3, "duration": 0.2, "torque": [4, 5, 6]}]
    loaded = gs.load_experiment("impulse", {"disturbance": two})
    moved = gs.load_experiment("impulse", {"disturbance": two, "disturbance.2.at": 0.4, "disturbance.1.duration": 0.05})
    assert [each.at for each in moved.disturbance] == [0.1, 0.4]
    assert [each.duration for each in moved.disturbance] == [0.05, 0.2]
    assert moved.disturbance[1].torque == loaded.disturbance[1].torque == (4, 5, 6)
    for key in ("disturbance.0.at", "disturbance.3.at", "disturbance.x.at", "disturbance.-1.at", "title.1.at"):
        with pytest.raises(gs.GoughStewartError, match=rf"^setting '{key}': {key[:-3]} is not a table"):
            gs.load_experiment("impulse", {"disturbance": two, key: 1})
    # given experiments are not changed
    assert [each.at for each in loaded.disturbance] == [0.1, 0.3]


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


SHORT = {"loop.duration": 0.03, "loop.plant_step": 0.0005, "reference.frequency": 3.0, "plant.kind": "model"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An experiment of one's own, with its platform beside it."""
    folder = tmp_path_factory.mktemp("own")
    circle = (Path(__file__).parents[3] / "harness/experiment/shipped/circle.toml").read_text("utf-8")
    (folder / "mine.toml").write_text(circle.replace('preset = "liu2000"', 'file = "heavy.toml"'), encoding="utf-8")
    text = (Path(__file__).parents[3] / "model/presets/liu2000.toml").read_text("utf-8")
    (folder / "heavy.toml").write_text(text.replace("platform_mass = 10", "platform_mass = 13"), encoding="utf-8")
    return folder


def test_a_file_a_name_and_an_experiment_run_alike(folder: Path) -> None:
    """Expected: bit by bit the same records; the file names a platform of 13 kg beside it, settings leave it there."""
    from_file = gs.run(folder / "mine.toml", SHORT)
    as_text = gs.run(str(folder / "mine.toml"), SHORT)
    loaded = gs.run(gs.load_experiment(folder / "mine.toml"), SHORT)
    whole = gs.run(gs.load_experiment(folder / "mine.toml", SHORT))
    by_name = gs.run("circle", {**SHORT, "platform.parameters": {"platform_mass": 13}})
    for other in (as_text, loaded, whole, by_name):
        assert other.table.equals(from_file.table)
    assert from_file.metadata["platform"]["platform_mass"] == 13
    assert len(from_file["time"]) == 61


def test_a_file_of_a_shipped_name_goes_first(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    (folder / "circle").write_text((folder / "mine.toml").read_text("utf-8"), encoding="utf-8")
    assert gs.load_experiment("circle").platform.file == "heavy.toml"


_WRITTEN = """
[require]
tracking.position.norm_peak = "<= 1 mm"
"force.peak" = ["<= 800 N for 95 % of members", "> 0"]
"""


def test_requirements_have_paths_with_dots_or_quoted(tmp_path: Path) -> None:
    """Expected: each condition in words, also of a changed experiment; others are refused by file and key."""
    found = gs.load_experiment(written(tmp_path, GOOD + _WRITTEN))
    conditions = ("tracking.position.norm_peak <= 1 mm", "force.peak <= 800 N for 95 % of members", "force.peak > 0")
    assert found.requirements == conditions
    assert gs.load_experiment(written(tmp_path, GOOD + _WRITTEN), {"loop.delay": 3}).requirements == conditions
    assert found.model_dump(mode="json")["require"]["tracking.position.norm_peak"] == ["<= 1 mm"]
    for text, says in (
        ('force.peak = "800 N"', "the requirement 'force.peak 800 N' cannot be read; expected PATH <= NUMBER UNIT"),
        ("force.peak = 800", "force.peak is 800; expected a condition, such as '<= 1 mm', or a list of them"),
        ('force.peak = ["<= 1 N", 3]', r"force.peak is \['<= 1 N', 3\]; expected a condition"),
    ):
        with pytest.raises(gs.GoughStewartError, match=f"mine.toml: require: .*{says}"):
            gs.load_experiment(written(tmp_path, f"{GOOD}\n[require]\n{text}\n"))


BASE: dict[str, Any] = {"title": "x", "controller": {"type": "pd", "bandwidth": 2}, "loop": {"duration": 1}}


def test_parameters_of_platforms_may_have_units() -> None:
    """Expected: the conversions written out here; numbers without unit are SI."""
    change = {"at": 0.1, "parameters": {"platform_mass": "1.1 t"}}
    parameters = {"platform_mass": "900 kg", "platform_com": ["10 mm", 0, "2 cm"], "leg_length_max": "3000 mm"}
    plant = {"leg_coulomb_friction": ["0.5 kN", 400, 300, 300, 300, 300], "gravity": [0, 0, "-9.8 m/s2"]}
    tables = {"platform": {"parameters": parameters}, "plant": {"parameters": plant}, "change": [change]}
    experiment = gs.Experiment(**(BASE | tables))
    assert experiment.platform.parameters == {
        "platform_mass": 900,
        "platform_com": pytest.approx([0.01, 0, 0.02], rel=1e-15),
        "leg_length_max": 3,
    }
    assert experiment.plant.parameters["leg_coulomb_friction"] == [500, 400, 300, 300, 300, 300]
    assert experiment.plant.parameters["gravity"] == [0, 0, -9.8]
    assert experiment.change[0].parameters["platform_mass"] == pytest.approx(1100, rel=1e-15)
    with pytest.raises(gs.GoughStewartError, match=r"plant\.parameters.*platform_mass is '12 mm'.*found the unit 'mm'"):
        gs.Experiment(**{**BASE, "plant": {"parameters": {"platform_mass": "12 mm"}}})
    arrays = gs.Experiment(**{**BASE, "platform": {"parameters": {"platform_com": np.array([0.0, 0.1, 0.2])}}})
    assert arrays.model_dump(mode="json")["platform"]["parameters"]["platform_com"] == [0, 0.1, 0.2]
