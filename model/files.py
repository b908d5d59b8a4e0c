"""Files are written whole or not at all, and those that belong together as one set: beside the old ones, then moved."""

import os
import shutil
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from gough_stewart.model.errors import OutputError

# The content of a file, or what writes it to a path.
Content = bytes | Callable[[Path], None]


def check_output_folder(folder: Path, names: Iterable[str]) -> None:
    """Refuse a place where files of these names cannot be written, before anything is computed.

    Raises
    ------
    OutputError
        It is a file, or neither it nor a folder above it can be written, or a folder has one of the names.
    """
    place = folder.absolute()
    while not os.path.lexists(place) and place != place.parent:
        place = place.parent
    if not place.is_dir():
        what = "a link that leads nowhere" if place.is_symlink() and not place.exists() else "a file"
        raise OutputError(f"output folder {folder}: {place} is {what}; expected a folder, existing or new")
    if not os.access(place, os.W_OK | os.X_OK):
        raise OutputError(f"output folder {folder}: no permission to write in {place}; choose another folder")
    for name in names:
        if (folder / name).is_dir():
            raise OutputError(f"output folder {folder}: {name} is a folder there; expected a file or nothing")


def write_whole(path: Path, content: Content) -> None:
    """Replace or create a file in one step; an interrupted write leaves what was there before."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}.part")
    try:
        if isinstance(content, bytes):
            beside.write_bytes(content)
        else:
            content(beside)
        beside.replace(path)
    except OSError as error:
        beside.unlink(missing_ok=True)
        # the user knows the target, not the file beside it
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


@dataclass(frozen=True)
class FileSet:
    """Files on their way to a folder; see `file_set`."""

    folder: Path
    beside: Path
    names: list[str] = field(default_factory=list)

    def add(self, name: str, content: Content) -> None:
        """One more file, whole."""
        try:
            write_whole(self.beside / name, content)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.folder / name)) from error
        self.names.append(name)


@contextmanager
def file_set(folder: Path, names: Iterable[str], owned: Iterable[str] = ()) -> Iterator[FileSet]:
    """A set of files that takes the place of an older one in a folder, which is made if needed.

    What is added lies beside until the end. Then files of the older set go, and the new ones are moved to their
    places, also when an error or an interrupt ends the set early: what came first is there, nothing old is beside it,
    and a note on the error names what is missing. A set without a file leaves the folder as it was.

    Parameters
    ----------
    folder
        Where the files go.
    names
        What is to be added.
    owned
        What an older set may have besides.
    """
    wanted = tuple(names)
    folder.mkdir(parents=True, exist_ok=True)
    files = FileSet(folder, Path(tempfile.mkdtemp(prefix=".", suffix=".part", dir=folder)))
    try:
        yield files
    except BaseException as error:
        missing = [name for name in wanted if name not in files.names]
        if files.names and missing:
            error.add_note(f"{folder} has {', '.join(files.names)}; missing: {', '.join(missing)}")
        raise
    finally:
        older = {*wanted, *owned} if files.names else set()
        try:
            _swap_in(files, older)
        except KeyboardInterrupt:  # at the wrong moment: half a set is worse than a moment more
            _swap_in(files, older)
            raise


def write_files(folder: Path, files: Mapping[str, Content], owned: Iterable[str] = ()) -> None:
    """Write files by name as one set into a folder that is made if needed; see `file_set`."""
    with file_set(folder, files, owned) as new:
        for name, content in files.items():
            new.add(name, content)


def _swap_in(files: FileSet, older: set[str]) -> None:
    """Old files go first, so that none is ever beside a new one; to be called again if it was interrupted."""
    new = [name for name in files.names if (files.beside / name).exists()]
    in_place = set(files.names) - set(new)
    try:
        for name in older - in_place:
            (files.folder / name).unlink(missing_ok=True)
        for name in new:
            (files.beside / name).replace(files.folder / name)
    except OSError as error:
        error.add_note(f"the new files are in {files.beside}")
        raise
    shutil.rmtree(files.beside, ignore_errors=True)
