"""The report of an ensemble as files: figures, an HTML page, records of the worst members with their pages."""

import shutil
from collections.abc import Mapping
from pathlib import Path

from gough_stewart.harness.ensemble.report import ensemble_report, worst_by
from gough_stewart.harness.ensemble.result import Ensemble
from gough_stewart.harness.ensemble.sensitivity import sensitivity_if_known
from gough_stewart.harness.ensemble.statistics import worst_members
from gough_stewart.harness.experiment.plan import plan_from
from gough_stewart.harness.experiment.recording import records_of
from gough_stewart.harness.report.document import Report
from gough_stewart.harness.report.page import PAGE, page_of
from gough_stewart.harness.view.page import view_page
from gough_stewart.model.process.files import write_files

WORST = "worst"


def write_report(found: Ensemble, folder: Path) -> tuple[list[str], Report]:
    """Write figures, page and the worst members' records; returns their names, and the report.

    Raises
    ------
    OSError
        They cannot be written.
    """
    # its import takes as long as some of the pictures
    from gough_stewart.harness.ensemble.figures import ensemble_figures

    by = worst_by(found)
    known = sensitivity_if_known(found, by)
    worst = _write_worst(found, by, folder)
    files = {**ensemble_figures(found, by, known), PAGE: page_of(ensemble_report(found, by, known, worst))}
    write_files(folder, files)
    report = ensemble_report(found, by, known, list(worst), charts=False)
    return [*files, *([WORST] if worst else [])], report


def write_figures(report: Report, folder: Path) -> list[str]:
    """Draw the charts of a report, each as PDF, PNG and SVG; returns the names of the files."""
    from gough_stewart.harness.report.figures import figures

    files = figures(report)
    write_files(folder, files)
    return list(files)


def _write_worst(found: Ensemble, by: str, folder: Path) -> Mapping[int, str]:
    """Write their records; returns for each member the address of its page."""
    number = found.metadata["experiment"]["ensemble"]["worst"]
    members = worst_members(found.members, by, number)
    shutil.rmtree(folder / WORST, ignore_errors=True)  # those of an older run
    links = {}
    for member, record in zip(members, records_of(plan_from(found.metadata["plan"]), members), strict=True):
        name = f"{WORST}/member-{member}"
        files = {
            "record.parquet": record.to_parquet(),
            "metadata.json": record.to_metadata(),
            "report.html": view_page([record], [f"member {member}"]),
        }
        write_files(folder / name, files)
        links[member] = f"{name}/report.html"
    return links
