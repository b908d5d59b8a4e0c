"""A study of the test's own: declared as all are, shown in all ways, judged, in a folder that it does not share."""

import json
import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner, Result

from gough_stewart.harness.cli.options import argument, option, out_option
from gough_stewart.harness.cli.study import Running, study
from gough_stewart.harness.errors import MissedError, RecordError, UsageError
from gough_stewart.harness.report.chart import Axis, Chart, Series
from gough_stewart.harness.report.document import Note, Number, Report, Section, Verdict
from gough_stewart.harness.report.quantities import LENGTH, NUMBER, TIME
from gough_stewart.harness.report.table import Column, Table

# --- a whole study: a function, its result, its declaration; in fewer than 60 lines ------------------------------


def swing(length: float, periods: int) -> np.ndarray:
    """Times and deflections [s, m] of a pendulum of small amplitude, (2, n)."""
    time = np.linspace(0.0, periods, 101) * 2 * np.pi * np.sqrt(length / 9.81)
    return np.stack([time, 0.01 * length * np.cos(np.sqrt(9.81 / length) * time)])


def swing_report(length: float, path: np.ndarray) -> Report:
    """The report of a pendulum."""
    time, deflection = path
    numbers = (Number("swing.peak", "deflection", deflection.max(), LENGTH), Number("swing.rest", "rest", None, TIME))
    axis = Axis("time", TIME, time)
    charts = (
        Chart("deflection", axis, (Series("bob", LENGTH, deflection),), group="deflection"),
        Chart("energy", axis, (Series("share", NUMBER, (deflection / deflection.max()) ** 2),), group="energy"),
    )
    table = Table("Pendulum", (Column(""), Column("length", LENGTH)), (("rod", length),))
    return Report(
        "pendulum",
        Verdict(f"Swings by {LENGTH.text(deflection.max())}", "good"),
        (Section("Motion", (table, *charts)),),
        study="pendulum",
        numbers=numbers,
        notes=(Note("without air", "warning"),),
    )


@study(numbers=("swing",), figures=("deflection", "energy"))
def pendulum_command(
    running: Running,
    length: float = argument("Length of the rod [m].", "LENGTH"),
    periods: int = option("Number of periods.", "N", default=2, min=1),
    out: Path | None = out_option("pendulum"),
) -> None:
    """Swing a pendulum."""
    running.hold(out or Path("pendulum"), ["swing.csv", "warm.csv"])
    running.step("swinging")
    if length <= 0:
        raise RecordError("no rod")
    path = swing(length, periods)
    running.present(swing_report(length, path), {"swing.csv": path.tobytes()}, then="look")


# -----------------------------------------------------------------------------------------------------------------

app = typer.Typer()
app.command("pendulum")(pendulum_command)


def with_notes(error: Any) -> Any:
    error.add_note("the record is written")
    error.add_note("missing: pose.png")
    return error


# Error, exit code, and what is said.
ERRORS: list[tuple[BaseException, int, str]] = [
    (UsageError("wrong"), 2, "error: wrong"),
    (MissedError("missed"), 3, "error: missed"),
    (with_notes(RecordError("failed")), 1, "error: failed; the record is written; missing: pose.png"),
    (OSError(28, "No space left", "a/b.csv"), 1, "error: a/b.csv: No space left"),
    (OSError("only words"), 1, "error: output: only words"),
    (MemoryError(), 1, "error: not enough memory; make the run shorter, its plant_step longer, or the grid coarser"),
    (KeyboardInterrupt(), 130, "interrupted; nothing written"),
    (with_notes(KeyboardInterrupt()), 130, "interrupted; the record is written; missing: pose.png"),
]


@app.command("other")
@study()
def other_command(running: Running, wrong: int = -1, size: int = 0, out: Path | None = out_option("other")) -> None:
    """Another study."""
    running.hold(out or Path("pendulum"))
    logging.getLogger("gough_stewart.model.process.files").info("removed %d leftovers", 3)
    if wrong >= 0:
        raise ERRORS[wrong][0]
    running.present(Report("other", Verdict("Done", "good"), study="other"), {"x.bin": bytes(size)})


def run(*arguments: str) -> Result:
    return CliRunner(env={"COLUMNS": "120", "NO_COLOR": "1", "TERM": "dumb"}).invoke(app, list(arguments))


def names(folder: str = "pendulum") -> set[str]:
    return {path.name for path in Path(folder).iterdir()}


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_study_is_printed_and_kept_as_data() -> None:
    done = run("pendulum", "1.5")
    assert done.exit_code == 0, done.output
    lines = done.stdout.splitlines()
    assert lines[0] == "Swings by 15 mm"
    assert any(line.startswith("Done in ") and "Wrote to pendulum (" in line for line in lines)
    assert lines[-2:] == ["  swing.csv, report.json", "Next: look"]
    assert done.stderr == "warning: without air\n"
    assert json.loads(Path("pendulum/report.json").read_bytes())["verdict"]["text"] == "Swings by 15 mm"
    assert names() == {"swing.csv", "report.json"}


