"""Files are written whole or not at all: beside the target, then renamed over it."""

import os
import threading
from pathlib import Path


def write_whole(path: Path, content: bytes) -> None:
    """Replace or create a file in one step; an interrupted write leaves what was there before."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}.part")
    try:
        beside.write_bytes(content)
        beside.replace(path)
    except OSError as error:
        beside.unlink(missing_ok=True)
        # the user knows the target, not the file beside it
        raise OSError(error.errno, error.strerror, str(path)) from error
    except BaseException:
        beside.unlink(missing_ok=True)
        raise
