"""A study is one declaration: a function with its options. What follows is the same for all, and done here.

    @study(numbers=("margins",), figures=("bode", "step"))
    def margins_command(running: Running, experiment: ExperimentArgument, out: Path | None = option(…)) -> None:
        '''What the help says.'''
        running.hold(folder, names_of_files)
        running.require(…, known_numbers)
        running.present(report, files)

1. The command has the options of the function, then --report, --figures, --open, --json and --require.
2. Progress is shown from the start; the function describes it by `running.step`.
3. An error is one line and an exit code (`command.clear_errors`).
4. `hold` reserves the folder, which holds one study at a time.
5. `expect` and `require` refuse wrong requirements, `expect` before anything is computed.
6. `present` judges them, writes the files, report.json, figures and page as one set that replaces that of an older
   result, and prints the report and the closing lines.
7. Afterwards the exit code is that of the requirements, unless the function ends with one of its own.
"""

import inspect
import json
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from gough_stewart.harness.cli import ExitCode
from gough_stewart.harness.cli.command import Command, Terminal, clear_errors, errors, progress_bar, warn
from gough_stewart.harness.cli.options import KINDS_OF_NUMBERS, flag, numbers_of_loops, option

if TYPE_CHECKING:
    from rich.progress import Progress

    from gough_stewart.harness.report.document import Report
    from gough_stewart.harness.report.requirements import Known, Required
    from gough_stewart.model.process.files import Content

PAGE, DATA = "report.html", "report.json"
RECORDS = ("record.parquet", "record.csv")


@dataclass(frozen=True)
class ReportOptions:
    """The options that every study has."""

    report: bool = flag("Also write report.html, a page for the browser.", "--report")
    figures: bool = flag("Also draw the charts, each as PDF, PNG and SVG.", "--figures")
    open_it: bool = flag("Open the page in the browser; implies --report.", "--open")
    as_json: bool = flag("Write the report as data to the standard output, and nothing else there.", "--json")
    require: list[str] | None = option(
        "A requirement on a number of the report, such as 'stroke.margin >= 10 mm'; may be repeated. Exit code 3 if it "
        "is not met, 4 if that is inconclusive.",
        "CONDITION",
    )


