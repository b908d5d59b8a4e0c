"""Fenced blocks of a page in Markdown."""

import re
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
_FENCED = re.compile(r"^```([^\n`]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_TITLE = re.compile(r'title="([^"]+)"')


class Block(NamedTuple):
    """A fenced block: where it stands, its language, the file that it is (empty for none), its text."""

    page: str
    line: int
    language: str
    title: str
    text: str
    start: int  # of the text, in characters from the start of the page

    @property
    def place(self) -> str:
        """For names of tests and messages."""
        return f"{self.page}:{self.line}"


def text_of(page: str) -> str:
    """The page, by its path from the root of the repository."""
    return (ROOT / page).read_text(encoding="utf-8")


def blocks_of(page: str) -> list[Block]:
    """All fenced blocks of a page in their order."""
    text = text_of(page)
    return [
        Block(page, text.count("\n", 0, f.start()) + 1, f[1].partition(" ")[0].strip(), _title(f[1]), f[2], f.start(2))
        for f in _FENCED.finditer(text)
    ]


def commands_in(block: Block) -> list[str]:
    """The lines of a shell block, without comments."""
    lines = block.text.splitlines()
    return [command for line in lines if (command := re.sub(r"(^|\s)#.*", "", line).strip())]


def _title(head: str) -> str:
    found = _TITLE.search(head)
    return found[1] if found else ""
