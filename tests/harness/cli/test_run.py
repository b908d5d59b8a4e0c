"""The commands of the closed loop as a user meets them."""

import os
from pathlib import Path

import pytest

from gough_stewart import GoughStewartError, read_record
from tests.support.commands import invoke


def test_a_folder_without_permission_is_refused_before_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    done = invoke("run", "heave_step", "--out", str(tmp_path / "out"))
    assert done.exit_code == 1
    assert "no permission to write" in done.output


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with an experiment that names a Python file and one that names an FMU, which mark what they do."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "law.py").write_text(
        "import pathlib\npathlib.Path('mark').touch()\ncontroller = lambda sample: [4078.57] * 6\n"
    )
    head = 'title = "own"\nplatform.preset = "motion_base"\nreference.type = "hold"\nloop.duration = 0.005\n'
    (tmp_path / "heave_step.toml").write_text(head + 'controller = {type = "python", file = "law.py"}')
    (tmp_path / "unit.toml").write_text(
        head + 'controller.type = "open_loop"\nplant = {kind = "fmu2", fmu = "unit.fmu"}'
    )
    return tmp_path


_LAW, _UNIT = "executes law.py, named by both.toml\n", "executes unit.fmu, named by both.toml\n"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("run", "both.toml"), _LAW + _UNIT),
        (("run", "both.toml", "--plant", "fmu2"), _LAW + _UNIT),
        (("run", "both.toml", "--plant", "fmu3"), _LAW),
        (("run", "both.toml", "--plant", "model"), _LAW),
        (("run", "both.toml", "--fmu", "mine.fmu"), _LAW),
        (("run", "both.toml", "--controller", "fmu3"), _LAW + _UNIT),
        (("run", "both.toml", "--controller", "mine.fmu"), _UNIT),
        (("run", "both.toml", "--member", "0"), _LAW),
        (("run", "both.toml", "--member", "0", "--plant", "fmu2"), _LAW + _UNIT),
        (("run", "both.toml", "--member", "0", "--fmu", "mine.fmu"), _LAW),
        (("margins", "both.toml"), _LAW),
        (("frf", "record", "--experiment", "both.toml"), _LAW),
        (("export", "both.toml"), _LAW),
        (("ensemble", "both.toml"), _LAW),
        (("ensemble", "heave_tolerances", "--compare", "both.toml"), _LAW),
        (("tune", "both.toml", "--vary", "controller.x=1..2", "--minimise", "force.peak"), _LAW),
        (("identify", "log.csv", "--estimate", "platform_mass", "--experiment", "both.toml"), _LAW + _UNIT),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_what_is_executed_is_announced_and_nothing_else(
    arguments: tuple[str, ...], said: str, own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: the law of designs, runs and members; the unit only of a run that simulates it.

    What is announced is also what --no-python refuses. No command gets any further here.
    """
    text = (own / "unit.toml").read_text().replace('controller.type = "open_loop"', "")
    (own / "both.toml").write_text(text + '\ncontroller = {type = "python", file = "law.py"}\n')

    class HereError(GoughStewartError):
        pass

    def stop(*_: object, **__: object) -> None:
        raise HereError("so far")

    room = "gough_stewart.harness"
    for place in (
        *("experiment.run.run", "experiment.margins.margins", "experiment.frf.frf", "export.export.export"),
        *("export.fmu.exported_controller", "ensemble.ensemble.ensemble", "ensemble.compare.run_compared"),
        *("tuning.tune.tune", "identify.log.read_log"),
    ):
        monkeypatch.setattr(f"{room}.{place}", stop)
    done = invoke(*arguments)
    announced = "".join(line for line in done.stderr.splitlines(keepends=True) if line.startswith("executes"))
    assert announced == said, done.output
    assert "so far" in done.stderr
    if arguments[0] != "frf":  # has no such option: only who names an experiment has code executed
        files = ", ".join(line.split()[1].removesuffix(",") for line in said.splitlines())
        assert f"both.toml: executes {files}; omit --no-python" in invoke(*arguments, "--no-python").stderr
    assert not (own / "mark").exists()


def test_a_file_with_the_name_of_a_shipped_experiment_has_a_folder_of_its_own(own: Path) -> None:
    """Expected: results/run_NAME for what ships and for files, but for one whose name ships as well."""
    done = invoke("run", "heave_step.toml")
    assert done.exit_code == 0, done.output
    (own / "mine.toml").write_text((own / "heave_step.toml").read_text())
    assert invoke("run", "mine.toml").exit_code == 0
    assert invoke("run", "heave_step", "--set", "loop.duration=0.3").exit_code == 0
    assert {path.name for path in (own / "results").iterdir()} == {"run_heave_step", "run_heave_step.toml", "run_mine"}
    assert read_record(own / "results" / "run_heave_step").metadata["title"] != "own"


def test_figures_that_fail_cost_no_record(own: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the record first of all, what is missing named, and no figure of the run before."""
    short = ("run", "heave_step", "--set", "loop.duration=0.3", "--figures", "--out", "out")
    assert invoke(*short).exit_code == 0

    def fails(*_: object) -> None:
        raise OSError(28, "No space left on device", "out/pose.png")

    monkeypatch.setattr("gough_stewart.harness.experiment.run.metrics_json", fails)
    done = invoke(*short)
    assert done.exit_code == 1
    assert "No space left on device; out has record.parquet" in done.output
    assert "missing: metrics.json, errors.pdf" in done.output
    assert {path.name for path in (own / "out").iterdir()} == {"record.parquet", "record.csv", "metadata.json"}
    assert read_record(own / "out").metadata["rows"] == 301
