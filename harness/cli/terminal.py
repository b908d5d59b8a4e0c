"""What all commands share: the terminal, where errors go, and how they look."""

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.segment import Segment
from rich.text import Text

from gough_stewart.harness.errors import UsageError
from gough_stewart.model.errors import GoughStewartError

# Beside 0 and 3, which is of `run` alone; they are listed in docs/control.md.
EXIT_ERROR = 1
EXIT_USAGE = 2
EXIT_INTERRUPTED = 130
# Control characters but the end of a line and the tabulator, and what turns the direction of writing.
_UNSAFE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")


def visible(text: str) -> str:
    """A text that does nothing to a terminal but stand there."""
    return _UNSAFE.sub("\N{REPLACEMENT CHARACTER}", text)


class Terminal(Console):
    """A console to which every text is only a text: neither rich's markup nor a control character does anything."""

    def __init__(self, *, stderr: bool = False) -> None:
        super().__init__(stderr=stderr, markup=False, emoji=False, highlight=False)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """As rich renders it, made visible."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(visible(segment.text), segment.style)

    def say(self, *parts: str | tuple[str, str]) -> None:
        """One line, however long; a part may be a pair of text and style."""
        self.print(Text.assemble(*parts), soft_wrap=True)


errors = Terminal(stderr=True)


def progress_bar(refresh_per_second: float = 10) -> Progress:
    """What is being done, how far, for how long; on the error stream if that is a terminal, and gone in the end."""
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    return Progress(
        *columns, console=errors, transient=True, refresh_per_second=refresh_per_second, disable=not errors.is_terminal
    )


def members_bar() -> Progress:
    """The same for many members: how many, how many a second, how long the rest will take."""
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        _Rate(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    # a chunk is done every few seconds only: the speed is that of a minute
    return Progress(*columns, console=errors, transient=True, speed_estimate_period=60, disable=not errors.is_terminal)


class _Rate(ProgressColumn):
    def render(self, task: Task) -> Text:
        return Text(f"{task.speed:.0f} members/s" if task.speed else "", style="dim")


@contextmanager
def preparing() -> Iterator[None]:
    """Say so while what a command works with is imported, which may take seconds."""
    with progress_bar() as bar:
        bar.add_task("preparing", total=None)
        yield


def say_written(files: Iterable[str | Path], folder: Path) -> None:
    """What has been written, and where."""
    Terminal().say((f"Wrote {', '.join(map(str, files))} to {folder}", "dim"))


def warn(message: str) -> None:
    """What went well, and yet is not as it should be."""
    errors.say(("warning: ", "bold yellow"), message)


@contextmanager
def clear_errors() -> Iterator[list[Path]]:
    """One clear line and an exit code instead of a traceback.

    Yields a list for the folders that have been written to: an interrupt after that says so.
    """
    written: list[Path] = []
    try:
        yield written
    except GoughStewartError as error:
        _say_error(str(error), error)
        raise typer.Exit(EXIT_USAGE if isinstance(error, UsageError) else EXIT_ERROR) from error
    except OSError as error:
        _say_error(f"{error.filename or 'output'}: {error.strerror or error}", error)
        raise typer.Exit(EXIT_ERROR) from error
    except MemoryError as error:
        _say_error("not enough memory; make the run shorter, its plant_step longer, or the grid coarser", error)
        raise typer.Exit(EXIT_ERROR) from error
    except KeyboardInterrupt as error:
        errors.say((f"interrupted; {_notes(error) or _whereabouts(written)}", "bold red"))
        raise typer.Exit(EXIT_INTERRUPTED) from None


def _say_error(message: str, error: BaseException) -> None:
    errors.say(("error: ", "bold red"), "; ".join(filter(None, [message, _notes(error)])))


def _notes(error: BaseException) -> str:
    """What those have added who know more, such as which files are there all the same."""
    return "; ".join(getattr(error, "__notes__", ()))


def _whereabouts(folders: list[Path]) -> str:
    return f"the files are in {', '.join(map(str, folders))}" if folders else "nothing written"
