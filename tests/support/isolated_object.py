"""An object for a process of its own, which says what it was given and ends as it is told."""

import os
import sys
from pathlib import Path
from typing import Any

from gough_stewart import StepError


class Given:
    """Keeps its arguments; makes a file when it is closed."""

    def __init__(self, first: Any, second: Any, closed: Path | None = None) -> None:
        self.given, self.closed = (first, second), closed
        if first == "refuse":
            raise StepError("first", 1.5, 7.3, "is refused")

    def both(self, *others: Any) -> tuple[Any, ...]:
        """The arguments of construction, then those of the call."""
        return (*self.given, *others)

    def variable(self, name: str) -> str | None:
        """An environment variable of the process."""
        return os.environ.get(name)

    def fail(self, time: float) -> None:
        """Raise an error with data."""
        raise StepError("leg_length[4]", 0.25, time, "the leg has collapsed")

    def leave(self, code: int, *lines: str) -> None:
        """Print and end the process."""
        for line in lines:
            print(line, file=sys.stderr)
        sys.stderr.flush()
        os._exit(code)

    def do_step(self, _time: float, _step: float) -> None:
        """End the process without a word."""
        os._exit(3)

    def close(self) -> None:
        """Leave a trace."""
        if self.closed is not None:
            self.closed.write_text("closed")
