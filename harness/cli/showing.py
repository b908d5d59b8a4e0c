"""What every command that finds something can do with its report, in one place: its options, and its end.

A command whose function is decorated by `shows` has the options --report, --json, --figures, --open and --require,
and gets them as one `Showing`, which presents the report of its result.
"""

import inspect
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gough_stewart.harness.cli.command import Command, clear_errors
from gough_stewart.harness.cli.exit_codes import ExitCode
from gough_stewart.harness.cli.terminal import Terminal, diverted, errors, warn
from gough_stewart.model.process.files import write_files

if TYPE_CHECKING:
    from gough_stewart.harness.report.document import Report
    from gough_stewart.harness.report.requirements import Required

PAGE, DATA = "report.html", "report.json"

_OPTIONS: dict[str, tuple[Any, Any]] = {
    "report": (
        Annotated[bool, typer.Option("--report", help="Also write report.html, a page for the browser.")],
        False,
    ),
    "figures": (
        Annotated[bool, typer.Option("--figures", help="Also draw the charts, each as PDF, PNG and SVG.")],
        False,
    ),
    "open_it": (
        Annotated[bool, typer.Option("--open", help="Open the page in the browser; implies --report.")],
        False,
    ),
    "as_json": (
        Annotated[
            bool,
            typer.Option("--json", help="Write the report as data to the standard output, and nothing else there."),
        ],
        False,
    ),
    "require": (
        Annotated[
            list[str] | None,
            typer.Option(
                "--require",
                help="A requirement on a number of the report, such as 'tracking.position.norm_peak <= 1 mm'; may be "
                "repeated. Exit code 3 if it is not met, 4 if that cannot be told.",
                metavar="CONDITION",
            ),
        ],
        None,
    ),
}


@dataclass(frozen=True)
class Showing:
    """How the report of a command is to be shown, and what is required of its numbers."""

    page: bool = False
    figures: bool = False
    opens: bool = False
    as_json: bool = False
    required: "tuple[Required, ...]" = ()

    def check(self, known: Iterable[str], more: Sequence[str] = ()) -> None:
        """Refuse requirements on numbers that the command will not have, before it begins; `more` as in `present`.

        Raises
        ------
        RequirementError
            An unknown number, or a requirement that cannot be read.
        """
        if self.required or more:
            from gough_stewart.harness.report.requirements import check_paths, required

            check_paths([*map(required, more), *self.required], known)

    def present(
        self,
        command: Command,
        report: "Report",
        folder: Path,
        files: Sequence[str] = (),
        *,
        more: Sequence[str] = (),
        done: str | None = "Done",
        then: str | None = None,
        code: ExitCode = ExitCode.DONE,
        keeps_data: bool = True,
    ) -> None:
        """Show a report: on the terminal or as JSON, as a page, as figures; then end with an exit code.

        Parameters
        ----------
        files
            Written by the command itself.
        more
            Requirements of the experiment's file.
        code
            Of the command itself; requirements give one if it is 0.
        keeps_data
            Write report.json, from which `gough-stewart view` shows the folder.

        Raises
        ------
        typer.Exit
            With the code, unless it is 0.
        """
        if self.required or more:
            from gough_stewart.harness.report.requirements import with_requirements

            report = with_requirements(report, [*more, *self.required])
        written = self._write(report, folder, keeps_data)
        if folder not in command.written:
            command.written.append(folder)
        if self.as_json:
            from gough_stewart.harness.report.codec import to_json
            from gough_stewart.harness.report.thinning import thinned

            sys.stdout.write(to_json(thinned(report)) + "\n")
        else:
            from gough_stewart.harness.report.terminal import show

            show(report, Terminal())
        for note in report.notes:
            if note.kind == "warning":
                warn(note.text)
        with diverted(self.as_json):
            command.close([*files, *written], folder, done=done, then=then, open_it=self.opens)
        raise_exit(code or _code_of(report))

    def _write(self, report: "Report", folder: Path, keeps_data: bool) -> list[str]:
        """Write page, data and figures as one set; names of the files for the reader."""
        files: dict[str, bytes] = {}
        if keeps_data:
            from gough_stewart.harness.report.codec import to_json
            from gough_stewart.harness.report.thinning import thinned

            files[DATA] = to_json(thinned(report)).encode()
        if self.figures:
            from gough_stewart.harness.report.figures import figures

            files |= figures(report)
        if self.page:
            from importlib import import_module

            files[PAGE] = import_module("gough_stewart.harness.report.page").page(report)
        write_files(folder, files, owned=[PAGE, DATA])
        return list(files)


def raise_exit(code: ExitCode) -> None:
    """End the command with a code, unless it is 0."""
    if code:
        raise typer.Exit(code)


def _code_of(report: "Report") -> ExitCode:
    """The exit code of the requirements, each failure of which is said on the error stream."""
    words = {"missed": ("missed: ", "bold red"), "open": ("cannot be told: ", "bold yellow")}
    for each in report.requirements:
        if each.status in words:
            errors.say(words[each.status], each.text)
    states = {each.status for each in report.requirements}
    return ExitCode.MISSED if "missed" in states else ExitCode.OPEN if "open" in states else ExitCode.DONE


def shows(function: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of a report; the function gets them as its parameter `showing`."""
    signature = inspect.signature(function)
    own = [each for each in signature.parameters.values() if each.name != "showing"]
    keyword = inspect.Parameter.KEYWORD_ONLY
    more = [
        inspect.Parameter(name, keyword, default=default, annotation=annotation)
        for name, (annotation, default) in _OPTIONS.items()
    ]

    @wraps(function)
    def command(**given: Any) -> None:
        report, figures, opens, as_json, require = (given.pop(name) for name in _OPTIONS)
        # errors of the command go the same way; its own context is within
        with diverted(as_json):
            wanted: tuple[Required, ...] = ()
            if require:
                with clear_errors():
                    from gough_stewart.harness.report.requirements import required

                    wanted = tuple(map(required, require))
            function(**given, showing=Showing(report or opens, figures, opens, as_json, wanted))

    command.__signature__ = signature.replace(parameters=[*own, *more])  # type: ignore[attr-defined]
    command.__annotations__ = {each.name: each.annotation for each in (*own, *more)}
    return command
