"""What all commands share of the terminal: texts that are only texts, progress, warnings."""

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

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

if TYPE_CHECKING:
    from gough_stewart.harness.output.tables import Sheet

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


def show(*sheets: "Sheet") -> None:
    """Tables, in the width that there is."""
    from gough_stewart.harness.output.tables import to_terminal

    for sheet in sheets:
        Terminal().print(to_terminal(sheet))


def warn(message: str) -> None:
    """What went well, and yet is not as it should be."""
    errors.say(("warning: ", "bold yellow"), message)
