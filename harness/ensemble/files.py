"""The report of an ensemble as files: figures, an HTML page, records of the worst members with their pages."""

import shutil
from collections.abc import Mapping
from pathlib import Path

from gough_stewart.harness.ensemble.columns import metric_name
from gough_stewart.harness.ensemble.page import PAGE, ensemble_page
from gough_stewart.harness.ensemble.result import Ensemble
from gough_stewart.harness.ensemble.sensitivity import Sensitivity, sensitivity, sensitivity_sheet
from gough_stewart.harness.ensemble.statistics import worst_members
from gough_stewart.harness.ensemble.tables import ensemble_sheets
from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.experiment.plan import plan_from
from gough_stewart.harness.experiment.recording import records_of
from gough_stewart.harness.output.tables import Sheet
from gough_stewart.harness.view.page import view_page
from gough_stewart.model.process.files import write_files

WORST = "worst"
# The default metric that ranks the worst members: the first of these that exists.
_WORST_BY = ("tracking.position.norm_peak", "force.peak")


def write_report(found: Ensemble, folder: Path) -> tuple[list[str], list[Sheet]]:
    """Write figures, page and the worst members' records; returns their names, and tables for the terminal.

    Raises
    ------
    OSError
        They cannot be written.
    """
    # its import takes as long as some of the pictures
    from gough_stewart.harness.ensemble.figures import ensemble_figures

    by = worst_by(found)
    known = _sensitivity(found, by)
    worst = _write_worst(found, by, folder)
    page = ensemble_page(found, by, worst, () if known is None else (known,))
    files = {**ensemble_figures(found, by, known), PAGE: page}
    write_files(folder, files)
    sheets = ensemble_sheets(found.members)
    return [*files, *([WORST] if worst else [])], sheets if known is None else [*sheets, sensitivity_sheet(known)]


def worst_by(found: Ensemble) -> str:
    """The metric that ranks the worst members: the experiment's, or that of tracking."""
    chosen = found.metadata["experiment"]["ensemble"]["worst_by"]
    if chosen is not None:
        return metric_name(found.members, chosen)
    return next(name for name in _WORST_BY if name in found.metrics)


def _sensitivity(found: Ensemble, by: str) -> Sensitivity | None:
    """None if too few members have run, or no number varies."""
    try:
        return sensitivity(found, by)
    except RecordError:
        return None


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
