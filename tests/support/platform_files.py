"""Texts of platform files, written and read as a user does."""

from pathlib import Path
from tempfile import TemporaryDirectory

import gough_stewart as gs


def written(platform: gs.Platform) -> str:
    """The text of its file."""
    with TemporaryDirectory() as folder:
        gs.save_platform(platform, Path(folder, "mine.toml"))
        assert [path.name for path in Path(folder).iterdir()] == ["mine.toml"]
        return Path(folder, "mine.toml").read_text(encoding="utf-8")


def loaded(text: str | bytes) -> gs.Platform:
    """The platform of a file `mine.toml` of this text."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "mine.toml")
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return gs.load_platform(path)
