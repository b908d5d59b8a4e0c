"""The command `live`: the loop of an experiment, live in a page."""

from pathlib import Path
from typing import Annotated

import typer

from gough_stewart.harness.cli.command import clear_errors
from gough_stewart.harness.cli.options import ExperimentArgument, SetOption, chosen_experiment, path
from gough_stewart.harness.cli.terminal import preparing, progress_bar
from gough_stewart.harness.errors import UsageError


def live_command(
    experiment: ExperimentArgument,
    settings: SetOption = None,
    out: Annotated[
        Path | None, typer.Option(help="The page to write. Default: NAME_live.html.", metavar="FILE.html", parser=path)
    ] = None,
    no_open: Annotated[bool, typer.Option("--no-open", help="Do not open it in the browser.")] = False,
) -> None:
    """Play with the loop of an experiment in the browser: it runs there, from the same compiled code as everywhere.

    Writes one page, which needs no network, server or installation, and opens it: drag the platform, load and push it,
    and see what its legs do.

    Examples
    --------
    - `gough-stewart live heave_step`

    - `gough-stewart live mine.toml --set controller.bandwidth=3 --out mine.html --no-open`
    """
    with clear_errors() as command:
        if out is not None and out.suffix not in (".html", ".htm"):
            raise UsageError(f"--out {out}: expected the name of a page, such as {out}.html")
        with preparing():
            from gough_stewart.harness.export.choices import name_of
            from gough_stewart.harness.export.live.page import live_page
            from gough_stewart.model.process.files import write_files

        chosen = chosen_experiment(experiment, settings, no_python=False, executed=lambda _chosen: ())
        page = Path(f"{name_of(chosen)}_live.html") if out is None else out
        with progress_bar() as progress:
            progress.add_task("writing the page", total=None)
            write_files(page.parent, {page.name: live_page(chosen)})
        command.written.append(page)
        command.close([page.name], page.parent, open_it=not no_open)
