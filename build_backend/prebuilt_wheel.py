"""The build backend of this project [PEP 517]: setuptools, and a wheel with what is compiled from its own sources.

Only a wheel needs the compiler. An editable install and the sdist are setuptools' own.
`pip wheel . -C only-here=yes` compiles for the processor at hand only.
"""

import base64
import hashlib
import os
import subprocess
import sys
import tempfile
import time
import tomllib
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import (
    build_editable,
    build_sdist,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]
Settings = Mapping[str, Any] | None
_FOLDER = "gough_stewart/prebuilt"
# The earliest time that the zip format can represent.
_EARLIEST = 315_532_800


def get_requires_for_build_wheel(_config_settings: Settings = None) -> list[str]:
    """What compiling needs: the package runs, traces and compiles while its wheel is built."""
    project = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))["project"]
    return [
        *build_meta.get_requires_for_build_wheel(),
        *project["dependencies"],
        *project["optional-dependencies"]["compile"],
    ]


def build_wheel(wheel_directory: str, config_settings: Settings = None, metadata_directory: str | None = None) -> str:
    """Setuptools' wheel with the folder `prebuilt`; equal sources and tools give equal bytes.

    Parameters
    ----------
    config_settings
        `only-here`: for the processor at hand instead of every target.
    """
    # what takes minutes must not end at a folder that is not there
    Path(wheel_directory).mkdir(parents=True, exist_ok=True)
    options = ["--only-here"] if "only-here" in (config_settings or {}) else ["--target", "all"]
    with tempfile.TemporaryDirectory(prefix="gough-stewart-wheel-") as scratch:
        name = str(build_meta.build_wheel(scratch, None, metadata_directory))
        unpacked = Path(scratch, "unpacked")
        with zipfile.ZipFile(Path(scratch, name)) as archive:
            archive.extractall(unpacked)
        _compile(unpacked, options)
        contents = {
            path.relative_to(unpacked).as_posix(): path.read_bytes() for path in unpacked.rglob("*") if path.is_file()
        }
    _write(Path(wheel_directory, name), contents)
    return name


def _compile(unpacked: Path, options: list[str]) -> None:
    """Let the package that is in the wheel make the rest, so that both are of the same sources."""
    paths = [str(unpacked), *filter(None, [os.environ.get("PYTHONPATH")])]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "gough_stewart.harness.prebuilt", "--out", str(unpacked / _FOLDER)]
    subprocess.run([*command, *options], cwd=unpacked, env=env, check=True)


def _write(path: Path, contents: dict[str, bytes]) -> None:
    """The wheel, in a fixed order, with one time and one set of permissions."""
    (record,) = (name for name in contents if name.endswith(".dist-info/RECORD"))
    rows = [
        f"{name},sha256={base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b'=').decode()},{len(content)}"
        for name, content in sorted(contents.items())
        if name != record
    ]
    contents[record] = "".join(f"{row}\n" for row in [*rows, f"{record},,"]).encode()
    seconds = max(_EARLIEST, int(os.environ.get("SOURCE_DATE_EPOCH", _EARLIEST)))
    date = time.gmtime(seconds)[:6]
    partial = path.with_name(f"{path.name}.part")
    with zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        # the metadata last, as PEP 427 advises
        for name in sorted(contents, key=lambda name: (".dist-info/" in name, name == record, name)):
            entry = zipfile.ZipInfo(name, date)
            entry.compress_type, entry.create_system, entry.external_attr = zipfile.ZIP_DEFLATED, 3, 0o100644 << 16
            archive.writestr(entry, contents[name])
    partial.replace(path)
