"""The command line within this process, for what needs no process of its own."""

from typer.testing import CliRunner, Result

from gough_stewart.harness.cli import app as cli


def invoke(*arguments: str, columns: int = 200) -> Result:
    """`gough-stewart arguments` on a wide terminal without colours; an error that is not told is raised."""
    runner = CliRunner(env={"COLUMNS": str(columns), "NO_COLOR": "1", "TERM": "dumb"})
    return runner.invoke(cli.app, list(arguments), catch_exceptions=False)
