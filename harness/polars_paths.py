"""Files of Polars whose paths are not UTF-8, which it refuses: they go through memory."""

from collections.abc import Callable
from io import BytesIO
from pathlib import Path


def readable(path: Path) -> Path | BytesIO:
    """What Polars reads a file from."""
    return path if _is_utf8(path) else BytesIO(path.read_bytes())


def write_to(path: Path, write: Callable[[Path | BytesIO], None]) -> None:
    """Let Polars write a file."""
    if _is_utf8(path):
        write(path)
        return
    content = BytesIO()
    write(content)
    path.write_bytes(content.getvalue())


def _is_utf8(path: Path) -> bool:
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True
