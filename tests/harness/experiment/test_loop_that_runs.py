"""Margins held against runs: what they say of clocks, of elastic legs and of the machine is seen there."""

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.commands import invoke

T = 1e-3
# A small step without limits, quantisation and Coulomb friction: the loop is linear.
LINEAR = {
    "reference.position_change": [3e-6, -2e-6, 5e-6],
    "reference.orientation_change": [2e-6, -3e-6, 4e-6],
    "sensors.quantisation.leg_length": 0,
    "actuators.force_limit": "none",
    "platform.parameters.leg_coulomb_friction": 0,
    "loop.duration": 3.0,
}


def growth(settings: Any, **more: Any) -> float:
    """How many times the rate of the legs' errors in the second third of a run is that in the last."""
    rate = np.diff(gs.run("heave_step", LINEAR | settings, **more)["error.leg_length"], axis=0)
    n = len(rate) // 3
    return float(np.linalg.norm(rate[2 * n :]) / np.linalg.norm(rate[n : 2 * n]))


def test_readings_and_jitter_are_their_worst_delay() -> None:
    """Expected: 3 samples of delay for readings every 4; 2 steps of 0.25 ms for readings every 3, and for jitter."""
    of_readings = gs.margins("heave_step", {"sensors.sample_time": 0.004})
    assert of_readings.late == pytest.approx(0.003)
    assert of_readings.as_dict()["margins"] == gs.margins("heave_step", {"loop.delay": 4}).as_dict()["margins"]
    clocks = {"loop.plant_step": 0.00025, "sensors.sample_time": 0.00075}
    with_jitter = gs.margins("heave_step", clocks | {"loop.jitter": 0.0006})
    assert with_jitter.late == pytest.approx(0.001)
    assert with_jitter.disk.alpha == pytest.approx(gs.margins("heave_step", {"loop.delay": 2}).disk.alpha, rel=1e-9)
    quarter = {"loop.plant_step": 0.00025, "loop.jitter": 0.0003}
    part, none = (gs.margins("heave_step", each) for each in (quarter, {}))
    z = np.exp(2j * np.pi * 5 * T)
    ratio = part.loop(z) @ np.linalg.inv(none.loop(z))
    np.testing.assert_allclose(ratio, np.eye(6) * np.exp(-2j * np.pi * 5 * 0.00025), atol=1e-3)
    assert none.common.delay - part.common.delay == pytest.approx(0.00025, rel=2e-2)
    assert "the sensors' own clock and jitter are modelled as their worst delay" in " ".join(
        note.text.lower() for note in part.report(charts=False).notes
    )


