"""The command `check` as a user meets it."""

import json
import tomllib
from pathlib import Path

import polars
import pytest

from gough_stewart.harness.errors import ReachError
from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.experiment.preparation import prepare
from tests.support.commands import invoke

FILES = {"check.json", "needs.csv", "report.json"}
FIGURES = {"shares.pdf", "shares.png", "shares.svg"}
COARSE = ["--set", "loop.duration=2.5", "--set", "loop.sample_time=25 ms"]
FAST = ["--set", "reference.frequency=4", *COARSE]


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_motion_within_its_limits_is_printed_drawn_and_ends_with_0() -> None:
    done = invoke("check", "pitch_sine", *COARSE, "--figures", "--out", "out")
    assert done.exit_code == 0, done.output
    assert {path.name for path in Path("out").iterdir()} == FILES | FIGURES
    assert done.stdout.startswith("Can be done; leg 3 needs 28 % of its stroke at ")
    assert "leg velocity" in done.output
    text = " ".join(done.output.split())
    assert "Not checked, as the platform states no limit: leg acceleration" in text
    assert max(len(line.rstrip()) for line in done.stdout.splitlines() if "│" in line) <= 80
    numbers = json.loads(Path("out/check.json").read_text())
    assert numbers["within"] is True
    assert len(numbers["limits"]["leg_velocity_max"]["share"]) == 6
    # names of limits are texts in the picture: the legend, and the strip of the active ones
    assert Path("out/shares.svg").read_text().count("<path") > 20


def test_a_motion_beyond_its_limits_ends_with_3_and_says_what_would_fit() -> None:
    done = invoke("check", "pitch_sine", *FAST)
    text = " ".join(done.output.split())
    assert done.exit_code == 3
    assert text.startswith("Cannot be done; leg 3 needs 21")
    assert "times as long (--fit time)" in text
    assert "times as large (--fit amplitude)" in text
    assert {path.name for path in Path("results/check_pitch_sine").iterdir()} == FILES


def test_a_fitted_experiment_is_written_beside_and_checked_and_can_be_prepared() -> None:
    """Expected: the shipped file with the settings and the scale; its motion, which was refused, is taken."""
    done = invoke("check", "pitch_sine", *FAST, "--fit", "amplitude")
    assert done.exit_code == 0, done.output
    assert "Wrote pitch_sine-fitted.toml (" in done.output
    values = tomllib.loads(Path("pitch_sine-fitted.toml").read_text())
    assert values["reference"]["frequency"] == 4
    new = set(values["reference"]) - {"type", "orientation_amplitude", "frequency", "fade_in"}
    assert new == {"amplitude_scale"}
    assert list(Path().glob(".*")) == []
    slow = ["controller.bandwidth=0.1"]
    with pytest.raises(ReachError):
        prepare(load_experiment("pitch_sine", [*FAST[1::2], *slow]))
    prepare(load_experiment("pitch_sine-fitted.toml", slow))


def test_a_platform_without_limits_gets_its_needs_and_no_word_that_all_limits_are_kept() -> None:
    """Expected: the table in the terminal, in a file with a row for each leg, and in the record, the same numbers."""
    done = invoke("check", "pitch_sine", "--set", "platform.preset=liu2000", *COARSE, "--out", "out")
    assert done.exit_code == 0, done.output
    text = " ".join(done.output.split())
    assert text.startswith("Can be done as far as is known: the platform states no limit of its legs")
    missing = "stroke, joint angle, leg velocity, leg acceleration, force and power"
    assert f"Not checked, as the platform states no limit: {missing}" in text
    assert "the platform states no friction" in text
    table, numbers = polars.read_csv("out/needs.csv"), json.loads(Path("out/check.json").read_text())
    stated_by_none = ["stroke", "joint_angle_max", "leg_velocity_max", "leg_acceleration_max"]
    assert numbers["not_stated"] == [*stated_by_none, "actuator_force_max", "actuator_power_max"]
    assert table["leg"].to_list() == [1, 2, 3, 4, 5, 6]
    assert list(table.columns[1:]) == [f"{name} [{need['unit']}]" for name, need in numbers["needs"].items()]
    for column, need in zip(table.columns[1:], numbers["needs"].values(), strict=True):
        assert table[column].to_list() == pytest.approx(need["of_leg"], rel=1e-12)
    assert f"{max(numbers['needs']['actuator_force_peak']['of_leg']):.3g}" in text
    assert max(len(line.rstrip()) for line in done.stdout.splitlines() if "│" in line) <= 80


def test_what_nothing_fits_ends_with_an_error_and_no_file() -> None:
    heavy = ["--set", "platform.parameters.platform_mass=20000"]
    done = invoke("check", "pitch_sine", *heavy, "--fit", "time", *COARSE)
    assert done.exit_code == 1
    assert "no time_scale makes the motion fit" in done.output
    assert not Path("pitch_sine-fitted.toml").exists()
