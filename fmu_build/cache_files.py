"""Files of the cache: made once, and checked by their digests."""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path

from platformdirs import user_cache_path

from gough_stewart.fmu_build.errors import BuildError
from gough_stewart.model.process.files import write_whole


def cache_folder() -> Path:
    """Of sources, objects and libraries; inside zig's cache if that is set, so that both are cleared together."""
    zig = os.environ.get("ZIG_GLOBAL_CACHE_DIR")
    return Path(zig, "gough-stewart") if zig else user_cache_path("gough-stewart") / "build"


def kept(path: Path, make: Callable[[], bytes]) -> Path:
    """A file of the cache, created by `make` if it is missing or does not match its stored digest.

    Several processes may create it at the same time if its content is deterministic: each writes a temporary file and
    renames it, so the file is never missing while another process uses it.

    Raises
    ------
    BuildError
        The file in the cache differs from what was written.
    OSError
        The cache cannot be written.
    """
    digest = path.with_name(f"{path.name}.sha256")
    if not _is_whole(path, digest):
        content = make()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, content)
            write_whole(digest, digest_of(content).encode())
        except OSError as error:
            raise type(error)(
                error.errno,
                f"the cache cannot be written ({error.strerror}); set XDG_CACHE_HOME to a writable folder",
                str(path.parent),
            ) from error
        if not _is_whole(path, digest):
            raise BuildError(
                f"{path} differs from what was written there; delete the folder {path.parent}, or free disk space"
            )
    return path


def digest_of(content: bytes) -> str:
    """SHA-256 in hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def _is_whole(path: Path, digest: Path) -> bool:
    try:
        return digest.read_bytes() == digest_of(path.read_bytes()).encode()
    except OSError:
        return False
