"""A small bug in a source file, and the bugs of a room in the random order of a seed."""

import random
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import tree_sitter_c
import tree_sitter_javascript
import tree_sitter_python
from tree_sitter import Language, Node, Parser, Query, QueryCursor

from tools.mutants.rules import RULES, SKIPPED, Captures, Text, text_of

_GRAMMARS = {".py": tree_sitter_python, ".c": tree_sitter_c, ".h": tree_sitter_c, ".js": tree_sitter_javascript}
# Places of each mistake that come before chance alone decides.
_OF_EACH = 3


@dataclass(frozen=True)
class Mutant:
    """Bytes of a file from start to end replaced by a text, and the affected lines before and after."""

    file: Path  # from the root of the repository
    line: int
    start: int
    end: int
    text: bytes
    mistake: str  # that a semantic mutant imitates
    before: str
    after: str

    @property
    def key(self) -> str:
        """Its name in reports."""
        return f"{self.file.as_posix()}:{self.line}:{self.start}: {self.before} → {self.after}"

    def applied(self, source: bytes) -> bytes:
        """The changed source."""
        return source[: self.start] + self.text + source[self.end :]

    def __str__(self) -> str:
        return f"{self.file.as_posix()}:{self.line} {self.mistake}\n    - {self.before}\n    + {self.after}"


def every_place(file: Path, source: bytes, kind: str) -> Iterator[list[Mutant]]:
    """The alternative mutants at each place of a source; a few may not be valid."""
    parser, rules = _grammar(file.suffix)
    root = parser.parse(source).root_node
    for mistake, query, texts in rules:
        for _, found in QueryCursor(query).matches(root) if bool(mistake) is (kind == "semantic") else ():
            captures = {name: nodes[0] for name, nodes in found.items()}
            place = list(_mutants(file, source, mistake, texts, captures))
            if place:
                yield place


def mutants_in_order(root: Path, files: Iterable[Path], seed: int, kind: str) -> Iterator[Mutant]:
    """One random mutant for each place of the files, in random order, without those that cannot be parsed.

    Of semantic mutants the first are of each mistake in turn, so that none is missing from a small sample.
    """
    chance, turns = random.Random(seed), Counter[str]()
    places = [place for file in files for place in every_place(file, (root / file).read_bytes(), kind)]
    ranked = []
    for place in chance.sample(places, len(places)):
        mutant = chance.choice(place)
        ranked.append((min(turns[mutant.mistake], _OF_EACH), mutant))
        turns[mutant.mistake] += 1
    for _, mutant in sorted(ranked, key=lambda pair: pair[0]):
        source, (parser, _) = (root / mutant.file).read_bytes(), _grammar(mutant.file.suffix)
        # the grammar does not know all macros and forms
        if parser.parse(source).root_node.has_error or not parser.parse(mutant.applied(source)).root_node.has_error:
            yield mutant


@cache
def _grammar(suffix: str) -> tuple[Parser, list[tuple[str, Query, list[Text]]]]:
    language = Language(_GRAMMARS[suffix].language())
    rules = [(mistake, Query(language, query), texts) for mistake, rs in RULES[suffix].items() for query, *texts in rs]
    return Parser(language), rules


def _mutants(file: Path, source: bytes, mistake: str, texts: list[Text], captures: Captures) -> Iterator[Mutant]:
    first, last = captures.get("all", captures.get("a")), captures.get("all", captures.get("b"))
    if first is None or last is None or _is_skipped(first):
        return
    start, end = first.start_byte, last.end_byte
    parts = {name: text_of(node) for name, node in captures.items()}
    parts["between"] = source[first.end_byte : last.start_byte].decode()
    begin, stop = source.rfind(b"\n", 0, start) + 1, source.find(b"\n", end)
    head, tail = source[begin:start], source[end : stop if stop >= 0 else len(source)]
    for alternative in texts:
        for template in (alternative,) if isinstance(alternative, str) else alternative(captures):
            text = template.format(**parts).encode()
            lines = (head + middle + tail for middle in (source[start:end], text))
            before, after = (re.sub(r"\s+", " ", line.decode()).strip() for line in lines)
            if before != after:
                yield Mutant(file, source.count(b"\n", 0, start) + 1, start, end, text, mistake, before, after)


def _is_skipped(node: Node) -> bool:
    if node.type in SKIPPED or (node.parent is not None and text_of(node.parent).startswith("strict=")):
        return node.type not in ("raise_statement", "throw_statement")  # lost as a whole
    while node.parent is not None and node.parent.type not in SKIPPED:
        node = node.parent
    return node.parent is not None
