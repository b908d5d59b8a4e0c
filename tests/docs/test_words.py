"""Words: some phrases and names are wrong in any context, since the field has a term for them."""

import re

import pytest

from tools.pages.blocks import ROOT

# What nobody searches for, with the field's term.
WRONG = {
    r"[Ll]egs? that gives?\b": "elastic legs",
    r"[Ff]riction that sticks": "stiction",
    r"[Cc]annot be told": "inconclusive, or cannot be determined",
    r"[Bb]y itself, the": "without input",
    r"hardly separates": "separates poorly",
    r"machines that differ in|load it, break it|take it home": "ensemble of machines; loads and faults; download",
    r"\b(LanesPlant|RowTaker|Grip|_hear)\b": "BatchPlant, RowSink, StickTerms, _on_log",
}
FOLDERS = ("model", "fmu_build", "harness", "gough_stewart", "docs", "examples")
SUFFIXES = {".py", ".pyi", ".md", ".js", ".html", ".j2", ".c", ".h", ".in", ".toml"}


@pytest.mark.parametrize("folder", FOLDERS)
def test_terms_are_those_of_the_field(folder: str) -> None:
    """Expected: none of the phrases, outside of the changelog."""
    wrong = re.compile("|".join(WRONG))
    found = [
        f"{path.relative_to(ROOT)}: {match[0]}"
        for path in sorted((ROOT / folder).rglob("*"))
        if path.suffix in SUFFIXES and "prebuilt" not in path.parts and not path.is_symlink()
        for match in wrong.finditer(path.read_text(encoding="utf-8"))
    ]
    assert found == []
