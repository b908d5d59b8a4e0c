"""Terminal output of all commands: plain texts, progress, warnings."""

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

if TYPE_CHECKING:
    from rich.progress import Progress, Task

# Control characters except newline and tab, and marks that change the writing direction.
_UNSAFE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
# Whether standard output is for data only, so that texts go to the error stream.
_diverted = [False]


@contextmanager
def diverted(is_so: bool = True) -> Iterator[None]:
    """Print texts on the error stream while a block lasts: its output is data for another program."""
    before, _diverted[0] = _diverted[0], is_so
    try:
        yield
    finally:
        _diverted[0] = before


class Terminal(Console):
    """A console that prints all texts as they are: neither rich's markup nor control characters have an effect."""

    def __init__(self, *, stderr: bool = False) -> None:
        super().__init__(stderr=stderr or _diverted[0], markup=False, emoji=False, highlight=False)

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

    class Rate(progress.ProgressColumn):
        def render(self, task: "Task") -> Text:
            return Text(f"{task.speed:.0f} members/s" if task.speed else "", style="dim")

    columns = [progress.TextColumn("{task.description}", markup=False), progress.BarColumn()]
    columns += [progress.MofNCompleteColumn(), Rate()] if of_members else []
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
