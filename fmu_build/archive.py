"""The FMU as an archive: the same bytes for the same contents, wherever and whenever it is written."""

import io
import zipfile
from collections.abc import Mapping

# The earliest that the format knows.
_DATE = (1980, 1, 1, 0, 0, 0)
_FIRST = "modelDescription.xml"
PLANT_STEM = "gough_stewart"


def file_name(fmi_version: str, stem: str = PLANT_STEM) -> str:
    """`STEM_fmi2.fmu` or `STEM_fmi3.fmu`."""
    return f"{stem}_fmi{fmi_version[0]}.fmu"


def to_zip(contents: Mapping[str, bytes]) -> bytes:
    """A zip archive of files by their path inside, with slashes; the model description first."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name in sorted(contents, key=lambda name: (name != _FIRST, name)):
            entry = zipfile.ZipInfo(name, _DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # Unix, whichever system this is: the permissions below are its
            entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(entry, contents[name])
    return stream.getvalue()
