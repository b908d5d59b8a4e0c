"""Atomic writing of files and of sets of files: written to temporary places, then moved.

Each temporary place is locked as long as its process lives. A process that is killed leaves its temporary files,
without the lock; the next command in the folder removes them.
"""

import logging
import os
import re
import secrets
import shutil
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from gough_stewart.model.errors import OutputError

try:
    import fcntl
except ImportError:  # Windows: nothing is locked, and nothing is removed
    fcntl = None  # type: ignore[assignment]

# The content of a file, or a function that writes it to a path.
Content = bytes | Callable[[Path], None]
_reserved: set[tuple[int, Path]] = set()
_NAME = re.compile(r"\.(?:.+\.)?[a-z0-9_]{8}\.part")
_log = logging.getLogger(__name__)


def check_output_folder(folder: Path, names: Iterable[str]) -> None:
    """Remove and log what killed processes left in a folder; `OutputError` if these files cannot be written there."""
    place = folder.absolute()
    while not os.path.lexists(place) and place != place.parent:
        place = place.parent
    if not place.is_dir():
        kind = "a broken link" if place.is_symlink() and not place.exists() else "a file"
        raise OutputError(f"output folder {folder}: {place} is {kind}; expected a folder, existing or new")
    if not os.access(place, os.W_OK | os.X_OK):
        raise OutputError(f"output folder {folder}: no permission to write in {place}; choose another folder")
    for name in names:
        if (folder / name).is_dir():
            raise OutputError(f"output folder {folder}: {name} is a folder there; expected a file or nothing")

    # what a living process writes stays
    removed = []
    paths = (path for path in sorted(folder.glob(".*.part")) if _NAME.fullmatch(path.name))
    for path in paths if fcntl is not None else ():
        with suppress(OSError):  # belongs to somebody else
            descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
            try:
                if lock(descriptor, path):
                    shutil.rmtree(path) if path.is_dir() else path.unlink()
                    removed.append(path.name)
            finally:
                os.close(descriptor)
    if removed:
        _log.info("removed from %s what a command left that was killed: %s", folder, ", ".join(removed))


@contextmanager
def reserved(folder: Path) -> Iterator[None]:
    """Keep an output folder for this thread, also nested; `OutputError` if another one does, or it is not writable."""
    check_output_folder(folder, ())
    is_new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    key = (threading.get_ident(), folder.resolve())
    if os.name != "posix" or key in _reserved:
        yield
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        if lock(descriptor) is False:
            raise OutputError(
                f"output folder {folder}: another command is writing there; wait for its end, or choose another folder"
            )
        _reserved.add(key)
        yield
    finally:
        _reserved.discard(key)
        os.close(descriptor)
        if is_new:
            with suppress(OSError):  # something is in it
                folder.rmdir()


def write_whole(path: Path, content: Content) -> None:
    """Create or replace a file atomically; an interrupted write leaves the old file unchanged."""
    try:
        with _temporary(path.parent, f".{path.name}", Path.touch) as temporary:
            if isinstance(content, bytes):
                temporary.write_bytes(content)
            else:
                content(temporary)
            temporary.replace(path)
    except OSError as error:
        # report the target to the user, not the temporary file
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


@dataclass(frozen=True)
class FileSet:
    """Temporary files of a set; see `file_set`."""

    folder: Path
    temporary: Path
    names: list[str] = field(default_factory=list)

    def add(self, contents: Mapping[str, Content]) -> None:
        """Add complete files by name, one after the other."""
        for name, content in contents.items():
            try:
                write_whole(self.temporary / name, content)
            except OSError as error:
                raise OSError(error.errno, error.strerror, str(self.folder / name)) from error
            self.names.append(name)


@contextmanager
def file_set(folder: Path, names: Iterable[str], owned: Iterable[str] = ()) -> Iterator[FileSet]:
    """A set of files that replaces an older set in a folder, which is created if needed.

    New files, of these `names`, are temporary until the end. Then those of the older set, which may have `owned` ones
    as well, are deleted, and the new ones moved to their places: also after an error, to which a note on missing files
    is added. An empty set does not change the folder.
    """
    expected = tuple(names)
    folder.mkdir(parents=True, exist_ok=True)
    with _temporary(folder, "", Path.mkdir) as temporary:
        files = FileSet(folder, temporary)
        try:
            yield files
        except BaseException as error:
            if files.names and (missing := [name for name in expected if name not in files.names]):
                error.add_note(f"{folder} has {', '.join(files.names)}; missing: {', '.join(missing)}")
            raise
        finally:
            older: set[str] = {*expected, *owned} if files.names else set()
            interrupt: KeyboardInterrupt | None = None
            # once more if interrupted, which then waits: an incomplete set is worse than a short delay
            for _ in range(2):
                new = [name for name in files.names if (temporary / name).exists()]
                in_place = set(files.names) - set(new)
                try:
                    # old files first, so that none is ever beside a new one
                    for name in older - in_place:
                        (folder / name).unlink(missing_ok=True)
                    for name in new:
                        (temporary / name).replace(folder / name)
                    break
                except KeyboardInterrupt as error:
                    interrupt = error
                except OSError as error:
                    # under a name that the next command does not take for a leftover
                    place = temporary.rename(temporary.with_name(f"not-moved{temporary.stem}"))
                    error.add_note(f"the new files are in {place}")
                    raise
            if interrupt is not None:
                raise interrupt


def write_files(folder: Path, files: Mapping[str, Content], owned: Iterable[str] = ()) -> None:
    """Write files by name as one set to a folder, which is created if needed; see `file_set`."""
    with file_set(folder, files, owned) as new:
        new.add(files)


@contextmanager
def _temporary(folder: Path, stem: str, make: Callable[[Path], None]) -> Iterator[Path]:
    """A new, empty file or folder, locked, and removed at the end unless it was renamed."""
    while True:
        path, descriptor = folder / f"{stem}.{secrets.token_hex(4)}.part", None
        try:
            make(path)
            # in the moment before its lock, another process may remove it, at any of these steps
            try:
                descriptor = None if fcntl is None else os.open(path, os.O_RDONLY)
            except FileNotFoundError:
                continue
            if descriptor is None or lock(descriptor, path) is not False:
                yield path
                return
        finally:
            if descriptor is not None:
                os.close(descriptor)
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            elif path.exists():
                path.unlink(missing_ok=True)


def lock(descriptor: int, path: Path | None = None) -> bool | None:
    """Whether the lock is ours now, and the path is still that of its file; None on file systems without locks."""
    has_locks = True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        has_locks = False
    try:
        is_there = path is None or os.path.samestat(path.stat(), os.fstat(descriptor))
    except OSError:
        is_there = False
    return is_there and (has_locks or None)
