"""The files of a run: record, metadata, metrics, figures, page; written as one set."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gough_stewart.harness.report.document import Note, Number, Report
from gough_stewart.harness.report.page import PAGE, page_of
from gough_stewart.harness.report.quantities import LENGTH
from gough_stewart.harness.report.requirements import Required, with_requirements
from gough_stewart.harness.report.words import exactly
from gough_stewart.harness.results.metric_folds import METRICS
from gough_stewart.harness.results.metrics import metrics, metrics_json
from gough_stewart.harness.results.record import Record, platform_of
from gough_stewart.harness.results.run_report import Robustness
from gough_stewart.model.process.files import Content, check_output_folder, file_set

# Of the groups of charts that a run shows at first, in their order.
_FIGURES = [f"{name}.{kind}" for name in ("errors", "pose", "actuators", "legs") for kind in ("pdf", "png", "svg")]
# The record is written first, beginning with its smallest complete form.
_FILES = ["record.parquet", "record.csv", "metadata.json", "metrics.json"]

# The last part of a run, in which a platform at rest moves less than this share of its error.
_LAST_PART = 0.2
_AT_REST = 0.02
# A noticeable error, as a share of the mean leg length.
_NOTICEABLE = 1e-4


class Written(NamedTuple):
    """The names of the files of a run, and its report."""

    files: list[str]
    report: Report


def names_of_files(page: bool = True, figures: bool = True) -> list[str]:
    """The files that `write_results` may write."""
    return [*_FILES, *(_FIGURES if figures else ()), *([PAGE] if page else ())]


def write_results(
    record: Record,
    folder: Path,
    *,
    page: bool = False,
    figures: bool = False,
    charts: bool = False,
    requirements: Sequence[Required] = (),
    notes: Sequence[Note] = (),
    robustness: Robustness | None = None,
) -> Written:
    """Write all files of a run as one set, optionally with page and figures.

    If something fails, the files before it are complete, beginning with the record, and no file of an older run
    remains; see `file_set`. `charts` are in the report for other uses than these files.
    """
    with (
        file_set(folder, names_of_files(page, figures), names_of_files()) as files,
        ThreadPoolExecutor(1) as aside,  # polars releases the GIL
    ):
        first: dict[str, Content] = {
            "record.parquet": record.write_parquet,
            "record.csv": record.write_csv,
            "metadata.json": record.to_metadata(),
        }
        written = aside.submit(files.add, first)
        measured = metrics(record)
        report = record.report(measured=measured, robustness=robustness, charts=page or figures or charts)
        report = replace(report, notes=(*report.notes, *notes))
        if requirements:
            report = with_requirements(_with_undefined(report, requirements), requirements)
        more: dict[str, Content] = {"metrics.json": metrics_json(measured)}
        if figures:
            from gough_stewart.harness.report.figures import figures as drawn

            more |= drawn(report)
        if page:
            more[PAGE] = page_of(report)
        written.result()
        files.add(more)
    return Written(files.names, report)


def _with_undefined(report: Report, requirements: Sequence[Required]) -> Report:
    """With the metrics that are required and that this run does not have, such as a settling time without a step."""
    required, known = ({part.path for part in parts} for parts in (requirements, report.numbers))
    missing = [Number(m.path, m.text, None, m.quantity) for m in METRICS if m.path in required - known]
    return replace(report, numbers=(*report.numbers, *missing))


def save_record(record: Record, folder: Path | str, report: bool = False, figures: bool = False) -> list[Path]:
    """Write all files of a run as `gough-stewart run` does; `read_record` and `view` accept the folder.

    Parameters
    ----------
    record
        From `run`.
    folder
        Created if needed. Gets record.csv, record.parquet, metadata.json, metrics.json.
    report
        Also write report.html, the HTML page.
    figures
        Also draw errors, pose, forces and legs, each as PDF, PNG and SVG.

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
    written = write_results(record, folder, page=report, figures=figures)
    return [folder / name for name in written.files]


def warnings_of(record: Record) -> list[str]:
    """Limits that a run exceeded, and a static error at its end; a stroke that it was to ignore is left out."""
    warnings = _static_error(record)
    feedforward, limit = np.abs(record["controller.feedforward"]), record.metadata["force_limit"]
    if limit is not None and feedforward.max() > limit:
        row, leg = (int(k) for k in np.unravel_index(feedforward.argmax(), feedforward.shape))
        warnings.append(
            f"feedforward requires {feedforward[row, leg]:.4g} N of leg {leg + 1} at {record['time'][row]:.6g} s; its "
            f"force limit is {limit:.4g} N. Make the reference slower or smaller; if it is a noisy recording, smooth it"
        )
    exceeded = record["flag.stroke_exceeded"]
    if record.metadata["experiment"]["limits"]["stroke"] == "warn" and exceeded.any():
        row, leg = (int(k) for k in np.argwhere(exceeded)[0])
        length, time = record["leg_length"][row, leg], record["time"][row]
        warnings.append(
            f"leg {leg + 1} left its stroke at {time:.6g} s with a length of {length:.6g} m; see flag.stroke_exceeded"
        )
    return warnings


def _static_error(record: Record) -> list[str]:
    """What a platform that rests off its reference needs: a feedforward of gravity, or an integral; empty otherwise.

    At rest a PD acts as a spring, F = kp e, so the error is what the load, here the platform's weight, takes of it.
    """
    choice = record.metadata["experiment"]["controller"]
    if choice.get("type") != "pd" or choice.get("feedforward", "none") != "none" or "error.position" not in record:
        return []
    first = int((1 - _LAST_PART) * record.table.height)
    error, reference = record["error.position"][first:], record["reference.position"][first:]
    if len(error) < 2 or np.ptp(reference, axis=0).any() or not np.isfinite(error).all():
        return []
    mean = error.mean(axis=0)
    distance, scale = float(np.linalg.norm(mean)), float(record["leg_length"][0].mean())
    if distance < _NOTICEABLE * scale or np.abs(error - mean).max() > _AT_REST * distance:
        return []
    gravity = platform_of(record).gravity
    # e = reference − position points against gravity where the platform hangs below
    along = -float(mean @ gravity) / (distance * float(np.linalg.norm(gravity)) or 1.0)
    size = exactly(LENGTH, distance, 3)
    how = f"hangs {size} below" if along > 0.9 else f"rests {size} off"
    return [
        f"the platform {how} its reference at the end: the load over the stiffness of its PD; "
        "set controller.feedforward = 'gravity', or use a PID, whose integral takes it away"
    ]
