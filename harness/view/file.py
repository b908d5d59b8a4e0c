"""Records on a page in a file."""

import webbrowser
from collections.abc import Iterable, Sequence
from pathlib import Path

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.results.record import Record, read_record
from gough_stewart.harness.view.page import PAGE, names_of, view_page
from gough_stewart.model.errors import OutputError
from gough_stewart.model.files import check_output_folder, write_files
from gough_stewart.model.progress import StepProgress

Shown = Record | Path | str


def view(
    records: Shown | Iterable[Shown],
    out: Path | str = PAGE,
    *,
    names: Sequence[str] | None = None,
    show: bool = False,
    progress: StepProgress | None = None,
) -> Path:
    """Write one page for the browser: the platform moving in 3-D beside curves, metrics and parameters.

    The page needs nothing else: no network, no server, no other file. Several records are laid over each other.

    Parameters
    ----------
    records
        A `Record`, or a folder or file of one; or up to six of them.
    out
        The page to write, a name in .html; its folder is made if needed.
    names
        What to call each record; by default the folder, or the title of what is in no file.
    show
        Open the page in the browser.
    progress
        Called with what is being done.

    Raises
    ------
    RecordError
        No record, more than six, or one that cannot be read or drawn; or not as many names as records.
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
    given = [records] if isinstance(records, Record | Path | str) else list(records)
    check_output_folder(out.parent, [out.name])
    say("reading")
    read = [each if isinstance(each, Record) else read_record(each) for each in given]
    called = _names(given) if names is None else list(names)
    if len(called) != len(read):
        raise RecordError(f"{len(called)} names for {len(read)} records; expected one for each")
    say("making the page")
    write_files(out.parent, {out.name: view_page(read, called)})
    if show:
        webbrowser.open(out.absolute().as_uri())
    return out


def _names(records: Sequence[Shown]) -> list[str]:
    """Of files as on the command line; of others their titles, numbered where those are the same."""
    paths = [Path(each) for each in records if not isinstance(each, Record)]
    of_files = iter(names_of(paths))
    names = [
        str(each.metadata.get("title", "record")) if isinstance(each, Record) else next(of_files) for each in records
    ]
    if len(set(names)) == len(names):
        return names
    return [f"{name} ({k + 1})" if names.count(name) > 1 else name for k, name in enumerate(names)]
