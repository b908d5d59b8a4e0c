"""Runs a command to its closing lines, or to one line that states the error; texts, warnings and progress of all."""

import logging
import re
import time
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

from gough_stewart.harness.cli import ExitCode
from gough_stewart.harness.errors import MissedError, UsageError
from gough_stewart.model.errors import GoughStewartError

if TYPE_CHECKING:
    from rich.progress import Progress, Task

# Control characters except newline and tab, and marks that change the writing direction.
_UNSAFE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")


@dataclass
class Command:
    """A running command: its start time, and the folders it has written to, which an interrupt then names."""

    is_piped: bool = False  # standard output is data for another program: texts go to the error stream
    started: float = field(default_factory=time.perf_counter)
    written: list[Path] = field(default_factory=list)
    # folders that are removed at the end if nothing is in them, inner ones first
    new_folders: list[Path] = field(default_factory=list)
    latest: ClassVar["Command"]  # that runs, or has just ended

    def whereabouts(self) -> str:
        """What an interrupt says of the files."""
        return f"the files are in {', '.join(map(str, self.written))}" if self.written else "nothing written"

    def close(
        self,
        files: Iterable[str | Path],
        folder: Path,
        done: str | None = "Done",
        then: str | None = None,
        open_it: bool = False,
    ) -> None:
        """Print the closing lines: what is done, how long it took, the files and their size, the next step.

        With `open_it`, open the last page among the files in the browser.
        """
        import webbrowser

        from rich.padding import Padding

        seconds = time.perf_counter() - self.started
        minutes, rest = divmod(round(seconds), 60)
        took = f"{seconds:.1f} s" if seconds < 60 else f"{minutes} min {rest} s"
        names = [str(file) for file in files]
        places = [place for name in names for place in (folder / name, *(folder / name).rglob("*")) if place.is_file()]
        size = sum(place.stat().st_size for place in places)
        size_text = f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{size / 1e3:.3g} kB"

        terminal, said = Terminal(), f"{done} in {took}. " if done else ""
        if len(names) == 1:
            terminal.say(f"{said}Wrote {folder / names[0]} ({size_text}).")
        else:
            terminal.say(f"{said}Wrote to {folder} ({size_text}):")
            terminal.print(Padding(Text(", ".join(names), "dim"), (0, 0, 0, 2), expand=False))
        pages = [folder / name for name in names if name.endswith((".html", ".htm"))]
        for page in pages:
            if not open_it:
                terminal.say(f"Open {page} in a browser.")
            elif page == pages[-1] and not webbrowser.open(page.absolute().as_uri()):
                errors.say(f"no browser could be started; open {page} by hand")
        if then is not None:
            terminal.say(f"Next: {then}")


Command.latest = Command()


class Terminal(Console):
    """A console that prints all texts as they are: neither rich's markup nor control characters have an effect."""

    def __init__(self, *, stderr: bool = False) -> None:
        super().__init__(stderr=stderr or Command.latest.is_piped, markup=False, emoji=False, highlight=False)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """As in rich, with control characters made visible."""
        for segment in super().render(renderable, options):
            text = segment.text if segment.control else _UNSAFE.sub("\N{REPLACEMENT CHARACTER}", segment.text)
            yield Segment(text, segment.style, segment.control)

    def say(self, *parts: str | tuple[str, str]) -> None:
        """Print one line of any length; a part may be a pair of text and style."""
        self.print(Text.assemble(*parts), soft_wrap=True)


errors = Terminal(stderr=True)


def warn(message: str) -> None:
    """Print a warning: the command succeeded, but something needs attention."""
    errors.say(("warning: ", "bold yellow"), message)


def progress_bar(of_members: bool = False) -> "Progress":
    """Shows the task, its progress and its duration on the error stream, if it is a terminal; removed at the end.

    Of many members also their number, members per second, and the remaining time.
    """
    from rich import progress

    columns = [progress.TextColumn("{task.description}", markup=False), progress.BarColumn()]
    if of_members:

        class Rate(progress.ProgressColumn):
            def render(self, task: "Task") -> Text:
                return Text(f"{task.speed:.0f} members/s" if task.speed else "", style="dim")

        columns += [progress.MofNCompleteColumn(), Rate()]
    columns.append(progress.TimeElapsedColumn())
    columns += [progress.TextColumn("left"), progress.TimeRemainingColumn()] if of_members else []
    return progress.Progress(
        *columns,
        console=errors,
        transient=True,
        # each refresh takes as long as a hundred steps of a run
        refresh_per_second=10 if of_members else 4,
        # chunks end only every few seconds, so their speed is averaged over a minute
        speed_estimate_period=60 if of_members else 30,
        disable=not errors.is_terminal,
    )


class _Remarks(logging.Handler):
    """Shows what functions remark, such as leftovers that they have removed."""

    def emit(self, record: logging.LogRecord) -> None:
        errors.say((record.getMessage(), "dim"))


_remarks = logging.getLogger("gough_stewart.model.process.files")
_remarks.addHandler(_Remarks())
_remarks.setLevel(logging.INFO)


@contextmanager
def clear_errors(is_piped: bool = False) -> Iterator[Command]:
    """Turn an error into one clear line and an exit code instead of a traceback."""
    from gough_stewart.model.process.installed import environment

    Command.latest = command = Command(is_piped)
    try:
        with environment(), warnings.catch_warnings():
            # as a line, without the place in the source
            warnings.showwarning = lambda message, *_, **__: warn(str(message))
            yield command
    except (GoughStewartError, OSError, MemoryError) as error:
        code, said = ExitCode.FAILED, str(error)
        if isinstance(error, UsageError | MissedError):
            code = ExitCode.USAGE if isinstance(error, UsageError) else ExitCode.MISSED
        elif isinstance(error, MemoryError):
            said = "not enough memory; make the run shorter, its plant_step longer, or the grid coarser"
        elif not isinstance(error, GoughStewartError):
            said = f"{error.filename or 'output'}: {error.strerror or error}"
        errors.say(("error: ", "bold red"), "; ".join([said, *getattr(error, "__notes__", [])]))
        raise typer.Exit(code) from error
    except KeyboardInterrupt as error:
        notes = getattr(error, "__notes__", [])  # such as which files were written nonetheless
        errors.say((f"interrupted; {'; '.join(notes) or command.whereabouts()}", "bold red"))
        raise typer.Exit(ExitCode.INTERRUPTED) from None
    finally:
        for folder in command.new_folders:
            with suppress(OSError):  # something is in it
                folder.rmdir()


@contextmanager
def wrong_use_if(*kinds: type[GoughStewartError]) -> Iterator[None]:
    """Take these errors as wrong usage: what caused them was given at the command line."""
    try:
        yield
    except kinds as error:
        raise UsageError(str(error)) from error
