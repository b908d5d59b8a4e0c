"""The worst members of an ensemble and the nominal machine as files: records, and pages if they are asked for."""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from gough_stewart.harness.ensemble.beside import beside_nominal, with_beside
from gough_stewart.harness.ensemble.report import worst_by
from gough_stewart.harness.ensemble.result import Ensemble
from gough_stewart.harness.ensemble.statistics import worst_members
from gough_stewart.harness.experiment.plan import plan_from
from gough_stewart.harness.experiment.run import records_of
from gough_stewart.harness.report.document import Report, Section
from gough_stewart.harness.results.record import Record
from gough_stewart.model.process.files import Content, write_files

WORST = "worst"


class Worst(NamedTuple):
    """The worst members as files, and what is shown of the first one."""

    links: dict[int, str]  # the address of each one's page, or ""
    section: Section | None  # beside the nominal machine; None without members
    page: str  # of the nominal machine and the worst members over each other; "" for none

    def shown_in(self, report: Report) -> Report:
        """The report with the worst member beside the nominal machine."""
        return report if self.section is None else with_beside(report, self.section, self.page)


def write_worst(found: Ensemble, folder: Path, *, pages: bool = False) -> Worst:
    """Run the nominal machine and the worst members again, and write their records.

    Raises
    ------
    OSError
        They cannot be written.
    """
    number = found.metadata["experiment"]["ensemble"]["worst"]
    members = worst_members(found.members, worst_by(found), number)
    shutil.rmtree(folder / WORST, ignore_errors=True)  # those of an older run
    if not members:
        return Worst({}, None, "")
    links = {}
    records = records_of(plan_from(found.metadata["plan"]), [None, *members])
    for member, record in zip([None, *members], records, strict=True):
        name = f"{WORST}/nominal" if member is None else f"{WORST}/member-{member}"
        files: dict[str, Content] = {"record.parquet": record.to_parquet(), "metadata.json": record.to_metadata()}
        if pages:
            from gough_stewart.harness.view.page import PAGE, view_page

            files[PAGE] = view_page([record], ["nominal machine" if member is None else f"member {member}"])
        write_files(folder / name, files)
        if member is not None:
            links[member] = f"{name}/{PAGE}" if pages else ""
    page = _write_page(folder, members, records) if pages else ""
    section = beside_nominal(records[0], records[1], members[0], page, links[members[0]])
    return Worst(links, section, page)


def _write_page(folder: Path, members: Sequence[int], records: Sequence[Record]) -> str:
    """Write a page of the nominal machine and the worst members over each other; returns its address."""
    from gough_stewart.harness.view.page import MOST_RECORDS, PAGE, view_page

    names = ["nominal machine", *(f"member {member}" for member in members)]
    page = view_page(records[:MOST_RECORDS], names[:MOST_RECORDS])
    write_files(folder / WORST, {PAGE: page})
    return f"{WORST}/{PAGE}"
