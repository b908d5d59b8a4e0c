"""Values that can hardly be meant: refused where a number would come out of nothing, else hinted at."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.errors import ControllerError, ReachError
from gough_stewart.harness.experiment.files import warnings_of
from tests.support.commands import invoke


@pytest.mark.parametrize(
    ("settings", "names"),
    [
        ({"sensors.quantisation.leg_length": "10 m"}, ["sensors.quantisation.leg_length is 10 m"]),
        ({"sensors.noise.position": "5 m"}, ["sensors.noise.position is 5 m"]),
        (
            {"sensors.noise.orientation": "20 deg", "sensors.quantisation.leg_velocity": "9 m/s"},
            ["sensors.noise.orientation is 0.349", "sensors.quantisation.leg_velocity is 9 m/s"],
        ),
        ({"sensors.noise.leg_length": "1 mm", "sensors.quantisation.orientation": "1 deg"}, []),
    ],
)
def test_sensors_as_coarse_as_the_platform_are_hinted_at(settings: dict[str, Any], names: list[str]) -> None:
    """Legs are 3.15 m long; a coarse but usable sensor stays without a hint."""
    said: list[str] = []
    record = gs.run("heave_step", {"loop.duration": 0.02, "reference.at": 0.01, **settings}, warn=said.append)
    assert len(said) == len(names)
    for name, line in zip(names, said, strict=True):
        assert line.startswith(name)
    assert record.metadata.get("warnings", []) == said


def test_a_step_after_the_end_is_hinted_at_and_refused_in_tune() -> None:
    """A search would find a best bandwidth for a platform that stays at rest."""
    late = {"loop.duration": 0.02, "reference.at": "0.02 s"}
    said: list[str] = []
    gs.run("heave_step", late, warn=said.append)
    assert said == ["reference.at is 0.02 s in a run of 0.02 s, so nothing moves; set it earlier, or run longer"]
    with pytest.raises(gs.GoughStewartError, match=r"reference\.at is 0\.02 s .* nothing moves"):
        gs.tune("heave_step", ["controller.bandwidth=1..6Hz"], "tracking.position.norm_rms", settings=late)


def test_a_search_for_an_excitation_tries_at_least_one_motion() -> None:
    with pytest.raises(gs.GoughStewartError, match="trials is 0; expected at least 1 motion to try"):
        gs.excite(gs.load_preset("motion_base"), trials=0)


def test_margins_do_not_depend_on_how_fast_the_reference_is() -> None:
    """The loop is linearised at the reference's first pose, which is the same."""
    fast = {"reference.frequency": "20 Hz"}
    with pytest.raises(ReachError):
        gs.run("pitch_sine", fast)
    assert gs.margins("pitch_sine", fast).as_dict() == gs.margins("pitch_sine").as_dict()


def test_gains_below_zero_are_refused_where_they_are_written() -> None:
    """A negative gain is positive feedback."""
    for gains in ({"proportional_gain": -1, "derivative_gain": 1}, {"proportional_gain": 1, "derivative_gain": -1}):
        with pytest.raises(ControllerError, match="expected finite numbers"):
            gs.PD(**gains)  # type: ignore[arg-type]


@pytest.mark.parametrize("space", ["leg", "task"])
def test_a_platform_that_hangs_below_its_reference_is_explained(space: str) -> None:
    """In leg space the error of each leg is its static force over its gain, here from Newton's wrench balance."""
    settings = {"controller.feedforward": "none", "controller.space": space, "loop.duration": 5}
    record = gs.run("heave_step", settings)
    warnings = warnings_of(record)
    assert len(warnings) == 1
    found = re.match(r"the platform hangs ([\d.]+) mm below its reference at the end", warnings[0])
    assert found is not None
    platform = gs.load_preset("motion_base")
    J = gs.leg_jacobian(platform, record["position"][-1], record["orientation"][-1])
    force = gs.static_leg_forces(platform, record["position"][-1], record["orientation"][-1])
    gains = np.asarray(gs.margins("heave_step", settings).gains.proportional)  # type: ignore[union-attr]
    pose = np.linalg.solve(J, force / gains) if space == "leg" else J.T @ force / gains
    assert float(found[1]) == pytest.approx(1000 * pose[2], rel=0.03)


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"controller.feedforward": "none", "loop.duration": 0.5},  # still moving
    ],
)
def test_what_is_no_static_error_is_not_called_one(settings: dict[str, Any]) -> None:
    """With its feedforward there is none; and a platform in motion has not settled."""
    assert not [each for each in warnings_of(gs.run("heave_step", settings)) if "reference at the end" in each]


def test_over_ensemble_without_an_ensemble_is_refused() -> None:
    """There would be no machines that differ."""
    wrong = "tune heave_step --vary controller.bandwidth=1..6Hz --minimise tracking.position.norm_rms"
    outcome = invoke(*wrong.split(), "--over-ensemble", "quantile=0.95")
    assert outcome.exit_code == 2
    assert "heave_step has no [ensemble]" in " ".join(outcome.output.split())


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A home folder, and another current one."""
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path / "elsewhere")
    return tmp_path


def test_a_tilde_that_the_shell_left_is_the_home_folder(home: Path) -> None:
    """Shells expand it at the beginning of a word alone, not in --out=~/x."""
    outcome = invoke("run", "heave_step", "--set", "loop.duration=0.3", "--out=~/mine")
    assert outcome.exit_code == 0, outcome.output
    assert (home / "mine" / "record.csv").is_file()
    assert not list((home / "elsewhere").iterdir())


def test_wildcards_in_a_folder_s_name_are_letters(tmp_path: Path) -> None:
    """An ensemble in `e?` beside one in `e2`: its own members, no neighbours'."""
    keys = {"loop.duration": 0.01}
    gs.ensemble("heave_tolerances", keys, members=4, seed=3, out=tmp_path / "e2", workers=1)
    beside = gs.ensemble("heave_tolerances", keys, members=6, seed=5, out=tmp_path / "e?", workers=1)
    alone = gs.ensemble("heave_tolerances", keys, members=6, seed=5, workers=1)
    assert beside.members.equals(alone.members)
    assert gs.read_ensemble(tmp_path / "e?").members.height == 6


def test_a_frozen_signal_that_nobody_reads_is_hinted_at() -> None:
    """A leg-space PD reads lengths, an open loop nothing; a signal that is read has no hint."""
    faults = [{"at": 0.01, "freeze": {"leg_length": [1], "position": [2]}}, {"at": 0, "freeze": {"leg_velocity": [1]}}]
    said: list[str] = []
    gs.run("heave_step", {"loop.duration": 0.02, "reference.at": 0.01, "fault": faults}, warn=said.append)
    assert [line.split(":")[0] for line in said] == ["fault.1.freeze.position", "fault.2.freeze.leg_velocity"]
    assert said[0].endswith("so this changes nothing; the controller reads leg_length")
    said.clear()
    gs.run("paper_open_loop", {"loop.duration": 0.02, "fault": faults[:1]}, warn=said.append)
    assert [line.rpartition("; ")[2] for line in said] == ["the controller reads no sensor"] * 2
