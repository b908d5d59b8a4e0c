"""The files of a run: record, metadata, metrics, figures, page; written as one set."""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from gough_stewart.harness.experiment.hints import static_error
from gough_stewart.harness.results.metrics import Metrics, metrics, metrics_json
from gough_stewart.harness.results.record import Record
from gough_stewart.harness.view.page import PAGE, view_page
from gough_stewart.model.process.files import Content, FileSet, check_output_folder, file_set

# Those of `run_figures`, whose module takes long to import.
_FIGURE_FILES = [f"{name}.{kind}" for name in ("pose", "errors", "forces", "legs") for kind in ("png", "svg")]
# The record is written first, beginning with its smallest complete form.
_FILES = ["record.parquet", "record.csv", "metadata.json", "metrics.json", *_FIGURE_FILES]


def names_of_files() -> list[str]:
    """The files that `write_results` may write."""
    return [*_FILES, PAGE]


def write_results(record: Record, folder: Path, report: bool = False) -> tuple[list[str], Metrics]:
    """Write all files of a run as one set, optionally with the page; returns their names, and the metrics.

    If something fails, the files before it are complete, beginning with the record, and no file of an older run
    remains; see `file_set`.
    """
    with (
        file_set(folder, names_of_files() if report else _FILES, [PAGE]) as files,
        ThreadPoolExecutor(1) as aside,  # polars releases the GIL
    ):
        first: dict[str, Content] = {
            "record.parquet": record.write_parquet,
            "record.csv": record.write_csv,
            "metadata.json": record.to_metadata(),
        }
        written = aside.submit(_add, files, first)
        more, measured = _result_files(record, report)
        written.result()
        _add(files, more)
    return files.names, measured


def _add(files: FileSet, contents: Mapping[str, Content]) -> None:
    for name, content in contents.items():
        files.add(name, content)


def _result_files(record: Record, report: bool) -> tuple[dict[str, bytes], Metrics]:
    """Metrics, figures and, if requested, the page by file name; and the metrics themselves."""
    from gough_stewart.harness.results.figures import run_figures

    measured = metrics(record)
    files = {"metrics.json": metrics_json(measured), **run_figures(record)}
    if report:
        files[PAGE] = view_page([record], [record.metadata["title"]])
    return files, measured


def save_record(record: Record, folder: Path | str, report: bool = False) -> list[Path]:
    """Write all files of a run as `gough-stewart run` does; `read_record` and `view` accept the folder.

    Parameters
    ----------
    record
        From `run`.
    folder
        Created if needed. Gets record.csv, record.parquet, metadata.json, metrics.json, and figures as PNG and SVG.
    report
        Also write report.html, the HTML page.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    OutputError, OSError
        The files cannot be written there.

    Examples
    --------
    >>> record = gs.run("heave_step", {"loop.duration": 0.1})
    >>> files = gs.save_record(record, "results/heave", report=True)
    """
    folder = Path(folder)
    check_output_folder(folder, names_of_files())
    return [folder / name for name in write_results(record, folder, report)[0]]


def warnings_of(record: Record) -> list[str]:
    """Limits that a run exceeded, and a static error at its end; a stroke that it was to ignore is left out."""
    found = static_error(record)
    feedforward, limit = np.abs(record["controller.feedforward"]), record.metadata["force_limit"]
    if limit is not None and feedforward.max() > limit:
        row, leg = (int(k) for k in np.unravel_index(feedforward.argmax(), feedforward.shape))
        found.append(
            f"feedforward requires {feedforward[row, leg]:.4g} N of leg {leg + 1} at {record['time'][row]:.6g} s; its "
            f"force limit is {limit:.4g} N. Make the reference slower or smaller; if it is a noisy recording, smooth it"
        )
    exceeded = record["flag.stroke_exceeded"]
    if record.metadata["experiment"]["limits"]["stroke"] == "warn" and exceeded.any():
        row, leg = (int(k) for k in np.argwhere(exceeded)[0])
        length, time = record["leg_length"][row, leg], record["time"][row]
        found.append(
            f"leg {leg + 1} left its stroke at {time:.6g} s with a length of {length:.6g} m; see flag.stroke_exceeded"
        )
    return found
