"""The wheel: equal bytes in any folder, code for every target, and its size."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from gough_stewart.fmu_build.libraries import flags_by_level
from gough_stewart.fmu_build.toolchain import TARGETS

ROOT = Path(__file__).parents[2]
LARGEST = 3e6  # bytes

pytestmark = pytest.mark.evidence


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
    print(f"{one.name}: {one.stat().st_size / 1e6:.2f} MB")
    assert one.read_bytes() == other.read_bytes()
    assert one.stat().st_size <= LARGEST
    with zipfile.ZipFile(one) as wheel:
        names = [name for name in wheel.namelist() if name.startswith("gough_stewart/prebuilt/")]
    assert "gough_stewart/prebuilt/machine.wasm.xz" in names
    for target in TARGETS:
        found = [name for name in names if f"/{target.name}/" in name]
        assert len(found) == 2 + 2 * len(flags_by_level(target)), found
