"""Controllers from Python files in ensembles and searches: their parameters, their files, and who else runs them."""

import json
from pathlib import Path
from typing import Any

import pytest

import gough_stewart as gs
from tests.harness.ensemble.memory import BESIDE, EXPERIMENT, FILE, RMS, SHORT, WAYS, Pid
from tests.support.commands import invoke
from tests.support.metric_definitions import as_one_number

KP = "controller.parameters.kp"
CONTROLLER = """[controller]
type = "python"
file = "pid.py"
name = "Pid"
feedforward = "computed_torque"
[controller.parameters]
kp = 70000  # by hand
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """An experiment beside its controller, which has a module and a file of numbers beside it."""
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "pid.py").write_text(FILE + "\nnp.loadtxt('table.csv')\n")
    (folder / "legs.py").write_text(BESIDE)
    (folder / "table.csv").write_text("1\n")
    before, _, after = invoke("experiments", EXPERIMENT).stdout.partition("[controller]")
    path = folder / "mine.toml"
    path.write_text(f"{before}{CONTROLLER}[loop]{after.partition('[loop]')[2]}")
    return path


def test_parameters_vary_in_an_ensemble_and_by_set(file: Path) -> None:
    """Expected: member k of a grid is the single member with that value set; the table has the column."""
    values = [6e4, 8e4, 9e4]
    only = {"members": 3, "seed": 1, "controller": {"parameters": {"kp": {"grid": values}}}}
    found = gs.ensemble(file, {**SHORT, "ensemble": only}, workers=1)
    assert found.members[f"varied.{KP}"].to_list() == values
    for k, kp in enumerate(values):
        record = gs.run(file, {**SHORT, "ensemble": only, KP: kp}, member=k)
        assert as_one_number(gs.metrics(record))[RMS] == pytest.approx(found.values(RMS)[k], rel=1e-12)
    assert len(set(found.values(RMS))) == 3
    around = {**only, "controller": {"parameters": {"kp": {"factor": {"uniform": [0.9, 1.1]}}}}}
    drawn = gs.ensemble(file, {**SHORT, "ensemble": around}, workers=1).values(KP)
    assert ((drawn > 0.9 * 7e4) & (drawn < 1.1 * 7e4)).all()
    text = {**only, "controller": {"parameters": {"word": {"choice": [1, 2]}}}}
    with pytest.raises(gs.GoughStewartError, match="class Pid accepts kp, kd; found 'word'"):
        gs.ensemble(file, {**SHORT, "ensemble": text}, workers=1)
    with pytest.raises(gs.GoughStewartError, match=r"controller\.name: is common to all members"):
        gs.ensemble(file, {**SHORT, "ensemble": {**only, "controller": {"name": {"choice": ["a", "b"]}}}})


def test_the_file_is_executed_once_for_all_members(file: Path) -> None:
    """Expected: one line for a run or an ensemble: not for members, copies, checks, or twice for one."""
    pid, log = file.parent / "pid.py", file.parent / "log"
    pid.write_text(f"{pid.read_text()}\nwith open('log', 'a') as opened:\n    print('executed', file=opened)\n")

    def executed() -> int:
        lines = len(log.read_text().splitlines())
        log.unlink()
        return lines

    gs.run(file, SHORT)
    assert executed() == 1
    gs.ensemble(file, SHORT, members=9, workers=1)
    assert executed() == 1
    gs.run(file, SHORT, member=4)
    assert executed() == 1


def test_parameters_are_searched_and_written(file: Path, tmp_path: Path) -> None:
    """Expected: the value of the written file, run for the same members, is the value that the search says."""
    out, settings = tmp_path / "out", {**SHORT, "ensemble.members": 2}
    words = [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]
    few = ("--fresh=1", "--generations=1", "--population=5", "--over-ensemble=quantile=1", f"--out={out}")
    done = invoke("tune", str(file), "--vary", f"{KP}=5e4..9e4", "--minimise", RMS, *words, *few)
    assert done.exit_code == 0, done.stderr
    found = json.loads((out / "tuning.json").read_text())
    assert 5e4 <= found["values"][KP] <= 9e4
    again = gs.ensemble(out / "tuned.toml", workers=1)
    assert again.values(RMS).max() == found["seen"]["value"]
    assert b"# by hand" in (out / "tuned.toml").read_bytes()


def test_a_controller_that_no_file_names_has_to_be_given() -> None:
    own = {"type": "python", "feedforward": "computed_torque", "parameters": {"kp": 7e4}}
    with pytest.raises(gs.GoughStewartError, match="file is missing; add the Python file of the controller, or give"):
        gs.run(EXPERIMENT, {**SHORT, "controller": own})


def interrupted(experiment: Path | str, out: Path, controller: Any = None) -> None:
    """An ensemble of two members whose only chunk is finished, but not its tables."""

    def stop(*_: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        gs.ensemble(experiment, SHORT, controller=controller, members=2, workers=1, out=out, progress=stop)


def test_a_changed_neighbour_is_not_gone_on_with(file: Path, tmp_path: Path) -> None:
    """Expected: --resume names the module beside the controller, and the table that it names, not a file aside."""
    out = tmp_path / "out"
    interrupted(file, out)
    (file.parent / "aside.py").write_text("unused = 1")
    for name in ("legs.py", "table.csv"):
        text = (file.parent / name).read_text()
        (file.parent / name).write_text(f"{text}\n")
        with pytest.raises(gs.GoughStewartError, match=rf"another experiment: files\.{name}"):
            gs.ensemble(file, SHORT, members=2, workers=1, out=out, resume=True)
        (file.parent / name).write_text(text)
    whole = gs.ensemble(file, SHORT, members=2, workers=1, out=out, resume=True)
    assert whole.members.equals(gs.ensemble(file, SHORT, members=2, workers=1).members, null_equal=True)


def test_records_of_the_worst_are_not_made_with_files_that_the_run_has_changed(file: Path, tmp_path: Path) -> None:
    """Expected: its name, of a table that grows with each controller that is made."""
    pid = file.parent / "pid.py"
    start = "self.integral = np.zeros(6)"
    grows = "with open('table.csv', 'a') as table: table.write('1')"
    pid.write_text(pid.read_text().replace(start, f"{start}\n        {grows}"))
    words = [word for key, value in SHORT.items() for word in ("--set", f"{key}={value}")]
    few = ("--members", "2", "--workers", "1", "--out", str(tmp_path / "out"))
    done = invoke("ensemble", str(file), *words, *few, catch_exceptions=True)
    assert done.exit_code != 0
    said = " ".join(f"{done.output} {done.stderr} {done.exception}".split())
    assert "names table.csv, which has changed since the run began" in said


def test_another_controller_from_python_is_not_gone_on_with(tmp_path: Path) -> None:
    """Expected: with other gains or none it is refused; with the same class it goes on; files say that it was there."""
    interrupted(EXPERIMENT, tmp_path, Pid)
    for other in (None, WAYS["object"](), WAYS["factory"]()):
        with pytest.raises(gs.GoughStewartError, match=r"another experiment: controller is .* here and 'class Pid, "):
            gs.ensemble(EXPERIMENT, SHORT, controller=other, members=2, workers=1, out=tmp_path, resume=True)
    found = gs.ensemble(EXPERIMENT, SHORT, controller=Pid, members=2, workers=1, out=tmp_path, resume=True)
    assert found.values(RMS).shape == (2,)
    # its records cannot be made from the files alone
    with pytest.raises(gs.GoughStewartError, match=r"another experiment: controller is .* here and 'class Pid, "):
        gs.ensemble(EXPERIMENT, SHORT, members=2, workers=1, out=tmp_path, resume=True)
