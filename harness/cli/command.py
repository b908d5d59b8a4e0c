"""Runs a command to its closing lines, or to one line that states the error."""

import logging
import time
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import typer

from gough_stewart.harness.cli import ExitCode
from gough_stewart.harness.cli.console import Terminal, errors, warn
from gough_stewart.harness.errors import MissedError, UsageError
from gough_stewart.model.errors import GoughStewartError


@dataclass
class Command:
    """A running command: its start time, and the folders it has written to, which an interrupt then names."""

    started: float = field(default_factory=time.perf_counter)
    written: list[Path] = field(default_factory=list)
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
        from rich.text import Text

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


class _Remarks(logging.Handler):
    """Shows what functions remark, such as leftovers that they have removed."""

    def emit(self, record: logging.LogRecord) -> None:
        errors.say((record.getMessage(), "dim"))


_remarks = logging.getLogger("gough_stewart.model.process.files")
_remarks.addHandler(_Remarks())
_remarks.setLevel(logging.INFO)


@contextmanager
def clear_errors() -> Iterator[Command]:
    """Turn an error into one clear line and an exit code instead of a traceback."""
    from gough_stewart.model.process.installed import check_environment, tracer_is_named

    Command.latest = command = Command()
    try:
        check_environment()
        with tracer_is_named(), warnings.catch_warnings():
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


@contextmanager
def wrong_use_if(*kinds: type[GoughStewartError]) -> Iterator[None]:
    """Take these errors as wrong usage: what caused them was given at the command line."""
    try:
        yield
    except kinds as error:
        raise UsageError(str(error)) from error
