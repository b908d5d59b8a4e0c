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
    from gough_stewart.harness.report.requirements import Known, Required

PAGE, DATA = "report.html", "report.json"
_KINDS = ("pdf", "png", "svg")  # of figures
# Kinds of numbers whose paths are not listed: they follow from options, an injection or a platform.
_UNLISTED = {
    *("S", "T", "L", "coherence", "value", "values", "fresh", "parameters", "condition_number", "files"),
    *("first", "difference"),
}

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
                help="A requirement on a number of the report, such as 'stroke.margin >= 10 mm'; may be "
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

    @property
    def draws(self) -> bool:
        """Whether charts are shown anywhere."""
        return self.page or self.figures or self.as_json

    def requirements(self, of_file: Sequence[str], known: "Iterable[Known]") -> "list[Required]":
        """Those of the experiment's file that are on this study, and of the command line, checked before it begins.

        A file may have requirements for several studies: those on other kinds of numbers, or on numbers that other
        studies have, are named and left out.

        Raises
        ------
        RequirementError
            An unknown number, a unit of another kind, or a requirement that cannot be read.
        """
        if not self.required and not of_file:
            return []
        from gough_stewart.harness.experiment.margins import RENAMED
        from gough_stewart.harness.report.requirements import check_known, required

        numbers = list(known)
        paths = {each.path for each in numbers}
        kinds = {path.partition(".")[0] for path in paths}
        others = (_numbers_of_loops() if of_file else set()) - paths
        found = list(self.required)
        for each in map(required, of_file):
            if each.path in others or each.path.partition(".")[0] not in kinds:
                errors.say((f"not judged by this command: {each.text}", "dim"))
            else:
                found.append(each)
                if each.path in RENAMED:  # a file may be older
                    errors.say((f"{each.text}: {each.path} is {RENAMED[each.path]}", "dim"))
        check_known(found, numbers)
        return found

    def present(
        self,
        command: Command,
        report: "Report",
        folder: Path,
        files: Sequence[str] = (),
        *,
        requirements: "Sequence[Required] | None" = None,
        done: str | None = "Done",
        then: str | None = None,
        figures: Sequence[str] = (),
        keeps_data: bool = True,
        exits: bool = True,
    ) -> "Report":
        """Judge the requirements, write page, figures and report.json, and end the command as `end` and `exit` do.

        Parameters
        ----------
        files
            Written by the command itself.
        requirements
            From `requirements`; without them those of the command line.
        figures
            Names of the figures that the command can draw: those of an older result do not stay beside a new one.
        keeps_data
            Write report.json; the current folder is left without it, unless a page is asked for.
        exits
            End with the exit code of the requirements; otherwise the command has one of its own.

        Returns
        -------
        Report
            With its requirements.

        Raises
        ------
        RequirementError
            A number that the report does not have.
        typer.Exit
            A requirement is missed or open.
        """
        report = self.judged(report, requirements)
        written = self.write(report, folder, figures, keeps_data=keeps_data)
        self.end(command, report, folder, [*files, *written], done=done, then=then)
        if exits:
            self.exit(report)
        return report

    def judged(self, report: "Report", requirements: "Sequence[Required] | None" = None) -> "Report":
        """The report with how its requirements came out.

        Raises
        ------
        RequirementError
            A number that the report does not have.
        """
        wanted = self.required if requirements is None else requirements
        if not wanted:
            return report
        from gough_stewart.harness.report.requirements import with_requirements

        return with_requirements(report, wanted)

    def end(
        self,
        command: Command,
        report: "Report",
        folder: Path,
        files: Sequence[str],
        *,
        done: str | None = "Done",
        then: str | None = None,
    ) -> None:
        """Print a report whose files are written, on the terminal or as JSON, and the closing lines."""
        if folder not in command.written:
            command.written.append(folder)
        if self.as_json:
            from gough_stewart.harness.report.codec import thinned, to_json

            sys.stdout.write(to_json(thinned(report)) + "\n")
        else:
            from gough_stewart.harness.report.terminal import show

            show(report, Terminal())
        for note in report.notes:
            if note.kind == "warning":
                warn(note.text)
        command.close(files, folder, done=done, then=then, open_it=self.opens)

    def exit(self, report: "Report") -> None:
        """End the command with the exit code of its requirements, each failure of which is said.

        Raises
        ------
        typer.Exit
            A requirement is missed or open.
        """
        words = {"missed": ("missed: ", "bold red"), "open": ("cannot be told: ", "bold yellow")}
        for each in report.requirements:
            if each.status in words:
                errors.say(words[each.status], each.text)
        states = {each.status for each in report.requirements}
        if states & {"missed", "open"}:
            raise typer.Exit(ExitCode.MISSED if "missed" in states else ExitCode.OPEN)

    def write(
        self, report: "Report", folder: Path, former: Sequence[str] = (), *, keeps_data: bool = True
    ) -> list[str]:
        """Write report.json, from which `gough-stewart view` shows the folder, page and figures as one set."""
        from gough_stewart.harness.report.codec import thinned, to_json

        files = {DATA: to_json(thinned(report)).encode()} if keeps_data else {}
        if self.figures:
            from gough_stewart.harness.report.figures import figures

            files |= figures(report)
        if self.page:
            from gough_stewart.harness.report.page import page_of

            files[PAGE] = page_of(report)
        write_files(folder, files, owned=[PAGE, *(f"{name}.{kind}" for name in former for kind in _KINDS)])
        return list(files)


def check_paths(of_file: Iterable[str]) -> None:
    """Refuse requirements of an experiment's file on numbers that no study has.

    Raises
    ------
    RequirementError
        Such a number, with the nearest path.
    """
    from gough_stewart.harness.errors import RequirementError
    from gough_stewart.harness.report.requirements import required
    from gough_stewart.model.interface import nearest

    known = _numbers_of_loops()
    for requirement in map(required, of_file):
        if requirement.path not in known and requirement.path.partition(".")[0] not in _UNLISTED:
            raise RequirementError(
                f"the requirement '{requirement.text}': no study has a number '{requirement.path}'"
                f"{nearest(requirement.path, known)}"
            )


def _numbers_of_loops() -> set[str]:
    """The paths of numbers that several studies of one experiment share the first word of."""
    from gough_stewart.harness.experiment.checking import PATHS as OF_CHECKS
    from gough_stewart.harness.experiment.margins import PATHS as OF_MARGINS
    from gough_stewart.harness.results.metric_folds import METRICS

    return {*OF_CHECKS, *OF_MARGINS, *(each.path for each in METRICS)}


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
