"""The command `view`: shows records in a browser."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gough_stewart.harness.cli.command import Command, clear_errors
from gough_stewart.harness.cli.options import OpenOption, path
from gough_stewart.harness.cli.showing import DATA, PAGE
from gough_stewart.harness.cli.terminal import progress_bar
from gough_stewart.harness.errors import RecordError, UsageError

if TYPE_CHECKING:
    from gough_stewart.harness.report.document import Report


def view_command(
    records: Annotated[
        list[Path],
        typer.Argument(
            help="The folder of any command, or a report.json; of runs also several, or their record.parquet or "
            "record.csv.",
            metavar="FOLDER",
            parser=path,
        ),
    ],
    out: Annotated[Path, typer.Option(help="The page to write.", metavar="FILE.html", parser=path)] = Path(
        "report.html"
    ),
    open_it: OpenOption = False,
) -> None:
    """Show in a browser what a command found: verdict, numbers, charts; of runs also the platform in 3-D motion.

    Writes one self-contained page: it needs no network, server or other file. Several runs are overlaid.

    Examples
    --------
    - `gough-stewart view results/run_heave_step --open`

    - `gough-stewart view results/margins_heave_step --open`

    - `gough-stewart view results/run_circle results/run_circle_computed_torque --out compared.html`
    """
    with clear_errors() as command:
        if out.suffix not in (".html", ".htm"):
            raise UsageError(f"--out {out}: expected the name of a page, such as {out}.html")
        if len(records) == 1 and _is_report(records[0]):
            _view_report(command, records[0], out, open_it=open_it)
            return
        with progress_bar() as progress:
            task = progress.add_task("reading", total=None)
            from gough_stewart.harness.view.view import view

            view(records, out, progress=lambda what: progress.update(task, description=what))
        command.written.append(out)
        command.close([out.name], out.parent, open_it=open_it)


def _is_report(place: Path) -> bool:
    """Whether it is a report of another study than a run, whose record says more."""
    if any((place / name).is_file() for name in ("record.parquet", "record.csv")):
        return False
    return place.name == DATA or any((place / name).is_file() for name in (DATA, PAGE))


def _view_report(command: Command, place: Path, out: Path, *, open_it: bool) -> None:
    """Write the page of a report, or show the page that its command has written."""
    data = place if place.name == DATA else place / DATA
    if place == data and not data.is_file():
        raise RecordError(f"{place}: no such file; expected the folder of a command, or its report.json")
    if not data.is_file():
        command.close([PAGE], place, open_it=open_it)
        return
    with progress_bar() as progress:
        progress.add_task("writing the page", total=None)
        from gough_stewart.harness.report.codec import from_json
        from gough_stewart.harness.report.page import page_of
        from gough_stewart.model.process.files import write_files

        try:
            report = from_json(data.read_bytes())
        except (ValueError, KeyError) as error:
            raise RecordError(f"{data}: cannot be read as a report: {error}; expected what a command writes") from error
        report = _with_members(report, data.parent)
        write_files(out.parent, {out.name: page_of(report)})
    command.written.append(out)
    command.close([out.name], out.parent, open_it=open_it)


def _with_members(report: "Report", folder: Path) -> "Report":
    """The report of an ensemble with signals of its members, from which the page draws bands of the marked ones."""
    if report.study != "ensemble" or not any(folder.glob("samples.parquet")):
        return report
    from gough_stewart.harness.ensemble.charts import with_samples
    from gough_stewart.harness.ensemble.report import read_ensemble

    samples = read_ensemble(folder).samples
    return report if samples is None else with_samples(report, samples)
