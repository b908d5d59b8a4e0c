"""A small change of a source file, as a replacement of bytes."""

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Kind = Literal["token", "semantic"]


@dataclass(frozen=True)
class Change:
    """Replaces bytes `start` to `end` of a source by `replacement`."""

    start: int
    end: int
    replacement: bytes
    operator: str = ""  # of changes of meaning: the mistake that it imitates

    def apply(self, source: bytes) -> bytes:
        """The changed source."""
        return source[: self.start] + self.replacement + source[self.end :]


@dataclass(frozen=True)
class Mutant:
    """A change of a file, with the affected lines before and after, normalised to single blanks."""

    file: Path  # from the root of the repository
    change: Change
    line_number: int
    before: str
    after: str
    occurrence: int = 0  # number of earlier mutants of the file with the same lines

    @property
    def kind(self) -> Kind:
        """Whether it changes tokens or meaning."""
        return "semantic" if self.change.operator else "token"

    @property
    def key(self) -> str:
        """A key that depends on the affected lines, but not on their position in the file."""
        return f"{self.file.as_posix()}|{self.before}|{self.after}|{self.occurrence}"

    def rank(self, seed: int) -> str:
        """Its rank in the random order of a seed, independent of other mutants."""
        return hashlib.sha256(f"{seed}|{self.key}".encode()).hexdigest()

    def __str__(self) -> str:
        operator = f" ({self.change.operator})" if self.change.operator else ""
        return f"{self.file.as_posix()}:{self.line_number}{operator}\n    - {self.before}\n    + {self.after}"


def mutant_of(file: Path, source: bytes, change: Change) -> Mutant:
    """The mutant for a change of a file."""
    before, after = _lines(source, change, source[change.start : change.end]), _lines(source, change)
    return Mutant(file, change, source.count(b"\n", 0, change.start) + 1, before, after)


def _lines(source: bytes, change: Change, middle: bytes | None = None) -> str:
    first = source.rfind(b"\n", 0, change.start) + 1
    last = source.find(b"\n", change.end)
    text = source[first : change.start] + (change.replacement if middle is None else middle)
    text += source[change.end : last if last >= 0 else len(source)]
    return re.sub(r"\s+", " ", text.decode()).strip()
