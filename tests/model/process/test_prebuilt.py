"""Files that come with the package count only if they are those of its sources, bit by bit."""

import json
import lzma
import warnings
from collections.abc import Iterator
from pathlib import Path

import pytest

from gough_stewart.model.process import installed as module
from gough_stewart.model.process.installed import (
    MANIFEST,
    manifest_line,
    packed,
    prebuilt,
    prebuilt_content,
)

CONTENT = bytes(range(256)) * 40


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder with one file, made of sources of the state `now`."""
    monkeypatch.setattr(module, "PREBUILT", tmp_path)
    (tmp_path / "code.so").write_bytes(CONTENT)
    (tmp_path / MANIFEST).write_text(json.dumps({"files": {"code": manifest_line("code.so", CONTENT, "now")}}))
    module._manifest.cache_clear()
    module._warn.cache_clear()
    yield tmp_path
    module._manifest.cache_clear()


def test_a_file_counts_for_its_sources_only(folder: Path) -> None:
    """Expected: the file for the state that it was made of; nothing for an older one or an unknown name."""
    assert prebuilt("code", "now") == folder / "code.so"
    assert prebuilt("code", "before") is None
    assert prebuilt("other", "now") is None


def test_a_packed_file_has_its_content_again(folder: Path) -> None:
    """Expected: xz as Python's decompressor reads it, of another size; nothing for other sources, or if damaged."""
    file = packed(CONTENT)
    assert (lzma.decompress(file), len(file) < len(CONTENT) / 8) == (CONTENT, True)
    (folder / "code.so.xz").write_bytes(file)
    (folder / MANIFEST).write_text(json.dumps({"files": {"code": manifest_line("code.so.xz", file, "now")}}))
    module._manifest.cache_clear()
    assert prebuilt_content("code", "now") == CONTENT
    assert prebuilt_content("code", "before") is None
    (folder / "code.so.xz").write_bytes(packed(CONTENT[1:]))
    with pytest.warns(UserWarning, match=r"code\.so\.xz is damaged"):
        assert prebuilt_content("code", "now") is None


@pytest.mark.parametrize("damage", ["flipped", "short", "gone"])
def test_a_damaged_file_is_named_and_not_used(folder: Path, damage: str) -> None:
    file = folder / "code.so"
    if damage == "gone":
        file.unlink()
    else:
        file.write_bytes(CONTENT[:-1] if damage == "short" else b"\x01" + CONTENT[1:])
    with pytest.warns(UserWarning, match=r"code\.so is damaged and is not used; install the package again"):
        assert prebuilt("code", "now") is None
    with warnings.catch_warnings():  # said once
        warnings.simplefilter("error")
        assert prebuilt("code", "now") is None


@pytest.mark.parametrize("text", ["", "{", "[1"])
def test_without_a_whole_manifest_there_is_nothing(folder: Path, text: str) -> None:
    """Expected: as after a build that was interrupted, whose manifest comes last."""
    (folder / MANIFEST).write_text(text)
    module._manifest.cache_clear()
    assert prebuilt("code", "now") is None
    (folder / MANIFEST).unlink()
    module._manifest.cache_clear()
    assert prebuilt("code", "now") is None
