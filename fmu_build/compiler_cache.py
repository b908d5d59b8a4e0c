"""The compiler's cache: a folder of its own, whose objects are checked by digest, so that damage heals by itself.

Beside each object in it lies the digest of what the compiler wrote. An object that differs would be linked as it is,
or end every later build: the cache is emptied, and what is in it made anew. A lock is shared by all who compile, and
held alone by who empties: a compiler whose cache disappears never ends.
"""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path
from threading import Lock
from typing import IO

from platformdirs import user_cache_path

try:
    import fcntl
except ImportError:  # Windows, where no digests are kept: only what the compiler stumbles over is found
    fcntl = None  # type: ignore[assignment]

_OBJECTS, _DIGESTS = "o", ".sha256"
_IN_USE = "zig.lock"
_lock = Lock()
_emptied: set[Path] = set()
_checked: set[Path] = set()


def cache_folder() -> Path:
    """Where sources and objects lie; inside zig's cache if its place is set, so that both are cleared at once."""
    zig = os.environ.get("ZIG_GLOBAL_CACHE_DIR")
    return Path(zig, "gough-stewart") if zig else user_cache_path("gough-stewart") / "build"


def object_cache() -> Path:
    """The folder that zig keeps its objects in."""
    return cache_folder() / "zig"


def compiler_environment() -> dict[str, str]:
    """The process's environment, with the compiler's caches in `object_cache`."""
    folder = str(object_cache())
    return {**os.environ, "ZIG_GLOBAL_CACHE_DIR": folder, "ZIG_LOCAL_CACHE_DIR": folder}


@contextmanager
def compiling() -> Iterator[IO[str]]:
    """Around a compiler that works in the cache: what is there is checked before, and remembered afterwards.

    The lock file is to be inherited by the compiler, which may outlive this process.

    Of several side by side, in threads or processes, the last one remembers: the objects of the others are whole only
    when they have ended.
    """
    cache_folder().mkdir(parents=True, exist_ok=True)
    with (cache_folder() / _IN_USE).open("a") as in_use:
        _check_objects(in_use)
        _flock(in_use, "LOCK_SH")
        yield in_use
        if fcntl is not None:
            with suppress(BlockingIOError):  # somebody else still compiles
                fcntl.flock(in_use, fcntl.LOCK_EX | fcntl.LOCK_NB)
                _remember_objects()


def empty_objects(in_use: IO[str]) -> None:
    """Empty the cache, since the compiler stumbled over it; once a process, so that builds side by side go on.

    Waits for the others that compile; the lock is shared again afterwards.
    """
    folder = object_cache()
    # the share is given up first, so that two who wait for each other do not wait for ever
    _flock(in_use, "LOCK_UN")
    with _lock:
        if folder not in _emptied:
            _flock(in_use, "LOCK_EX")
            _empty(folder)
    _flock(in_use, "LOCK_SH")


def _check_objects(in_use: IO[str]) -> None:
    """Empty the cache if an object is not what the compiler wrote; once a process."""
    folder = object_cache()
    with _lock:
        if folder in _checked:
            return
        _checked.add(folder)
        if not _all_whole(folder):
            _flock(in_use, "LOCK_EX")
            # somebody else may have been faster, or was still writing
            if not _all_whole(folder):
                _empty(folder)


def _flock(in_use: IO[str], how: str) -> None:
    if fcntl is not None:
        fcntl.flock(in_use, getattr(fcntl, how))


def _all_whole(folder: Path) -> bool:
    return all(_is_whole(place) for place in _places(folder))


def _remember_objects() -> None:
    """Keep the digests of objects that are new."""
    for place in _places(object_cache()):
        if not (place / _DIGESTS).exists():
            try:
                (place / _DIGESTS).write_text(_digests(place))
            except OSError:  # a full disk: the next build is not checked
                return


def _places(folder: Path) -> list[Path]:
    objects = folder / _OBJECTS
    return [place for place in objects.iterdir() if place.is_dir()] if objects.is_dir() else []


def _is_whole(place: Path) -> bool:
    try:
        return not (place / _DIGESTS).exists() or (place / _DIGESTS).read_text() == _digests(place)
    except (OSError, UnicodeDecodeError):
        return False


def _digests(place: Path) -> str:
    files = sorted(file for file in place.rglob("*") if file.is_file() and file.name != _DIGESTS)
    return "".join(f"{sha256(file.read_bytes()).hexdigest()} {file.relative_to(place)}\n" for file in files)


def _empty(folder: Path) -> None:
    _emptied.add(folder)
    if folder.is_dir() and not folder.is_symlink():
        shutil.rmtree(folder, ignore_errors=True)
    else:
        folder.unlink(missing_ok=True)
