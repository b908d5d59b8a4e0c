"""The FMU as an archive: the same contents always give the same bytes."""

import io
import zipfile
from collections.abc import Mapping

# The earliest date that the zip format can represent.
_DATE = (1980, 1, 1, 0, 0, 0)
_FIRST = "modelDescription.xml"
PLANT_STEM = "gough_stewart"


def file_name(fmi_version: str, stem: str = PLANT_STEM) -> str:
    """`STEM_fmi2.fmu` or `STEM_fmi3.fmu`."""
    return f"{stem}_fmi{fmi_version[0]}.fmu"


def to_zip(contents: Mapping[str, bytes]) -> bytes:
    """A zip archive of files by their paths in it, with slashes; the model description comes first."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as archive:
        for name in sorted(contents, key=lambda name: (name != _FIRST, name)):
            entry = zipfile.ZipInfo(name, _DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # Unix on every system, since the permissions below are Unix ones
            entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(entry, contents[name])
    return stream.getvalue()
