"""Draws the figures of a run in a separate process, which starts up during the run.

Importing matplotlib and drawing take half as long as a run of ten seconds, and Python's global lock keeps a thread
from doing it in parallel with the loop.
"""

import gc
import os
import pickle
import subprocess
import sys
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol, Self

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gough_stewart.harness.results.record import Record

FIGURES = ("pose", "errors", "forces", "legs")
_POSE_AND_LEGS = ("position", "orientation", "leg_length")
_DRAWN = (
    *("time", "actuator_force", "flag.force_limited", "flag.rate_limited"),
    *(f"{prefix}{name}" for prefix in ("", "reference.", "error.") for name in _POSE_AND_LEGS),
)


class Drawable(Protocol):
    """What figures are drawn from: a record, or a part of one."""

    @property
    def metadata(self) -> dict[str, Any]:
        """Title, outcome, limits."""

    def __getitem__(self, name: str) -> "NDArray[Any]":
        """A column (n,), or all columns of a variable (n, size)."""

    def __contains__(self, name: str) -> bool:
        """Whether a column or variable of this name exists."""


@dataclass(frozen=True)
class Drawn:
    """The part of a record that figures show, without polars, which takes longer to import than this takes to send."""

    columns: "dict[str, NDArray[Any]]"
    metadata: dict[str, Any]

    def __getitem__(self, name: str) -> "NDArray[Any]":
        """As in `Record`."""
        return self.columns[name]

    def __contains__(self, name: str) -> bool:
        """As in `Record`."""
        return name in self.columns


def draw_here(record: "Record") -> dict[str, bytes]:
    """Call `run_figures` in this process; imports it only now."""
    from gough_stewart.harness.results.figures import run_figures

    return run_figures(record)


class Drawing:
    """Runs `run_figures` in another process, which lives as long as the `with` block."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        """Start the process; it does its imports and waits."""
        # -P: never import modules from the user's folder
        command = [sys.executable, "-P", "-m", __name__]
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C ends only the loop; the rows so far are still drawn
            )
        except OSError:  # no process can be started: draw in this one
            self._process = None
        return self

    def __call__(self, record: "Record") -> dict[str, bytes]:
        """Figures by file name; if the other process fails, they are drawn in this one, which raises any error."""
        process, self._process = self._process, None
        if process is None:
            return draw_here(record)
        drawn = Drawn({name: record[name] for name in _DRAWN if name in record}, record.metadata)
        with process:
            try:
                answer, _ = process.communicate(pickle.dumps(drawn))
            except BaseException:
                process.kill()
                raise
        if process.returncode:
            return draw_here(record)
        figures: dict[str, bytes] = pickle.loads(answer)
        return figures

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the process if it is still waiting for a record."""
        if self._process is not None:
            with self._process as process:
                process.kill()


def _draw_what_is_sent() -> None:
    gc.disable()  # the process is too short-lived to need it
    from gough_stewart.harness.results.figures import run_figures

    drawn = pickle.load(sys.stdin.buffer)
    if sys.platform == "linux":  # on other systems a fork may break libraries
        figures = _drawn_by_two(drawn)
    else:
        figures = run_figures(drawn)
    sys.stdout.buffer.write(pickle.dumps(figures))
    sys.stdout.flush()
    os._exit(0)  # cleaning up after all imports would take 0.1 s


def _drawn_by_two(drawn: Drawn) -> dict[str, bytes]:
    """Draw half of the figures in a fork of this process, which has everything imported."""
    from gough_stewart.harness.results.figures import run_figures

    reader, writer = os.pipe()
    if os.fork() == 0:
        with os.fdopen(writer, "wb") as there:
            pickle.dump(run_figures(drawn, FIGURES[2:]), there)
        os._exit(0)
    os.close(writer)
    figures = run_figures(drawn, FIGURES[:2])
    with os.fdopen(reader, "rb") as there:
        figures.update(pickle.load(there))
    return figures


if __name__ == "__main__":
    _draw_what_is_sent()
