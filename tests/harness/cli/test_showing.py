"""What every command can do with its report: its options on a command of the test's own."""

import json
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner, Result

from gough_stewart.harness.cli.command import clear_errors
from gough_stewart.harness.cli.exit_codes import ExitCode
from gough_stewart.harness.cli.showing import Showing, shows
from gough_stewart.harness.cli.terminal import Terminal
from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.report.codec import from_json
from gough_stewart.harness.report.document import Note, Number, Report, Section, Verdict
from gough_stewart.harness.report.quantities import LENGTH, TIME
from gough_stewart.harness.report.table import Column, Table

_PEAK = "tracking.position.norm_peak"
_DOCUMENT = Report(
    "heave",
    Verdict("Follows within 0.8 mm", "good"),
    (Section("Metrics", (Table("Errors", (Column("axis"), Column("peak", LENGTH)), (("x", 8e-4),)),)),),
    study="test",
    numbers=(Number(_PEAK, "peak error", 8e-4, LENGTH), Number("settling", "settling time", None, TIME)),
    notes=(Note("near its stroke", "warning"),),
)


def _invoke(*arguments: str, code: ExitCode = ExitCode.DONE, more: Any = ()) -> Result:
    app = typer.Typer()

    @app.command()
    @shows
    def command(name: str, showing: Showing) -> None:
        with clear_errors() as running:
            requirements = showing.requirements(more, _DOCUMENT.numbers)
            Terminal().say("text beside it")
            folder = Path(name)
            folder.mkdir(exist_ok=True)
            (folder / "own.csv").write_bytes(b"1")
            if code is ExitCode.FAILED:
                raise RecordError("no rows")
            showing.present(running, _DOCUMENT, folder, ["own.csv"], requirements=requirements, then="look")

    return CliRunner(env={"COLUMNS": "120", "NO_COLOR": "1", "TERM": "dumb"}).invoke(app, list(arguments))


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_the_report_is_printed_and_kept_as_data() -> None:
    done = _invoke("out")
    assert done.exit_code == 0
    assert done.stdout.splitlines()[:2] == ["text beside it", "Follows within 0.8 mm"]
    assert "Done in " in done.stdout
    assert "Wrote to out" in done.stdout
    assert "own.csv, report.json" in done.stdout
    assert "Next: look" in done.stdout
    assert done.stderr == "warning: near its stroke\n"
    assert from_json(Path("out/report.json").read_bytes()).verdict.text == "Follows within 0.8 mm"
    assert sorted(path.name for path in Path("out").iterdir()) == ["own.csv", "report.json"]


def test_with_json_the_standard_output_is_the_report_alone() -> None:
    done = _invoke("out", "--json", "--require", f"{_PEAK} <= 1 mm")
    assert done.exit_code == 0
    data = json.loads(done.stdout)
    met = f"Met: {_PEAK} <= 1 mm (0.8 mm, 0.2 mm left). Follows within 0.8 mm"
    assert (data["verdict"]["text"], data["requirements"][0]["status"]) == (met, "met")
    assert all(each in done.stderr for each in ("text beside it", "Wrote to out", "warning: near its stroke"))
    # only while it lasts
    assert _invoke("out").stdout.startswith("text beside it")


@pytest.mark.parametrize(
    ("requirements", "code", "said"),
    [
        ([f"{_PEAK} <= 1 mm"], 0, []),
        ([f"{_PEAK} <= 0.5 mm"], 3, [f"missed: {_PEAK} <= 0.5 mm"]),
        (["settling <= 1 s"], 4, ["cannot be told: settling <= 1 s"]),
        (["settling <= 1 s", f"{_PEAK} < 0.5 mm"], 3, ["cannot be told: settling <= 1 s", f"missed: {_PEAK} < 0.5 mm"]),
    ],
)
def test_requirements_set_the_exit_code(requirements: list[str], code: int, said: list[str]) -> None:
    options = [word for each in requirements for word in ("--require", each)]
    for done in (_invoke("out", *options), _invoke("out", more=requirements)):
        assert done.exit_code == code
        assert done.stderr.splitlines() == ["warning: near its stroke", *said]
        assert [each.text for each in from_json(Path("out/report.json").read_bytes()).requirements] == requirements


@pytest.mark.parametrize(
    ("requirement", "message"),
    [
        ("tracking.position.norm_peek <= 1 mm", f"no number 'tracking.position.norm_peek'; did you mean '{_PEAK}'?"),
        (f"{_PEAK} == 1 mm", "cannot be read; expected PATH <= NUMBER UNIT"),
        (f"{_PEAK} <= 1 s", "has the unit 's'; expected m, cm, mm"),
    ],
)
def test_a_wrong_requirement_is_wrong_usage(requirement: str, message: str) -> None:
    done = _invoke("out", "--require", requirement)
    assert done.exit_code == 2
    assert message in done.stderr
    # refused before the command has begun
    assert "text beside it" not in done.stdout


def test_an_error_of_the_command_is_one_line() -> None:
    done = _invoke("out", "--json", code=ExitCode.FAILED)
    assert (done.exit_code, done.stdout, done.stderr) == (1, "", "text beside it\nerror: no rows\n")
