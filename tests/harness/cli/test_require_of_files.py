"""`[require]` of a file in all commands that study it: each judges its own numbers, and names the others."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

import gough_stewart as gs
from gough_stewart.harness.cli.app import app
from gough_stewart.harness.experiment.checking import PATHS as OF_CHECKS
from gough_stewart.harness.experiment.file import shipped_text
from gough_stewart.harness.experiment.margins import PATHS as OF_MARGINS

# the step of 50 mm is an error of 50 mm at first; the disk margin of this loop is 1.16
_REQUIRE = """
[require]
tracking.position.norm_peak = "<= 51 mm"
step_response.x.settling_time = "<= 1 s"
limits.actuator_force_max = "<= 90 %"
margins.disk = ">= 1.9"
S.peak = "<= 2"
"""


@pytest.fixture(autouse=True)
def _mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.toml").write_text(shipped_text("heave_step") + _REQUIRE, encoding="utf-8")


def _invoke(*arguments: str) -> Result:
    return CliRunner(env={"COLUMNS": "150", "NO_COLOR": "1", "TERM": "dumb"}).invoke(app, list(arguments))


def _states(done: Result) -> dict[str, str]:
    return {each["path"]: each["status"] for each in json.loads(done.stdout).get("requirements", [])}


def _left_out(done: Result) -> set[str]:
    said = (line.removeprefix("not judged by this command: ") for line in done.stderr.splitlines())
    return {line.split()[0] for line in said if "=" in line.split()[1]}


def test_a_run_judges_its_metrics_and_its_disk_margin() -> None:
    """Expected: without a step in x its settling time is inconclusive; one that is missed decides: exit code 3."""
    done = _invoke("run", "mine.toml", "--out", "run", "--json")
    states = {"tracking.position.norm_peak": "met", "step_response.x.settling_time": "open", "margins.disk": "missed"}
    assert (done.exit_code, _states(done)) == (3, states)
    assert _left_out(done) == {"limits.actuator_force_max", "S.peak"}
    assert gs.margins("heave_step").disk.alpha == pytest.approx(
        next(each["value"] for each in json.loads(done.stdout)["numbers"] if each["path"] == "margins.disk")
    )


def test_a_share_of_members_in_a_file_is_for_ensembles_and_a_margin_for_those_that_compute_it() -> None:
    """Expected: named before a run, which goes on; judged in an ensemble; a margin that it lacks is named."""
    shared = 'tracking.position.norm_peak = "<= 1 m for 60 % of members"\nmargins.disk = ">= 0.1"\n'
    Path("mine.toml").write_text(f"{shipped_text('heave_tolerances')}\n[require]\n{shared}", encoding="utf-8")
    short = ("--set", "loop.duration=0.1", "--json")
    done = _invoke("run", "mine.toml", "--out", "run", *short)
    assert (done.exit_code, _states(done), _left_out(done)) == (
        *(0, {"margins.disk": "met"}, {"tracking.position.norm_peak"}),
    )
    done = _invoke("run", "mine.toml", "--member", "1", "--out", "member", *short)
    assert (_states(done), _left_out(done)) == ({}, {"tracking.position.norm_peak", "margins.disk"})
    few = ("--members", "9", "--workers", "1", "--set", "ensemble.worst=0")
    done = _invoke("ensemble", "mine.toml", *few, *short, "--out", "members")
    assert (_states(done), _left_out(done)) == ({"tracking.position.norm_peak": "met"}, {"margins.disk"})
    done = _invoke("ensemble", "mine.toml", *few, *short, "--set", "ensemble.margins=true", "--out", "judged")
    assert _states(done) == {"tracking.position.norm_peak": "met", "margins.disk": "met"}


def test_a_search_judges_what_it_has_chosen() -> None:
    search = ("--vary", "controller.damping_ratio=0.7..0.9", "--minimise", "tracking.position.norm_rms")
    few = ("--generations", "1", "--population", "5", "--set", "loop.duration=0.3", "--out", "tuned", "--json")
    done = _invoke("tune", "mine.toml", *search, *few, "--require", "values.controller.damping_ratio <= 0.1")
    assert done.exit_code == 3, done.output
    states = _states(done)
    assert states.pop("margins.disk") == "missed"
    assert states == {"tracking.position.norm_peak": "met", "values.controller.damping_ratio": "missed"}
    found = {each["path"]: each["value"] for each in json.loads(done.stdout)["numbers"]}
    # the same as a run of the file that was written
    assert found["tracking.position.norm_rms"] == pytest.approx(found["value"])
    assert gs.margins("tuned/tuned.toml").disk.alpha == pytest.approx(found["margins.disk"])


def test_an_export_judges_the_loops_with_the_delay_of_its_forms() -> None:
    """Expected: the margins of the experiment with the one sample of delay that the C has."""
    done = _invoke("export", "mine.toml", "--as", "c", "--out", "out", "--json")
    assert (done.exit_code, _states(done)) == (3, {"margins.disk": "missed"})
    assert _left_out(done) == {
        "tracking.position.norm_peak", "step_response.x.settling_time", "limits.actuator_force_max", "S.peak",
    }  # fmt: skip
    found = {each["path"]: each["value"] for each in json.loads(done.stdout)["numbers"]}
    expected = gs.margins("heave_step", {"loop.delay": 1})
    assert found["margins.disk"] == pytest.approx(expected.disk.alpha)
    assert found["margins.disk_phase"] == pytest.approx(expected.disk.phase)


def test_a_frequency_response_judges_by_the_file_of_its_run() -> None:
    Path("mine.toml").write_text(shipped_text("frequency_response") + _REQUIRE, encoding="utf-8")
    gs.save_record(gs.run("mine.toml", {"loop.duration": 6}), "run")
    done = _invoke("frf", "run", "--json")
    assert (done.exit_code, _states(done)) == (0, {"S.peak": "met"})


@pytest.mark.parametrize(
    "words",
    [
        ("run", "mine.toml"),
        ("check", "mine.toml"),
        ("margins", "mine.toml"),
        ("ensemble", "mine.toml"),
        ("export", "mine.toml", "--as", "c"),
        ("tune", "mine.toml", "--vary", "controller.bandwidth=1..3Hz", "--minimise", "tracking.position.norm_rms"),
    ],
    ids=lambda words: words[0],
)
def test_a_number_that_no_study_has_is_refused_before_anything_is_done(words: tuple[str, ...]) -> None:
    """Expected: exit code 2, the nearest path, no file; a misspelt kind of numbers is no reason to be silent."""
    text = shipped_text("heave_step") + '[require]\ntracking.positoin.norm_peak = "<= 1 mm"\n'
    for wrong, right in (("tracking.positoin", "tracking.position"), ("trakcing.position", "tracking.position")):
        Path("mine.toml").write_text(text.replace("tracking.positoin", wrong), encoding="utf-8")
        done = _invoke(*words, "--out", "out")
        assert done.exit_code == 2
        assert f"'{wrong}.norm_peak'; did you mean '{right}.norm_peak'?" in done.stderr
        assert not Path("out").exists()


def test_the_numbers_of_checks_and_margins_are_all_known() -> None:
    others = {path for path in OF_MARGINS if path.startswith(("structure.", "margins.believed."))}
    assert {each.path for each in gs.margins("mine.toml").report(charts=False).numbers} == {*OF_MARGINS} - others
    gives = gs.margins("mine.toml", {"plant.parameters.leg_stiffness": 1e8}).report(charts=False)
    assert {each.path for each in gives.numbers} == {*OF_MARGINS}
    assert {each.path for each in gs.check("mine.toml").report(charts=False).numbers} <= set(OF_CHECKS)
