"""Checks of an FMU's archive before it is unpacked."""

import re
import zipfile
from pathlib import Path

from gough_stewart.harness.errors import PlantError

# An FMU of this project for all systems has some 10 MB; a zip bomb expands by a factor of thousands.
MOST_BYTES = 256_000_000
MOST_FILES = 10_000
_ABSOLUTE = re.compile(r"[/\\]|[A-Za-z]:")


def check_archive(path: Path) -> None:
    """Refuse an archive that would write outside its folder or fill the disk.

    Raises
    ------
    PlantError
        Not an archive; an entry with an absolute path, `..` or a backslash; more than `MOST_FILES` files or
        `MOST_BYTES` unpacked.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
    except (OSError, zipfile.BadZipFile, NotImplementedError, UnicodeDecodeError) as error:
        raise PlantError(f"{path}: is not an FMU ({error})") from error
    if len(entries) > MOST_FILES:
        raise PlantError(f"{path}: contains {len(entries):,} files; expected an FMU of at most {MOST_FILES:,}")
    for entry in entries:
        name = entry.orig_filename
        if _ABSOLUTE.match(name) or "\\" in name or "\0" in name or ".." in name.split("/"):
            raise PlantError(
                f"{path}: the entry {name!r} points outside the archive; expected relative paths with slashes, as the "
                "standard requires; nothing was unpacked"
            )
    size = sum(entry.file_size for entry in entries)
    if size > MOST_BYTES:
        largest = max(entries, key=lambda entry: entry.file_size)
        raise PlantError(
            f"{path}: would unpack to {size / 1e6:,.0f} MB, {largest.file_size / 1e6:,.0f} MB of it the entry "
            f"{largest.orig_filename!r}; expected at most {MOST_BYTES / 1e6:,.0f} MB; nothing was unpacked"
        )