@dataclass
class Running:
    """A study that runs: what was asked of its report, its progress, and its folder."""

    name: str
    command: Command
    options: ReportOptions
    progress: "Progress"
    until_end: ExitStack
    page: bool  # whether a page is written
    draws: bool  # whether charts are shown anywhere
    groups: Sequence[str] = ()  # of charts, each a figure
    required: "list[Required]" = field(default_factory=list)
    known: "dict[str, Known]" = field(default_factory=dict)  # numbers that it will have, as far as they are known
    always: set[str] = field(default_factory=set)  # paths that it has of every experiment, or says why not
    of_members: Collection[str] = ()  # paths, or first words of paths, of numbers with a value for each member
    report: "Report | None" = None  # as presented
    folder: Path = Path()
    names: tuple[str, ...] = ()  # of all files that the study may write there
    keeps_data: bool = True

    def step(self, description: str | None = None, **values: Any) -> None:
        """Show what is done now; `total` and `completed` as in rich."""
        self.progress.update(self.progress.task_ids[0], description=description, **values)

    def hold(
        self, folder: Path, names: Iterable[str] = (), study: str | None = None, *, keeps_data: bool = True
    ) -> Path:
        """Check the folder of the results, and reserve it to the end of the command.

        `names` are all files that the study may write, apart from those of its report; `study` is its name there, if
        not that of the command. Without `keeps_data` there is no report.json: the folder is another's, such as the
        current one, and not reserved. `OutputError` if it cannot be written to, another command writes there, or it
        holds the results of another study.
        """
        from gough_stewart.model.errors import OutputError
        from gough_stewart.model.process.files import check_output_folder, reserved

        self.folder, self.names, self.keeps_data = folder, tuple(names), keeps_data
        check_output_folder(folder, [*self.names, DATA, PAGE])
        if not keeps_data:
            return folder
        # the studies whose results it holds: one, unless an older version has mixed them
        holders = ["run"] if any((folder / name).is_file() for name in RECORDS) else []
        with suppress(OSError, ValueError):
            data = json.loads((folder / DATA).read_bytes())
            holders += [data["study"]] if isinstance(data, dict) and data.get("study") else []
        if holders and (study or self.name) not in holders:
            raise OutputError(
                f"output folder {folder}: it holds the results of `gough-stewart {holders[0]}`; choose another "
                "folder, or delete that one"
            )
        self.command.new_folders += [place for place in (folder, *folder.parents) if not place.exists()]
        self.until_end.enter_context(reserved(folder))
        return folder

    def expect(
        self, known: Iterable[str], of_members: Collection[str] = (), absent: "Mapping[str, str] | None" = None
    ) -> None:
        """Refuse requirements of the command line on other numbers than these, before anything is computed.

        `known` and `of_members` are paths of numbers, or their first words; those `of_members` may be required of a
        share of them. Those that are `absent` in this experiment are refused with the reason.
        """
        self.of_members = of_members
        names = list(known)
        self.always = set() if absent is None else {*names}
        if not self.required:
            return
        from gough_stewart.harness.errors import RequirementError
        from gough_stewart.model.interface import nearest

        for requirement in self.required:
            path, why = requirement.path, ""
            if absent and path in absent:
                why = f" in this experiment: {absent[path]}"
            elif not _is_among(requirement, names):
                owner = numbers_of_loops().get(path)
                why = f"; `gough-stewart {owner}` has it" if owner not in (None, self.name) else nearest(path, names)
            if why:
                raise RequirementError(f"the requirement '{requirement.text}': no number '{path}'{why}")
            if requirement.share is not None and not _is_among(requirement, of_members):
                raise RequirementError(
                    f"the requirement '{requirement.text}' is on a share of members, and this study has none; leave "
                    "out 'for … of members', or use `gough-stewart ensemble`"
                )

    def require(self, from_file: Sequence[str], known: "Iterable[Known]", why: str = "") -> "list[Required]":
        """Take the requirements of the experiment's file that are on this study, beside those of the command line.

        A file may have requirements for several studies: those on other kinds of numbers, on numbers that other studies
        have, or on a share of members that this one does not have, are named and left out. `RequirementError` for an
        unknown number, and `why` it is not there, or a unit of another kind.
        """
        if not self.required and not from_file:
            return []
        from gough_stewart.harness.errors import RequirementError
        from gough_stewart.harness.experiment.margins import RENAMED
        from gough_stewart.harness.report.requirements import check_known, required

        self.known = {number.path: number for number in known if number.path}
        kinds = {path.partition(".")[0] for path in self.known}
        elsewhere = ({*numbers_of_loops()} if from_file else set()) - self.known.keys()
        for requirement in map(required, from_file):
            is_shared = requirement.share is not None and not _is_among(requirement, self.of_members)
            is_other = requirement.path in elsewhere or requirement.path.partition(".")[0] not in kinds
            if is_shared or (is_other and requirement.path not in self.always):
                errors.say((f"not judged by this command: {requirement.text}", "dim"))
                continue
            self.required.append(requirement)
            if requirement.path in RENAMED:  # a file may be older
                errors.say((f"{requirement.text}: {requirement.path} is {RENAMED[requirement.path]}", "dim"))
        try:
            check_known(self.required, self.known.values())
        except RequirementError as error:
            if why:
                error.add_note(why)
            raise
        return self.required

    def present(
        self,
        report: "Report",
        files: "Mapping[str, Content] | Sequence[str]",
        then: str | None = None,
        *,
        done: str | None = "Done",
        is_written: bool = False,
    ) -> None:
        """Judge the requirements, write the files with report.json, figures and page, and say what was found.

        `files` has their contents by name, or only names, if the study has written them; `then` is the next step. A
        report that `is_written` is judged, and all its files are there.
        """
        self.step("files and report", total=None)
        if self.required and not is_written:
            from gough_stewart.harness.report.document import Number
            from gough_stewart.harness.report.requirements import with_requirements

            # numbers that it might have had, such as a settling time without a step, are inconclusive
            paths = {*self.known} - {number.path for number in report.numbers}
            absent = {requirement.path for requirement in self.required if requirement.path in paths}
            added = (Number(path, path, None, self.known[path].quantity) for path in absent)
            judged = with_requirements(
                replace(report, numbers=(*report.numbers, *added)),
                [replace(asked, share=None) if asked.path in absent else asked for asked in self.required],
            )
            report = replace(judged, numbers=report.numbers)
        written = [] if is_written else self.write(report, self.folder, files if isinstance(files, Mapping) else {})

        # on the terminal or as JSON, and the closing lines
        self.progress.stop()
        self.report = report
        if self.folder not in self.command.written:
            self.command.written.append(self.folder)
        if self.options.as_json:
            from gough_stewart.harness.report.document import thinned, to_json

            sys.stdout.write(to_json(thinned(report)) + "\n")
        else:
            from gough_stewart.harness.report.terminal import show

            show(report, Terminal())
        for note in report.notes:
            if note.kind == "warning":
                warn(note.text)
        self.command.close([*files, *written], self.folder, done=done, then=then, open_it=self.options.open_it)

    def write(self, report: "Report", folder: Path, files: "Mapping[str, Content]") -> list[str]:
        """Write these files with report.json, figures and page as one set; the names of those that are not in `files`.

        From report.json `gough-stewart view` shows the folder.
        """
        from gough_stewart.harness.report.document import thinned, to_json
        from gough_stewart.model.process.files import file_set

        expected = [*files, *([DATA] if self.keeps_data else []), *([PAGE] if self.page else [])]
        pictures = [f"{group}.{kind}" for group in self.groups for kind in ("pdf", "png", "svg")]
        with file_set(folder, expected, [*(self.names if files else ()), PAGE, *pictures]) as new:
            new.add(files)
            if self.keeps_data:
                new.add({DATA: to_json(thinned(report)).encode()})
            if self.options.figures:
                from gough_stewart.harness.report.figures import figures

                new.add(figures(report))
            if self.page:
                from gough_stewart.harness.report.page import page_of

                new.add({PAGE: page_of(report)})
        if folder == self.folder:
            self.command.written.append(folder)
        return new.names[len(files) :]


