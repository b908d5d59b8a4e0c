"""The mutants of folders in the random order of a seed."""

import random
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from itertools import islice
from pathlib import Path
from typing import Self

from tools.mutants.mutation import Change, Kind, Mutant, mutant_of
from tools.mutants.python_changes import is_python, python_changes
from tools.mutants.semantic_python import semantic_python
from tools.mutants.semantic_tokens import semantic_tokens
from tools.mutants.token_changes import token_changes

_Changes = Callable[[bytes], Iterator[list[Change]]]
_CHANGES: dict[Kind, dict[str, _Changes]] = {
    "token": {".py": python_changes, ".c": token_changes, ".h": token_changes, ".js": token_changes},
    "semantic": {".py": semantic_python, ".c": semantic_tokens, ".h": semantic_tokens, ".js": semantic_tokens},
}
# Sites of each semantic operator that are tried before chance alone decides.
_OF_EACH = 3
EQUIVALENT = Path(__file__).with_name("equivalent.toml")


@dataclass(frozen=True)
class Draw:
    """A number of random mutants of a kind."""

    kind: Kind
    seed: int
    number: int

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read `KIND:SEED:NUMBER`; a ValueError says that it is something else."""
        kind, seed, number = text.split(":")
        if kind not in _CHANGES:
            raise ValueError(f"the kind is {kind}; expected one of {', '.join(_CHANGES)}")
        return cls(kind, int(seed), int(number))


def files_in(root: Path, folders: Iterable[str], pattern: str = "*") -> list[Path]:
    """Sources with matching names below some folders, relative to the root of the repository."""
    found = set()
    for folder in folders:
        if not (root / folder).is_dir():
            raise LookupError(f"no folder {folder}; expected one of the repository, such as model or fmu_build/c")
        inside = (path.relative_to(root) for path in (root / folder).rglob(pattern) if path.suffix in _CHANGES["token"])
        # exclude .venv
        found |= {path for path in inside if not any(part.startswith(".") for part in path.parts)}
    return sorted(found)


def mutants_in_order(root: Path, files: Iterable[Path], seed: int, kind: Kind = "token") -> list[Mutant]:
    """One random mutant for each place of the files, in the order of the seed.

    A mutant keeps its rank when other lines change, so reports stay comparable while tests are written. Of semantic
    mutants the first ones are of each operator in turn, so that none is missing from a small sample.
    """
    chosen = []
    for file in files:
        source = (root / file).read_bytes()
        for place in _CHANGES[kind][file.suffix](source):
            mutants = [mutant_of(file, source, change) for change in place]
            random.Random(f"{seed}|{mutants[0].before}").shuffle(mutants)
            chosen += list(islice((m for m in mutants if _may_run(m, source)), 1))
    ordered = sorted(_numbered(chosen), key=lambda mutant: mutant.rank(seed))
    turn = Counter[str]()
    turns = []
    for mutant in ordered:
        turns.append(min(turn[mutant.change.operator], _OF_EACH))
        turn[mutant.change.operator] += 1
    return [ordered[k] for k in sorted(range(len(ordered)), key=lambda k: turns[k])] if kind == "semantic" else ordered


def _may_run(mutant: Mutant, source: bytes) -> bool:
    return mutant.file.suffix != ".py" or is_python(mutant.change.apply(source))


def every_mutant(file: Path, source: bytes, kinds: Iterable[Kind] = ("token",)) -> Iterator[Mutant]:
    """All possible mutants."""
    for kind in kinds:
        for place in _CHANGES[kind][file.suffix](source):
            for change in place:
                yield mutant_of(file, source, change)


def _numbered(mutants: Iterable[Mutant]) -> Iterator[Mutant]:
    """The same mutants, with numbers for those with equal lines."""
    seen = Counter[str]()
    for mutant in mutants:
        yield replace(mutant, occurrence=seen[mutant.key])
        seen[mutant.key] += 1


@dataclass(frozen=True)
class Equivalents:
    """Mutants equivalent to the source, with the reason: single ones, and families by a pattern."""

    single: dict[tuple[str, str, str], str]  # by file and lines before and after
    families: tuple[tuple[str, re.Pattern[str], str], ...]  # file with wildcards, "before → after", reason

    def reason(self, mutant: Mutant) -> str | None:
        """Why a mutant is equivalent to the source, if it is known to be."""
        file = mutant.file.as_posix()
        for pattern, change, why in self.families:
            if fnmatch(file, pattern) and change.search(f"{mutant.before} → {mutant.after}"):
                return why
        return self.single.get((file, mutant.before, mutant.after))


def equivalents(path: Path = EQUIVALENT) -> Equivalents:
    """The equivalent mutants in the file."""
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    return Equivalents(
        {(each["file"], each["before"], each["after"]): each["reason"] for each in tables.get("mutant", [])},
        tuple((each["file"], re.compile(each["pattern"]), each["reason"]) for each in tables.get("family", [])),
    )
