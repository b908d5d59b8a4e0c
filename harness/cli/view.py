"""The command `view`: shows records in a browser."""

from pathlib import Path
from typing import Annotated

import typer

from gough_stewart.harness.cli.command import clear_errors
from gough_stewart.harness.cli.options import OpenOption, path
from gough_stewart.harness.cli.terminal import progress_bar
from gough_stewart.harness.errors import UsageError


def view_command(
    records: Annotated[
        list[Path],
        typer.Argument(
            help="Folders written by `gough-stewart run`, or their record.parquet or record.csv.",
            metavar="RECORD",
            parser=path,
        ),
    ],
    out: Annotated[Path, typer.Option(help="The page to write.", metavar="FILE.html", parser=path)] = Path(
        "report.html"
    ),
    open_it: OpenOption = False,
) -> None:
    """Show runs in a browser: the platform in 3-D motion, with charts, metrics and parameters.

    Writes one self-contained page: it needs no network, server or other file. Several records are overlaid.

    Examples
    --------
    - `gough-stewart view results/run_heave_step --open`

    - `gough-stewart view results/run_circle results/run_circle_computed_torque --out compared.html`
    """
    with clear_errors() as command:
        if out.suffix not in (".html", ".htm"):
            raise UsageError(f"--out {out}: expected the name of a page, such as {out}.html")
        with progress_bar() as progress:
            task = progress.add_task("reading", total=None)
            from gough_stewart.harness.view.file import view

            view(records, out, progress=lambda what: progress.update(task, description=what))
        command.written.append(out)
        command.close([out.name], out.parent, open_it=open_it)
