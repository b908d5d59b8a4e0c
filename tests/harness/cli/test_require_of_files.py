"""`[require]` of a file in all commands that study it: each judges its own numbers, and names those of others."""

import json
import re
import shlex
from pathlib import Path

import pytest

import gough_stewart as gs
from tests.support.commands import Result, invoke

# The step of 50 mm is an error of 50 mm at first; the disk margin of this loop is 1.16; it steps along z alone.
REQUIRED = {
    "tracking.position.norm_peak": "<= 51 mm",
    "step_response.x.settling_time": "<= 1 s",
    "limits.actuator_force_max": "<= 90 %",
    "margins.disk": ">= 1.9",
    "S.peak": "<= 2",
}
PEAK, SETTLING, FORCE, DISK, S = REQUIRED
SEARCH = "--vary controller.damping_ratio=0.7..0.9 --minimise tracking.position.norm_rms --generations 1 --population 5"
FEW = "--members 3 --workers 1 --set ensemble.worst=0 --set loop.duration=0.1"


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def requiring(experiment: str, conditions: dict[str, str]) -> None:
    """The shipped experiment with requirements, as mine.toml."""
    lines = "".join(f'{path} = "{condition}"\n' for path, condition in conditions.items())
    text = invoke("experiments", experiment).stdout
    Path("mine.toml").write_text(f"{text}\n[require]\n{lines}", encoding="utf-8")


def states(done: Result) -> dict[str, str]:
    return {each["path"]: each["status"] for each in json.loads(done.stdout).get("requirements", [])}


def left_out(done: Result) -> set[str]:
    said = (line.removeprefix("not judged by this command: ") for line in done.stderr.splitlines())
    return {line.split()[0] for line in said if "=" in line.split()[1]}


# Words, the exit code, how its numbers came out, and the experiment and settings that have the same disk margin.
JUDGED = [
    ("run mine.toml", 3, {PEAK: "met", SETTLING: "open", DISK: "missed"}, ("heave_step", {})),
    ("run mine.toml --controller fmu3 --set loop.delay=1 --set loop.duration=0.02", 4, {PEAK: "met", SETTLING: "open"},
     None),
    ("check mine.toml --set 'loop.sample_time=25 ms'", 0, {FORCE: "met"}, None),
    ("margins mine.toml", 3, {DISK: "missed"}, ("heave_step", {})),
    # with the sample of delay that the C has
    ("export mine.toml --as c", 3, {DISK: "missed"}, ("heave_step", {"loop.delay": 1})),
    (f"tune mine.toml {SEARCH} --set loop.duration=0.3 --require 'values.controller.damping_ratio <= 0.1'", 3,
     {PEAK: "met", DISK: "missed", "values.controller.damping_ratio": "missed"}, ("out/tuned.toml", {})),
]  # fmt: skip


@pytest.mark.parametrize(("words", "code", "expected", "same"), JUDGED, ids=[case[0] for case in JUDGED])
def test_each_command_judges_its_own_numbers_and_names_the_others(
    words: str, code: int, expected: dict[str, str], same: tuple[str, dict[str, int]] | None
) -> None:
    """Expected: one that is missed decides; one that is not defined is inconclusive; the disk margin of `margins`."""
    requiring("heave_step", REQUIRED)
    done = invoke(*shlex.split(words), "--json", "--out", "out")
    assert (done.exit_code, states(done)) == (code, expected), done.output
    assert left_out(done) == REQUIRED.keys() - expected.keys()
    if same is not None:
        numbers = {each["path"]: each["value"] for each in json.loads(done.stdout)["numbers"]}
        assert numbers[DISK] == pytest.approx(gs.margins(*same).disk.alpha)


@pytest.mark.parametrize(
    ("words", "judged"),
    [
        ("run mine.toml --set loop.duration=0.1", {DISK}),
        ("run mine.toml --set loop.duration=0.1 --member 1", set()),
        (f"ensemble mine.toml {FEW}", {PEAK}),
        (f"ensemble mine.toml {FEW} --set ensemble.margins=true", {PEAK, DISK}),
    ],
)
def test_a_share_of_members_is_for_ensembles_and_a_margin_for_those_that_compute_it(
    words: str, judged: set[str]
) -> None:
    """Expected: what is not judged is named; three members that hold tell of a quarter, as 0.25^3 is below 0.025."""
    requiring("heave_tolerances", {PEAK: "<= 1 m for 25 % of members", DISK: ">= 0.1"})
    done = invoke(*shlex.split(words), "--json", "--out", "out")
    assert (done.exit_code, states(done), left_out(done)) == (0, dict.fromkeys(judged, "met"), {PEAK, DISK} - judged)