@pytest.mark.parametrize(("clock", "bandwidth", "code"), [(0.08, 4, 1), (0.02, 4, 4), (0.01, 4, 3), (0.01, 2, 0)])
def test_a_requirement_on_a_loop_with_slow_readings_is_no_better_than_the_run(
    clock: float, bandwidth: float, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: refused where the run grows; open where it decays but would not with the worst delay; else judged."""
    monkeypatch.chdir(tmp_path)
    settings = {"sensors.sample_time": clock, "controller.bandwidth": bandwidth}
    said: list[str] = []
    grows = growth({**settings, "loop.duration": 1.2}, warn=said.append) > 1
    assert grows == (code == 1) == any("is unstable" in text for text in said)
    options = [part for key, value in settings.items() for part in ("--set", f"{key}={value}")]
    done = invoke("margins", "heave_step", *options, "--require", "margins.disk >= 0.5", catch_exceptions=True)
    assert done.exit_code == code
    if code == 4:
        (number,) = (n for n in gs.margins("heave_step", settings).report().numbers if n.path == "margins.disk")
        assert number.doubt == "without up to 19 ms of delay by the sensors' clock and jitter"
        assert invoke("run", "heave_step", *options, "--require", "margins.disk >= 0.5").exit_code == 4


def test_a_run_says_how_much_its_unstable_loop_grows() -> None:
    """Expected: the growth of its record, between two times that are whole periods of the readings apart."""
    said: list[str] = []
    settings = {"sensors.sample_time": 0.035, "controller.bandwidth": 4, "loop.duration": 1.4}
    record = gs.run("heave_step", LINEAR | settings, warn=said.append)
    (text,) = said
    assert record.metadata["warnings"] == said
    factor = float(re.search(r"grow to ([\d.e+]+) times", text)[1])  # type: ignore[index]
    error = np.linalg.norm(record["error.leg_length"], axis=1)
    early, late = (error[round(at / T) : round((at + 0.07) / T)].max() for at in (0.62, 1.32))
    assert (late / early) ** (1.4 / 0.7) == pytest.approx(factor, rel=0.02)
    assert gs.run("heave_step", LINEAR | {"loop.duration": 0.5}).metadata.get("warnings") in (None, [])


def test_the_slow_growth_of_an_elastic_loop_is_remarked_upon() -> None:
    """Expected: a remark at 1.02 times the gain margin, where errors are below a micrometre; none at 0.98 times."""
    elastic = LINEAR | {"platform.parameters.leg_stiffness": 2e7}
    known = gs.margins("heave_step", elastic)
    gains: Any = known.gains
    for share, count in ((0.98, 0), (1.02, 1)):
        said: list[str] = []
        kp, kd = (share * known.common.gain_up * float(each[0]) for each in (gains.proportional, gains.derivative))
        controller = {"type": "pd", "proportional_gain": kp, "derivative_gain": kd, "feedforward": "gravity"}
        controller["derivative_filter"] = gains.filter_time
        record = gs.run("heave_step", elastic | {"controller": controller}, warn=said.append)
        assert len(said) == count
        assert np.abs(record["error.leg_length"][1000:]).max() < 2e-6


def test_every_command_judges_the_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the disk margin of `gs.margins` for a platform that is the machine, under the believed one's gains."""
    monkeypatch.chdir(tmp_path)
    lighter = ["--set", "plant.parameters.platform_mass=300", "--set", "loop.duration=0.3", "--json"]
    expected = gs.margins("heave_step", {"plant.parameters.platform_mass": 300})
    assert expected.believed is not None
    assert expected.disk.alpha != pytest.approx(expected.believed.disk.alpha, rel=1e-2)
    decibels = math.floor(20 * math.log10(expected.disk.gain[1]))
    commands = (
        ["margins", "heave_step"],
        ["run", "heave_step", "--require", "margins.disk >= 0.1"],
        ["export", "heave_step", "--as", "c"],
        ["tune", "heave_step", "--vary", "controller.damping_ratio=0.79..0.81", "--minimise",
         "tracking.position.norm_rms", "--generations", "1", "--population", "5"],
    )  # fmt: skip
    for command in commands:
        done = invoke(*command, *lighter, "--out", command[0])
        assert done.exit_code == 0, done.output
        found = {each["path"]: each["value"] for each in json.loads(done.stdout)["numbers"]}
        assert command[0] != "run" or f"; {decibels} dB to the disk margin" in done.stdout
        rel = 2e-2 if command[0] == "tune" else 1e-6
        assert found["margins.disk"] == pytest.approx(expected.disk.alpha, rel=rel)


def test_a_requirement_of_a_file_on_a_number_that_was_another_gets_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: one line for each, of the file; none for the command line, or for a number that is what it was."""
    monkeypatch.chdir(tmp_path)
    file = Path("mine.toml")
    shipped = invoke("experiments", "heave_step").stdout
    file.write_text(shipped + '\n[require]\nmargins.delay = ">= 30 ms"\nmargins.disk = ">= 0.5"\n', encoding="utf-8")
    done = invoke("margins", "mine.toml", "--require", "margins.phase >= 30 deg")
    assert done.exit_code == 3
    said = " ".join(done.stderr.split())
    assert said.count("margins.delay is the same delay of all legs; that of one leg alone is margins.leg.delay") == 1
    assert "margins.phase is" not in said
