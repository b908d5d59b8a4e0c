"""Writes a page of records to a file."""

import webbrowser
from collections.abc import Iterable, Sequence
from pathlib import Path

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.results.record import Record, read_record
from gough_stewart.harness.view.page import PAGE, names_of, view_page
from gough_stewart.model.errors import OutputError
from gough_stewart.model.process.files import check_output_folder, write_files
from gough_stewart.model.process.progress import StepProgress

DrawnRun = Record | Path | str


def view(
    records: DrawnRun | Iterable[DrawnRun],
    out: Path | str = PAGE,
    *,
    names: Sequence[str] | None = None,
    show: bool = False,
    progress: StepProgress | None = None,
) -> Path:
    """Write one page for the browser: the platform in 3-D motion, with charts, metrics and parameters.

    The page is self-contained: it needs no network, server or other file. Several records are overlaid.

    Parameters
    ----------
    records
        A `Record`, or the folder or file of one; or a sequence of up to six.
    out
        The page to write, ending in .html; its folder is created if needed.
    names
        Name of each record; by default its folder, or the title of a record without a file.
    show
        Open the page in the browser.
    progress
        Called with the name of each step.

    Returns
    -------
    Path
        The page written.

    Raises
    ------
    RecordError
        There is no record, more than six, or one that cannot be read or drawn; or the number of names differs.
    OutputError
        The page cannot be written there.

    Examples
    --------
    >>> records = [gs.run("pitch_sine", {"controller.bandwidth": hertz, "loop.duration": 0.1}) for hertz in (2, 4)]
    >>> page = gs.view(records, "bandwidths.html", names=["2 Hz", "4 Hz"])
    """
    out, say = Path(out), progress or (lambda _what: None)
    if out.suffix not in (".html", ".htm"):
        raise OutputError(f"{out}: expected the name of a page, such as {out}.html")
    items = [records] if isinstance(records, Record | Path | str) else list(records)
    check_output_folder(out.parent, [out.name])
    say("reading")
    read = [each if isinstance(each, Record) else read_record(each) for each in items]
    labels = _names(items) if names is None else list(names)
    if len(labels) != len(read):
        raise RecordError(f"{len(labels)} names for {len(read)} records; expected one per record")
    say("writing the page")
    write_files(out.parent, {out.name: view_page(read, labels)})
    if show:
        webbrowser.open(out.absolute().as_uri())
    return out


def _names(records: Sequence[DrawnRun]) -> list[str]:
    """Names of files as on the command line; for other records their titles, numbered if they are equal."""
    paths = [Path(each) for each in records if not isinstance(each, Record)]
    of_files = iter(names_of(paths))
    names = [
        str(each.metadata.get("title", "record")) if isinstance(each, Record) else next(of_files) for each in records
    ]
    if len(set(names)) == len(names):
        return names
    return [f"{name} ({k + 1})" if names.count(name) > 1 else name for k, name in enumerate(names)]
