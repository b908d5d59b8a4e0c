"""Copies of the repository's files in a temporary folder; the repository itself is not changed."""

import shutil
import subprocess
from pathlib import Path


def copy_of(root: Path, folder: Path) -> Path:
    """Copy all files that git tracks or would add, with links and file times, so compiled Python stays valid."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=root,
        capture_output=True,
        check=True,
    )
    for name in sorted(set(listed.stdout.decode().split("\0")) - {""}):
        source, target = root / name, folder / name
        if source.is_symlink() or source.is_file():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target, follow_symlinks=False)
    return folder