UNKNOWN = [
    ("tracking.positoin.norm_peak", "no study has a number .*; did you mean 'tracking.position.norm_peak'"),
    ("trakcing.position.norm_peak", "did you mean 'tracking.position.norm_peak'"),
    ("margins.dsk", "did you mean 'margins.disk'"),
]
# What `check` and `margins` have of other experiments, and what gives it.
ABSENT = [
    ("limits.leg_acceleration_max", "is stated; set platform.parameters.leg_acceleration_max"),
    ("structure.first_mode", "the legs are rigid; set platform.parameters.leg_stiffness"),
    ("margins.believed.disk", "the machine is the platform of the design; set plant.parameters"),
]
STUDIES = [
    "check mine.toml",
    "margins mine.toml",
    f"tune mine.toml {SEARCH}",
    "run mine.toml",
    "ensemble mine.toml --members 3",
    "export mine.toml --as c",
]


@pytest.mark.parametrize(
    ("words", "path", "said"), [(s, *n) for s, n in zip(STUDIES, [*UNKNOWN, *ABSENT], strict=True)]
)
def test_a_number_that_no_study_of_it_has_is_refused_before_anything_is_done(words: str, path: str, said: str) -> None:
    """Expected: exit code 2, the nearest path or the setting that gives the number, and no file."""
    requiring("heave_tolerances", {path: ">= 1"})
    done = invoke(*shlex.split(words), "--out", "out")
    assert done.exit_code == 2, done.output
    assert f"mine.toml: require: the requirement '{path} >= 1'" in done.stderr
    assert re.search(said, done.stderr)
    assert not Path("out").exists()


REMEDIES = [
    ("check", "limits.leg_acceleration_max <= 90 %", "platform.parameters.leg_acceleration_max=50"),
    ("margins", "margins.believed.disk >= 0.1", "plant.parameters.platform_mass=1700"),
]


@pytest.mark.parametrize(("command", "requirement", "setting"), REMEDIES)
def test_an_option_on_such_a_number_is_refused_and_the_setting_that_is_named_gives_it(
    command: str, requirement: str, setting: str
) -> None:
    words = (command, "heave_step", "--require", requirement, "--out", "out")
    done = invoke(*words)
    assert (done.exit_code, Path("out").exists()) == (2, False)
    named = re.search(r"; set ([\w.]+)", done.stderr)
    assert named is not None
    assert setting.startswith(named[1])
    done = invoke(*words, "--set", setting, "--json")
    assert (done.exit_code, list(states(done).values())) == (0, ["met"]), done.output


def test_a_number_that_turns_out_to_be_absent_is_refused_with_the_reason() -> None:
    """Expected: a believed platform whose loop is unstable by its delay, and a machine with heavy drives."""
    settings = ("controller.bandwidth=12", "loop.delay=6", "plant.parameters.leg_armature=5000")
    requiring("heave_step", {"margins.believed.disk": ">= 0.1"})
    done = invoke("margins", "mine.toml", *(word for each in settings for word in ("--set", each)), "--out", "out")
    assert done.exit_code == 2, done.output
    assert "with the believed platform as machine the loop would be unstable" in done.stderr
    assert not Path("out").exists()


def test_a_loop_without_feedback_has_no_margins_to_require() -> None:
    requiring("paper_open_loop", {DISK: ">= 0.1"})
    for command in ("run", "margins"):
        done = invoke(command, "mine.toml", "--out", "out")
        assert (done.exit_code, "an open loop has no margins" in done.stderr) == (2, True)


def test_a_check_has_no_other_numbers_than_those_that_a_file_may_name() -> None:
    """Expected: each number of the report, required without a bound that it misses, is judged and none refused."""
    numbers = {each.path for each in gs.check("heave_step").report(charts=False).numbers}
    requiring("heave_step", dict.fromkeys(numbers, "<= 1e9"))
    done = invoke("check", "mine.toml", "--out", "out", "--json")
    assert states(done) == dict.fromkeys(numbers, "met")
