"""The command line within this process, for what needs no process of its own."""

from unittest.mock import patch

from typer.testing import CliRunner, Result

from gough_stewart.harness.cli import app as cli
from gough_stewart.harness.report.table import Table
from gough_stewart.harness.report.terminal import TerminalTable
from tests.support.whole_tables import check_is_whole


def invoke(*arguments: str, columns: int = 200) -> Result:
    """`gough-stewart arguments` on a wide terminal without colours; an error that has no message of its own is raised.

    Every table that the command shows is also printed in 80 and in 60 columns, and compared with what is in it.
    """
    shown: list[Table] = []

    def noted(self: TerminalTable, table: Table) -> None:
        shown.append(table)
        self.table = table

    runner = CliRunner(env={"COLUMNS": str(columns), "NO_COLOR": "1", "TERM": "dumb"})
    with patch.object(TerminalTable, "__init__", noted):
        done = runner.invoke(cli.app, list(arguments), catch_exceptions=False)
    for table in shown:
        for width in (80, 60):
            check_is_whole(table, width)
    return done
