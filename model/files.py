"""Files are written whole or not at all: beside the target, then renamed over it."""

import os
import threading
from collections.abc import Iterable, Mapping
from pathlib import Path

from gough_stewart.model.errors import OutputError


def check_output_folder(folder: Path, names: Iterable[str]) -> None:
    """Refuse a place where files of these names cannot be written, before anything is computed.

    Raises
    ------
    OutputError
        It is a file, or neither it nor a folder above it can be written, or a folder has one of the names.
    """
    place = folder.absolute()
    while not place.exists() and place != place.parent:
        place = place.parent
    if not place.is_dir():
        raise OutputError(f"output folder {folder}: {place} is a file; expected a folder, existing or new")
    if not os.access(place, os.W_OK | os.X_OK):
        raise OutputError(f"output folder {folder}: no permission to write in {place}; choose another folder")
    for name in names:
        if (folder / name).is_dir():
            raise OutputError(f"output folder {folder}: {name} is a folder there; expected a file or nothing")


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


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files by name, each whole, into a folder that is made if needed."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        write_whole(folder / name, content)
