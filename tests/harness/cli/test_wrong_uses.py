"""Wrong and clumsy uses of the command line: the exit code, and what the one line says."""

import re
from pathlib import Path

import pytest

from gough_stewart.harness.cli.exit_codes import ExitCode
from tests.support.commands import invoke

TUNE = ("tune", "heave_step", "--minimise", "tracking.position.norm_rms")
BANDWIDTH = ("--vary", "controller.bandwidth=1..6Hz")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("presets", "nope"), "no such preset; expected one of desktop_hexapod"),
        (("experiments", "nope"), "no such experiment; expected one of circle"),
        (("workspace", "--preset", "nope"), "no such preset; expected one of desktop_hexapod"),
        (("build", "--target", "nope"), "no target 'nope'; expected native, all"),
        (("export", "heave_step", "--target", "nope"), "no target 'nope'; expected native, all"),
        (("export", "heave_step", "--as", "nope"), "no form 'nope'; expected one of fmu, c, ssp"),
        ((*TUNE, "--vary", "x"), r"--vary x: expected KEY=LOW\.\.HIGH"),
        ((*TUNE, "--vary", "controller.nope=1..2"), r"controller\.nope: .*did you mean|unknown|no such|no key"),
        ((*TUNE, *BANDWIDTH, "--subject-to", "stroke.margin"), "cannot be read; expected METRIC < NUMBER"),
        (("tune", "heave_step", *BANDWIDTH, "--minimise", "nope"), "--minimise: no metric 'nope'"),
        (("run", "heave_step", "--set", "x"), "--set x"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_wrong_usage_is_exit_code_2(arguments: tuple[str, ...], says: str) -> None:
    done = invoke(*arguments)
    assert (done.exit_code, ExitCode.USAGE) == (2, 2)
    assert re.search(says, done.stderr), done.stderr
    assert done.stderr.count("\n") <= 2


def test_the_documentation_has_the_table_of_exit_codes() -> None:
    """Expected: its rows have the codes and meanings of the one place that declares them; no other page has a table."""
    docs = Path(__file__).parents[3] / "docs"
    rows = re.findall(r"^\| (\d+) \| ([^|]+) \|", (docs / "control.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert [(int(code), meaning) for code, meaning in rows[: len(ExitCode)]] == [
        (int(code), code.meaning) for code in ExitCode
    ]


def test_an_ensemble_in_which_all_fail_is_exit_code_3(tmp_path: Path) -> None:
    """Expected: its files, and one line with the number and a cause."""
    settings = ("limits.position_error=1e-6", "limits.reference=ignore")[:1]
    arguments = [part for each in settings for part in ("--set", each)]
    done = invoke(
        "ensemble", "heave_tolerances", "--members", "4", "--workers", "1", *arguments, "--out", str(tmp_path)
    )
    assert done.exit_code == ExitCode.MISSED, done.stderr
    assert re.search(
        "none of 4 members completed its run; the first: the platform is .* from its reference; the limit is 1e-06 m",
        done.stderr,
    )
    assert (tmp_path / "members.parquet").is_file()


def test_a_search_without_a_candidate_is_exit_code_3(tmp_path: Path) -> None:
    conditions = ("--subject-to", "stroke.margin > 100 m", "--set", "loop.duration=0.3")
    done = invoke(*TUNE, *BANDWIDTH, *conditions, "--generations", "1", "--population", "5", "--out", str(tmp_path))
    assert done.exit_code == ExitCode.MISSED
    assert "no candidate meets the conditions" in done.stderr
