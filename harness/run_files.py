"""The files of a run: record, metadata, metrics, figures; made purely, then written."""

import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context

from rich.console import RenderableType

from gough_stewart.harness.metrics import metrics, metrics_json, metrics_table
from gough_stewart.harness.record import Record
from gough_stewart.harness.run_figures import FIGURES, run_figures

# Of so many rows on, figures take longer than another process takes to start.
_LONG = 3000
Figures = Callable[[], dict[str, bytes]]
Draw = Callable[[Record], Figures]


def names_of_files() -> list[str]:
    """What `run_files` may make."""
    figures = [f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg")]
    return ["record.csv", "record.parquet", "metadata.json", "metrics.json", *figures]


@contextmanager
def drawing_aside(rows: int) -> Iterator[Draw]:
    """What begins to draw the figures of a record; of a long one in a process beside, which gets ready meanwhile."""
    if rows < _LONG:
        yield _at_once
        return
    # spawn: a fork of a process with threads may hang
    with ProcessPoolExecutor(1, get_context("spawn"), initializer=_get_ready) as beside:
        beside.submit(_get_ready)  # starts it
        yield lambda record: beside.submit(run_figures, record).result


def run_files(record: Record, draw: Draw | None = None) -> tuple[dict[str, bytes], RenderableType]:
    """Contents by file name, and the metrics as tables for the terminal; `draw` as from `drawing_aside`."""
    with ThreadPoolExecutor(1) as aside:  # polars works outside of Python's lock
        csv = aside.submit(record.to_csv)
        figures = (draw or _at_once)(record)
        measured = metrics(record)
        files = {
            "record.csv": csv.result(),
            "record.parquet": record.to_parquet(),
            "metadata.json": record.to_metadata(),
            "metrics.json": metrics_json(measured),
            **figures(),
        }
    return files, metrics_table(measured)


def _at_once(record: Record) -> Figures:
    files = run_figures(record)
    return lambda: files


def _get_ready() -> None:
    # Ctrl-C goes to all processes of a terminal; the one that runs the experiment decides
    signal.signal(signal.SIGINT, signal.SIG_IGN)
