"""Builds for all targets: small enough, of the right kind; the wheel has the same bytes from any folder."""

import os
import re
import shutil
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from gough_stewart import build
from gough_stewart.fmu_build.libraries import flags_by_level
from gough_stewart.fmu_build.toolchain import TARGETS

pytestmark = pytest.mark.evidence
ROOT = Path(__file__).parents[2]
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


def built(sources: Path, folder: Path) -> Path:
    """The wheel of a copy of the sources in a folder."""
    source = shutil.copytree(sources, folder / "source", symlinks=True)
    script = "import sys; sys.path.insert(0, 'build_backend'); import prebuilt_wheel as b; print(b.build_wheel('..'))"
    env = {**os.environ, "SOURCE_DATE_EPOCH": "1700000000", "ZIG_GLOBAL_CACHE_DIR": str(folder / "cache")}
    subprocess.run([sys.executable, "-c", script], cwd=source, env=env, check=True)
    (wheel,) = folder.glob("*.whl")
    return wheel


def test_two_builds_have_the_same_bytes_and_code_for_every_target(tmp_path: Path) -> None:
    """Expected: with caches of their own; per target a unit, a kernel, a loop and folds by level; WebAssembly."""
    sources = tmp_path / "sources"
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for tracked in listed.split("\0")[:-1]:
        (sources / tracked).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / tracked, sources / tracked, follow_symlinks=False)
    one, other = (built(sources, tmp_path / name) for name in ("one", "another folder"))
    assert one.read_bytes() == other.read_bytes()
    assert one.stat().st_size <= 3e6
    with zipfile.ZipFile(one) as wheel:
        names = [name for name in wheel.namelist() if name.startswith("gough_stewart/prebuilt/")]
    assert "gough_stewart/prebuilt/machine.wasm.xz" in names
    for target in TARGETS:
        found = [name for name in names if f"/{target.name}/" in name]
        assert len(found) == 2 + 2 * len(flags_by_level(target)), found
