"""A small change of a source file, as bytes replaced in it."""

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Change:
    """Bytes `start` to `end` of a source become `replacement`."""

    start: int
    end: int
    replacement: bytes

    def apply(self, source: bytes) -> bytes:
        """The source with the change in it."""
        return source[: self.start] + self.replacement + source[self.end :]


@dataclass(frozen=True)
class Mutant:
    """A change of a file, and how it reads: the lines that it touches before and after, with single blanks."""

    file: Path  # from the root of the repository
    change: Change
    line_number: int
    before: str
    after: str
    occurrence: int = 0  # before it, that many mutants of the file read like this

    @property
    def key(self) -> str:
        """The same as long as the lines that it touches are, wherever they stand in the file."""
        return f"{self.file.as_posix()}|{self.before}|{self.after}|{self.occurrence}"

    def rank(self, seed: int) -> str:
        """Its place in the random order of this seed, which no other mutant has a part in."""
        return hashlib.sha256(f"{seed}|{self.key}".encode()).hexdigest()

    def __str__(self) -> str:
        return f"{self.file.as_posix()}:{self.line_number}\n    - {self.before}\n    + {self.after}"


def mutant_of(file: Path, source: bytes, change: Change) -> Mutant:
    """A change of a file with how it reads."""
    before, after = _lines(source, change, source[change.start : change.end]), _lines(source, change)
    return Mutant(file, change, source.count(b"\n", 0, change.start) + 1, before, after)


def _lines(source: bytes, change: Change, middle: bytes | None = None) -> str:
    first = source.rfind(b"\n", 0, change.start) + 1
    last = source.find(b"\n", change.end)
    text = source[first : change.start] + (change.replacement if middle is None else middle)
    text += source[change.end : last if last >= 0 else len(source)]
    return re.sub(r"\s+", " ", text.decode()).strip()