def _is_among(requirement: "Required", names: Collection[str]) -> bool:
    """Whether its path, or the first word of it, is one of the names."""
    return requirement.path in names or requirement.path.partition(".")[0] in names


def study(
    numbers: Sequence[str] = (), figures: Sequence[str] = (), *, many: bool = False
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Declare a study, whose function gets itself `Running` first; `figures` are the groups of its charts.

    `numbers` are first words of the paths of its numbers, if the function does not check requirements itself by
    `expect`; with `many`, progress is shown in members.
    """
    KINDS_OF_NUMBERS.update(numbers)

    def declared(function: Callable[..., None]) -> Callable[..., None]:
        name = function.__name__.removesuffix("_command")
        signature = inspect.signature(function)
        shared = inspect.signature(ReportOptions).parameters

        @wraps(function)
        def command(**values: Any) -> None:
            options = ReportOptions(**{option_name: values.pop(option_name) for option_name in shared})
            page = options.report or options.open_it
            draws = page or options.figures or options.as_json
            with (
                clear_errors(is_piped=options.as_json) as command,
                progress_bar(many) as progress,
                ExitStack() as until_end,
            ):
                progress.add_task("preparing", total=None)
                running = Running(name, command, options, progress, until_end, page, draws, figures)
                if options.require:
                    from gough_stewart.harness.report.requirements import required

                    running.required += map(required, options.require)
                    if numbers:
                        running.expect(numbers)
                function(running, **values)
                # each requirement that failed is said, and decides how the command ends
                outcomes = running.report.requirements if running.report is not None else ()
                labels = {"missed": ("missed: ", "bold red"), "open": ("inconclusive: ", "bold yellow")}
                failed = [outcome for outcome in outcomes if outcome.status in labels]
                for outcome in failed:
                    errors.say(labels[outcome.status], outcome.text)
                if failed:
                    is_missed = any(outcome.status == "missed" for outcome in failed)
                    raise typer.Exit(ExitCode.MISSED if is_missed else ExitCode.OPEN)

        _, *parameters = signature.parameters.values()
        parameters += [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in shared.values()]
        command.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
        command.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return command

    return declared