def test_all_its_options_are_those_of_every_study() -> None:
    """Expected: page and figures as one set, which goes with the next result; --json alone on the standard output."""
    figures = {f"{group}.{kind}" for group in ("deflection", "energy") for kind in ("pdf", "png", "svg")}
    done = run("pendulum", "1.5", "--report", "--figures", "--json", "--require", "swing.peak <= 20 mm")
    assert done.exit_code == 0, done.output
    data = json.loads(done.stdout)
    assert data["verdict"]["text"] == "Met: swing.peak <= 20 mm (15 mm, 5 mm left). Swings by 15 mm"
    assert all(
        text in done.stderr for text in ("Wrote to pendulum", "warning: without air", "report.html in a browser")
    )
    assert names() == {"swing.csv", "report.json", "report.html"} | figures
    Path("pendulum/warm.csv").touch()  # a file that the study may write
    Path("pendulum/mine.txt").touch()  # one that it never writes
    assert run("pendulum", "2").exit_code == 0
    assert names() == {"swing.csv", "report.json", "mine.txt"}


@pytest.mark.parametrize(
    ("requirements", "code", "said"),
    [
        ([], 0, []),
        (["swing.peak <= 20 mm"], 0, []),
        (["swing.peak <= 5 mm"], 3, ["missed: swing.peak <= 5 mm"]),
        (["swing.rest <= 1 s"], 4, ["inconclusive: swing.rest <= 1 s"]),
        (
            ["swing.rest <= 1 s", "swing.peak < 5 mm"],
            3,
            ["inconclusive: swing.rest <= 1 s", "missed: swing.peak < 5 mm"],
        ),
    ],
)
def test_requirements_set_the_exit_code(requirements: list[str], code: int, said: list[str]) -> None:
    done = run("pendulum", "1.5", *(word for text in requirements for word in ("--require", text)))
    assert (done.exit_code, done.stderr.splitlines()) == (code, ["warning: without air", *said])
    kept = json.loads(Path("pendulum/report.json").read_bytes()).get("requirements", [])
    assert [requirement["text"] for requirement in kept] == requirements


@pytest.mark.parametrize(
    ("requirement", "message", "is_before"),
    [
        ("swimg.peak <= 1 mm", "no number 'swimg.peak'; did you mean 'swing'?", True),
        ("swing.peak == 1 mm", "cannot be read; expected PATH <= NUMBER UNIT", True),
        ("swing.peek <= 1 mm", "no number 'swing.peek'; did you mean 'swing.peak'?", False),
        ("swing.peak <= 1 s", "has the unit 's'; expected m, cm, mm", False),
    ],
)
def test_a_wrong_requirement_is_wrong_usage(requirement: str, message: str, is_before: bool) -> None:
    """Expected: exit code 2 and no file; an unknown kind of number before the study begins, so before its own error."""
    done = run("pendulum", "1.5", "--require", requirement)
    assert (done.exit_code, message in done.stderr, Path("pendulum").exists()) == (2, True, False)
    assert ("no rod" in run("pendulum", "0", "--require", requirement).stderr) is not is_before


@pytest.mark.parametrize(("number", "code", "said"), [(k, *case[1:]) for k, case in enumerate(ERRORS)])
def test_an_error_is_one_line_and_an_exit_code_and_leaves_no_folder(number: int, code: int, said: str) -> None:
    done = run("other", "--wrong", str(number), "--json", "--out", "a/b/c")
    assert (done.exit_code, done.stdout, done.stderr) == (code, "", f"removed 3 leftovers\n{said}\n")
    assert not Path("a").exists()


@pytest.mark.parametrize(("size", "said"), [(12300, "12.4 kB"), (2_345_678, "2.3 MB")])
def test_closing_lines_have_time_and_size(size: int, said: str) -> None:
    """Expected: the bytes of all files, with some seventy of report.json."""
    lines = run("other", "--size", str(size)).stdout.splitlines()
    assert any(line.startswith("Done in 0.") and line.endswith(f" s. Wrote to pendulum ({said}):") for line in lines)


def test_a_folder_holds_one_study() -> None:
    """Expected: that of another study is refused, told by report.json or a record, and left as it was."""
    assert run("pendulum", "1.5").exit_code == 0
    before = {path.name: path.read_bytes() for path in Path("pendulum").iterdir()}
    done = run("other")
    assert done.exit_code == 1
    assert "output folder pendulum: it holds the results of `gough-stewart pendulum`; choose another" in done.stderr
    assert {path.name: path.read_bytes() for path in Path("pendulum").iterdir()} == before
    Path("ran").mkdir()
    Path("ran/record.parquet").touch()
    assert "it holds the results of `gough-stewart run`" in run("other", "--out", "ran").stderr
    # a file of another program is no study
    Path("foreign").mkdir()
    for text in ("{", "[1]", '{"study": ""}'):
        Path("foreign/report.json").write_text(text)
        assert run("other", "--out", "foreign").exit_code == 0, text
