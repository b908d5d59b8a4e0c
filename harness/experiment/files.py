"""The files of a run: record, metadata, metrics, figures; made purely, then written."""

from pathlib import Path

import numpy as np
from rich.console import RenderableType

from gough_stewart.harness.results.figures import FIGURES, run_figures
from gough_stewart.harness.results.metrics import metrics, metrics_json
from gough_stewart.harness.results.record import Record
from gough_stewart.harness.results.tables import metrics_table
from gough_stewart.harness.view.page import PAGE, view_page
from gough_stewart.model.files import check_output_folder, write_files


def names_of_files() -> list[str]:
    """What `record_files` and `result_files` may make."""
    figures = [f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg")]
    return ["record.csv", "record.parquet", "metadata.json", "metrics.json", *figures, PAGE]


def record_files(record: Record) -> dict[str, bytes]:
    """The run itself by file name; quick, so that it can be written before anything else may go wrong."""
    return {
        "record.csv": record.to_csv(),
        "record.parquet": record.to_parquet(),
        "metadata.json": record.to_metadata(),
    }


def result_files(record: Record, report: bool = False) -> tuple[dict[str, bytes], RenderableType]:
    """Metrics, figures and, if wanted, the page by file name, and the metrics as tables for the terminal."""
    measured = metrics(record)
    files = {"metrics.json": metrics_json(measured), **run_figures(record)}
    if report:
        files[PAGE] = view_page([record], [record.metadata["title"]])
    return files, metrics_table(measured)


def save_record(record: Record, folder: Path | str, report: bool = False) -> list[Path]:
    """Write all files of a run as `gough-stewart run` does; `read_record` and `view` take the folder.

    Parameters
    ----------
    record
        What `run` gave.
    folder
        Made if needed. Gets record.csv, record.parquet, metadata.json, metrics.json, and figures as PNG and SVG.
    report
        Write report.html, the page for the browser, too.

    Raises
    ------
    OutputError
        The files cannot be written there.

    Examples
    --------
    >>> gs.save_record(gs.run("heave_step"), "results/heave")
    """
    folder = Path(folder)
    check_output_folder(folder, names_of_files())
    files = record_files(record) | result_files(record, report)[0]
    write_files(folder, files)
    return [folder / name for name in files]


def warnings_of(record: Record) -> list[str]:
    """What a run did that no machine may do, and yet went on; unless it was told to ignore the stroke."""
    exceeded = record["flag.stroke_exceeded"]
    if record.metadata["experiment"]["limits"]["stroke"] != "warn" or not exceeded.any():
        return []
    row, leg = (int(k) for k in np.argwhere(exceeded)[0])
    length, time = record["leg_length"][row, leg], record["time"][row]
    return [f"leg {leg + 1} has left its stroke at {time:.6g} s, {length:.6g} m long; see flag.stroke_exceeded"]
