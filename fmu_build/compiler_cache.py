"""The compiler's cache: a separate folder whose objects are checked by digest and rebuilt when damaged.

The digest of each object is stored beside it. The compiler would link a damaged object, or fail in every later build,
so the cache is emptied if a digest does not match. Compiling processes share a lock, and emptying the cache takes it
exclusively, because a compiler never ends if its cache disappears.
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
except ImportError:  # Windows, where no digests are stored: damage is only found when the compiler fails
    fcntl = None  # type: ignore[assignment]

_OBJECTS, _DIGESTS = "o", ".sha256"
_IN_USE = "zig.lock"
_lock = Lock()
_emptied: set[Path] = set()
_checked: set[Path] = set()


def cache_folder() -> Path:
    """Folder of sources and objects; inside zig's cache if that is set, so that both are cleared together."""
    zig = os.environ.get("ZIG_GLOBAL_CACHE_DIR")
    return Path(zig, "gough-stewart") if zig else user_cache_path("gough-stewart") / "build"


def object_cache() -> Path:
    """The folder where zig stores its objects."""
    return cache_folder() / "zig"


def compiler_environment() -> dict[str, str]:
    """The environment of the process, with the compiler's caches in `object_cache`."""
    folder = str(object_cache())
    return {**os.environ, "ZIG_GLOBAL_CACHE_DIR": folder, "ZIG_LOCAL_CACHE_DIR": folder}


@contextmanager
def compiling() -> Iterator[IO[str]]:
    """Context for running the compiler in the cache: checks objects before, and stores digests of new ones after.

    The compiler inherits the lock file, since it may outlive this process.

    Of several concurrent compilers, in threads or processes, only the last one to end stores digests, because the
    objects of the others may still be incomplete.
    """
    cache_folder().mkdir(parents=True, exist_ok=True)
    with (cache_folder() / _IN_USE).open("a") as in_use:
        _check_objects(in_use)
        _flock(in_use, "LOCK_SH")
        yield in_use
        if fcntl is not None:
            with suppress(BlockingIOError):  # another process is still compiling
                fcntl.flock(in_use, fcntl.LOCK_EX | fcntl.LOCK_NB)
                _remember_objects()


def empty_objects(in_use: IO[str]) -> None:
    """Empty the cache after the compiler failed on it; once per process, so that concurrent builds can continue.

    Waits for other compilers; afterwards the lock is shared again.
    """
    folder = object_cache()
    # release the shared lock first: two processes waiting for each other would deadlock
    _flock(in_use, "LOCK_UN")
    with _lock:
        if folder not in _emptied:
            _flock(in_use, "LOCK_EX")
            _empty(folder)
    _flock(in_use, "LOCK_SH")


def _check_objects(in_use: IO[str]) -> None:
    """Empty the cache if an object differs from what the compiler wrote; once per process."""
    folder = object_cache()
    with _lock:
        if folder in _checked:
            return
        _checked.add(folder)
        if not _all_whole(folder):
            _flock(in_use, "LOCK_EX")
            # another process may have emptied it already, or was still writing
            if not _all_whole(folder):
                _empty(folder)


def _flock(in_use: IO[str], how: str) -> None:
    if fcntl is not None:
        fcntl.flock(in_use, getattr(fcntl, how))


def _all_whole(folder: Path) -> bool:
    return all(_is_whole(place) for place in _places(folder))


def _remember_objects() -> None:
    """Store the digests of new objects."""
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
