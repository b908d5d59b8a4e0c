"""The command `identify`: several logs, held forces, validation apart, alarms, and what a motion does not excite."""

import json
import shlex
from pathlib import Path

import numpy as np

from tests.support.commands import invoke
from tests.support.machine_logs import HEAVE, Course, Sensing, Swing, machine_log, save_log

NAMES = "platform_mass,platform_com,leg_armature,leg_viscous_friction,leg_coulomb_friction"


def test_several_logs_are_fitted_another_validates_and_what_is_missing_is_proposed(tmp_path: Path) -> None:
    """Expected: of heave alone the height of the centre of mass is null, and a command that runs proposes a motion.

    The forces are those of the middle of each sample, as of a sampled controller: half a row late if not said.
    """
    slow, fast = (Course(Swing(axes=HEAVE.axes, size=size)) for size in (0.04, 0.06))
    late = Sensing(delay=-0.5e-3)
    logs = [save_log(machine_log(course=slow, sensing=late, seed=1), tmp_path / "slow.csv")]
    logs += [save_log(machine_log(course=fast, sensing=late, seed=2), tmp_path / "fast.csv")]
    aside = save_log(machine_log(course=slow, sensing=late, seed=3), tmp_path / "aside.csv")
    options = ("--preset", "motion_base", "--estimate", NAMES, "--out", str(tmp_path / "out"))
    done = invoke("identify", *logs, "--validate", aside, "--holds-force", *options)
    assert done.exit_code == 0, done.stderr
    found = json.loads((tmp_path / "out" / "estimate.json").read_text("utf-8"))
    assert found["parameters"]["platform_com[3]"]["value"] is None
    assert (
        found["parameters"]["platform_mass"]["interval"][0]
        < 1516.9
        < found["parameters"]["platform_mass"]["interval"][1]
    )
    assert found["alarms"] == []
    np.testing.assert_allclose(found["residuals"]["validation_rms"], found["residuals"]["rms"], rtol=0.3)
    assert "not excited" in done.stdout
    (next_line,) = (line for line in done.stdout.splitlines() if line.startswith("Next: "))
    proposed = shlex.split(next_line.removeprefix("Next: gough-stewart "))
    assert proposed == ["excite", "--preset", "motion_base", "--estimate", NAMES]


def test_a_log_that_contradicts_the_model_is_written_with_an_alarm_and_exit_code_3(tmp_path: Path) -> None:
    """Expected: files, the alarm on the terminal, in the numbers and on the page; one leg's forces read 2 % high."""
    wrong = Sensing(force_gain=(1.02, 1.0, 1.0, 1.0, 1.0, 1.0))
    log = save_log(machine_log(course=Course(duration=6.0), sensing=wrong), tmp_path / "log.csv")
    options = ("--preset", "motion_base", "--estimate", f"{NAMES},platform_inertia", "--out", str(tmp_path / "out"))
    done = invoke("identify", log, "--validation", "0.3", "--report", *options)
    assert done.exit_code == 3
    assert "warning: the log contradicts the model" in done.stderr
    found = json.loads((tmp_path / "out" / "estimate.json").read_text("utf-8"))
    assert len(found["alarms"]) == 1
    assert found["diagnosis"]["alarm"]
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert '<p class="verdict bad">' in page
    assert (tmp_path / "out" / "platform.toml").is_file()


def test_validation_is_a_share_or_a_log(tmp_path: Path) -> None:
    options = ("--estimate", "platform_mass", "--out", str(tmp_path / "out"))
    done = invoke("identify", "a.csv", "--validate", "b.csv", "--validation", "0.2", *options)
    assert done.exit_code == 2
    assert "--validate and --validation exclude each other" in done.stderr
    log = save_log(machine_log(course=Course(duration=2.0)), tmp_path / "log.csv")
    done = invoke("identify", log, "--preset", "motion_base", "--validation", "1.5", *options)
    assert done.exit_code == 1
    assert "validation is 1.5; expected a share of the log" in done.stderr
    assert not (tmp_path / "out").exists()
