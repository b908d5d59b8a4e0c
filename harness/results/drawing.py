"""The figures of a run, drawn by a process of their own that gets ready while the run goes on.

Importing matplotlib and drawing take half as long as a run of ten seconds, and Python's lock lets no thread do it
beside the loop.
"""

import pickle
import subprocess
import sys
from types import TracebackType
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from gough_stewart.harness.results.record import Record

FIGURES = ("pose", "errors", "forces", "legs")
# The process has a copy of the record.
_MOST_ROWS = 100_000


def draw_here(record: "Record") -> dict[str, bytes]:
    """As `run_figures`, imported when it is called."""
    from gough_stewart.harness.results.figures import run_figures

    return run_figures(record)


class Drawing:
    """Draws like `run_figures` in another process, which is there from the beginning of a `with` to its end."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        """Start the process: it imports what it needs, and waits."""
        # -P: what lies in the user's folder is no module of ours
        command = [sys.executable, "-P", "-m", __name__]
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C ends the loop, and what ran so far is drawn
            )
        except OSError:  # no more processes: there is one here
            self._process = None
        return self

    def __call__(self, record: "Record") -> dict[str, bytes]:
        """Figures by file name; drawn here if the process cannot, where whatever is wrong shows."""
        if self._process is None or record.table.height > _MOST_ROWS:
            return draw_here(record)
        process, self._process = self._process, None
        with process:
            try:
                answer, _ = process.communicate(pickle.dumps(record))
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
        """End the process, if it still waits for a record."""
        if self._process is not None:
            with self._process as process:
                process.kill()


def _draw_what_is_sent() -> None:
    from gough_stewart.harness.results.figures import run_figures

    record = pickle.load(sys.stdin.buffer)
    sys.stdout.buffer.write(pickle.dumps(run_figures(record)))


if __name__ == "__main__":
    _draw_what_is_sent()
