"""What all commands share: where errors go, and how they look."""

from collections.abc import Iterator
from contextlib import contextmanager

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from gough_stewart.model.errors import GoughStewartError

errors = Console(stderr=True)


def progress_bar(refresh_per_second: float = 10) -> Progress:
    """What is being done, how far, for how long; on the error stream, and gone in the end."""
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    return Progress(*columns, console=errors, transient=True, refresh_per_second=refresh_per_second)


class UsageError(GoughStewartError):
    """Options that contradict each other."""


@contextmanager
def clear_errors() -> Iterator[None]:
    """One clear line and an exit code instead of a traceback."""
    try:
        yield
    except GoughStewartError as error:
        errors.print(f"[bold red]error:[/bold red] {escape(str(error))}", soft_wrap=True, highlight=False)
        raise typer.Exit(1) from error
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        errors.print(f"[bold red]error:[/bold red] {escape(where)}{error.strerror}", soft_wrap=True)
        raise typer.Exit(1) from error
    except KeyboardInterrupt:
        errors.print("interrupted; nothing written", style="bold red")
        raise typer.Exit(130) from None
