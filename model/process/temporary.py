"""Temporary files and folders beside what they become: each is locked as long as its process lives.

A process that is killed leaves its temporary files, without the lock; the next command in the folder removes them.
"""

import logging
import os
import re
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows: nothing is locked, and nothing is removed
    fcntl = None  # type: ignore[assignment]

# `.NAME.TOKEN.part`, in release 0.2 `.NAME.PROCESS.THREAD.part`
_NAME = re.compile(r"\.(?:.+\.)?[a-z0-9_]{8}\.part|\..+\.(?P<process>\d+)\.\d+\.part")
_log = logging.getLogger(__name__)


@contextmanager
def temporary_file(path: Path) -> Iterator[Path]:
    """A new, empty file beside a path, removed at the end unless it was renamed."""
    with _locked(path.parent, f".{path.name}", Path.touch) as temporary:
        yield temporary


@contextmanager
def temporary_folder(folder: Path) -> Iterator[Path]:
    """A new folder in a folder, removed at the end unless it was renamed."""
    with _locked(folder, "", Path.mkdir) as temporary:
        yield temporary


def remove_leftovers(folder: Path) -> None:
    """Remove what processes that have ended left in a folder, and log it; what a living process writes stays."""
    if fcntl is None:
        return
    removed = []
    for path in sorted(folder.glob(".*.part")):
        matched = _NAME.fullmatch(path.name)
        # names of release 0.2 have the process, which may live
        if matched and not (matched["process"] and _lives(int(matched["process"]))) and _remove(path):
            removed.append(path.name)
    if removed:
        _log.info("removed from %s what a command left that was killed: %s", folder, ", ".join(removed))


@contextmanager
def _locked(folder: Path, stem: str, make: Callable[[Path], None]) -> Iterator[Path]:
    """Make a temporary file or folder, hold its lock, and remove it."""
    while True:
        path, descriptor = folder / f"{stem}.{secrets.token_hex(4)}.part", None
        try:
            make(path)
            # in the moment before its lock, another process may remove it, at any of these steps
            try:
                descriptor = None if fcntl is None else os.open(path, os.O_RDONLY)
            except FileNotFoundError:
                continue
            if descriptor is None or (lock(descriptor) is not False and _is_there(path, descriptor)):
                yield path
                return
        finally:
            if descriptor is not None:
                os.close(descriptor)
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            elif path.exists():
                path.unlink(missing_ok=True)


def lock(descriptor: int) -> bool | None:
    """Whether the lock is ours now; None on file systems without locks."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


def _is_there(path: Path, descriptor: int) -> bool:
    with suppress(OSError):
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    return False


def _remove(path: Path) -> bool:
    """Remove a file or folder that nobody holds."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return False
    try:
        if not lock(descriptor) or not _is_there(path, descriptor):
            return False
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()
    except OSError:  # belongs to somebody else
        return False
    finally:
        os.close(descriptor)
    return True


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
