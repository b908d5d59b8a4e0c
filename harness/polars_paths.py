"""Files of Polars: paths that are not UTF-8, which it refuses, go through memory, and interrupts wait for its end.

The surrogates that stand for bytes of other encodings are not printable. A `KeyboardInterrupt` in one of the Python
functions that Polars calls from Rust becomes a panic.
"""

from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from gough_stewart.model.process.progress import interrupts_held_back

if TYPE_CHECKING:  # it is slow to import
    import polars


def readable(path: Path) -> Path | BytesIO:
    """What Polars reads a file from."""
    return path if str(path).isprintable() else BytesIO(path.read_bytes())


@interrupts_held_back()
def read_parquet(path: Path | BytesIO) -> "polars.DataFrame":
    """The table in a Parquet file; `*` and `[1]` are parts of a name."""
    import polars

    return polars.read_parquet(path if isinstance(path, BytesIO) else readable(path), glob=False)


@interrupts_held_back()
def scan_parquet(path: Path) -> "polars.LazyFrame":
    """The table in a Parquet file as a lazy frame, whose columns are read when they are used."""
    import polars

    return polars.scan_parquet(readable(path), glob=False)


@interrupts_held_back()
def write_to(path: Path | BytesIO, write: Callable[[Path | BytesIO], None]) -> None:
    """Let Polars write a file, or into memory."""
    if isinstance(path, BytesIO) or str(path).isprintable():
        write(path)
        return
    content = BytesIO()
    write(content)
    path.write_bytes(content.getvalue())
