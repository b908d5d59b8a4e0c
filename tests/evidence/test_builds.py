"""Builds for all targets: small enough, of the right kind. `test_wheels.py` has their bytes from cold caches."""

import re
import struct
import zipfile
from pathlib import Path

import pytest

from gough_stewart import build
from gough_stewart.fmu_build.toolchain import TARGETS

pytestmark = pytest.mark.evidence

# First bytes of ELF, PE and Mach-O files of 64 bits, and of a universal one.
MAGIC = {".so": b"\x7fELF\x02", ".dll": b"MZ", ".dylib": b"\xcf\xfa\xed\xfe"}


@pytest.fixture(scope="module")
def everything(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Both FMUs for all targets, with the user's own cache."""
    return build(tmp_path_factory.mktemp("everything"), targets=["all"])


def test_five_binaries_fit_into_a_megabyte_and_are_of_their_systems(everything: list[Path]) -> None:
    """Expected: file headers of ELF (e_machine at 18), PE (machine after the signature) and Mach-O (cputype at 4)."""
    assert max(path.stat().st_size for path in everything) <= 1_000_000
    with zipfile.ZipFile(everything[1]) as archive:
        for target in TARGETS:
            data = archive.read(f"binaries/{target.name}/gough_stewart{target.suffix}")
            assert data.startswith(MAGIC[target.suffix])
            arm = target.name.startswith("aarch64")
            if target.suffix == ".so":
                assert struct.unpack_from("<H", data, 18)[0] == (183 if arm else 62)
            elif target.suffix == ".dll":
                assert struct.unpack_from("<H", data, struct.unpack_from("<I", data, 60)[0] + 4)[0] == 0x8664
            else:
                assert struct.unpack_from("<I", data, 4)[0] == (0x0100000C if arm else 0x01000007)
                assert minimum_macos(data) == ((11, 0) if arm else (10, 15))
    with zipfile.ZipFile(everything[0]) as archive:
        universal = archive.read("binaries/darwin64/gough_stewart.dylib")
        assert universal.startswith(b"\xca\xfe\xba\xbe\x00\x00\x00\x02")


def minimum_macos(library: bytes) -> tuple[int, int]:
    """From LC_BUILD_VERSION (0x32) or LC_VERSION_MIN_MACOSX (0x24) among the load commands."""
    commands, at = struct.unpack_from("<I", library, 16)[0], 32
    for _ in range(commands):
        command, size = struct.unpack_from("<II", library, at)
        if command in (0x32, 0x24):
            version = struct.unpack_from("<I", library, at + (12 if command == 0x32 else 8))[0]
            return version >> 16, version >> 8 & 0xFF
        at += size
    raise AssertionError("no minimum version among the load commands")


def test_linux_binaries_need_no_newer_c_library_than_promised(everything: list[Path]) -> None:
    """Expected: symbol versions up to GLIBC_2.17, of 2012."""
    with zipfile.ZipFile(everything[1]) as archive:
        for name in ("x86_64-linux", "aarch64-linux"):
            data = archive.read(f"binaries/{name}/gough_stewart.so")
            versions = {tuple(map(int, v.split(b"."))) for v in re.findall(rb"GLIBC_([0-9.]+)", data)}
            assert versions
            assert max(versions) <= (2, 17)
