"""The page of a run, or of several over each other."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.report.document import Part, Report, Section
from gough_stewart.harness.report.page import PAGE, page_of
from gough_stewart.harness.report.scene import Scene
from gough_stewart.harness.report.table import Table
from gough_stewart.harness.results.record import Record, machine_of
from gough_stewart.harness.results.run_charts import DrawnRun, shown
from gough_stewart.harness.view.comparison import comparison_report
from gough_stewart.model.errors import GoughStewartError

__all__ = ["MOST_RECORDS", "PAGE", "names_of", "view_page", "view_report"]

# As many as there are colours that differ enough.
MOST_RECORDS = 6


def view_page(records: Sequence[Record], names: Sequence[str], more: Sequence[Table] = ()) -> bytes:
    """Create the page of one record, or of several over each other; the same records give the same bytes."""
    return page_of(view_report(records, names, more))


def view_report(records: Sequence[Record], names: Sequence[str], more: Sequence[Table] = ()) -> Report:
    """The report of one run, or of several over each other.

    Rows from the first one that is not finite are left out of charts and animation; tables use all rows.

    Parameters
    ----------
    records
        Records of runs, or read from files.
    names
        Name of each record.
    more
        Further tables, shown before the others.

    Raises
    ------
    RecordError
        There is no record, more than `MOST_RECORDS`, or one without a finite row, its platform, or a column that is
        drawn.
    """
    if not 1 <= len(records) <= MOST_RECORDS:
        raise RecordError(f"{len(records)} records; expected 1 to {MOST_RECORDS} of them on a page")
    drawn = [_shown(record, name) for record, name in zip(records, names, strict=True)]
    if len(records) > 1:
        report = comparison_report(records, drawn, " · ".join(names))
    else:
        report = records[0].report()
        sections = tuple(
            replace(each, parts=tuple(_named(part, names[0]) for part in each.parts)) for each in report.sections
        )
        report = replace(report, title=str(records[0].metadata.get("title", names[0])), sections=sections)
    return replace(report, sections=(Section("Results", tuple(more)), *report.sections)) if more else report


def names_of(paths: Sequence[Path]) -> list[str]:
    """Names for the records of these files: the names of their folders if those differ, otherwise their paths."""
    folders = [path.absolute() if path.is_dir() else path.absolute().parent for path in paths]
    names = [folder.name for folder in folders]
    return names if len(set(names)) == len(names) else [str(path) for path in paths]


def _named(part: Part, name: str) -> Part:
    return replace(part, name=name) if isinstance(part, Scene) else part


def _shown(record: Record, name: str) -> DrawnRun:
    if not record.metadata.get("outcome"):
        raise RecordError(f"{name}: the metadata have no outcome; expected what `gough-stewart run` writes")
    try:
        found = shown(record, machine_of(record), name)
    except GoughStewartError as error:
        raise RecordError(f"{name}: {error}") from error
    if found is None:
        raise RecordError(f"{name}: no row with finite values; there is nothing to show")
    return found
