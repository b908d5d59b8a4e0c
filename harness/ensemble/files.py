"""The worst members of an ensemble as files: their records, each with a page if pages are asked for."""

import shutil
from pathlib import Path

from gough_stewart.harness.ensemble.report import worst_by
from gough_stewart.harness.ensemble.result import Ensemble
from gough_stewart.harness.ensemble.statistics import worst_members
from gough_stewart.harness.experiment.plan import plan_from
from gough_stewart.harness.experiment.recording import records_of
from gough_stewart.model.process.files import Content, write_files

WORST = "worst"


def write_worst(found: Ensemble, folder: Path, *, pages: bool = False) -> dict[int, str]:
    """Run the worst members again and write their records; returns for each the address of its page, or "".

    Raises
    ------
    OSError
        They cannot be written.
    """
    number = found.metadata["experiment"]["ensemble"]["worst"]
    members = worst_members(found.members, worst_by(found), number)
    shutil.rmtree(folder / WORST, ignore_errors=True)  # those of an older run
    links = {}
    for member, record in zip(members, records_of(plan_from(found.metadata["plan"]), members), strict=True):
        name = f"{WORST}/member-{member}"
        files: dict[str, Content] = {"record.parquet": record.to_parquet(), "metadata.json": record.to_metadata()}
        if pages:
            from gough_stewart.harness.view.page import PAGE, view_page

            files[PAGE] = view_page([record], [f"member {member}"])
        write_files(folder / name, files)
        links[member] = f"{name}/{PAGE}" if pages else ""
    return links
