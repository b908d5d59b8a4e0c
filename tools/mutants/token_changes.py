"""Changes of C and JavaScript sources by their tokens, of the same kinds as those of Python."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from tools.mutants.mutation import Change
from tools.mutants.numbers import other_numbers

_TOKEN = re.compile(
    rb"""(?P<blank>\s+|//[^\n]*|/\*.*?\*/|^[ \t]*\#(?:\\\n|[^\n])*)
    |(?P<text>"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*'|`(?:\\.|[^`\\])*`)
    |(?P<number>(?:0[xX][0-9a-fA-F]+|(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)[uUlLfFn]*)
    |(?P<word>[A-Za-z_$][\w$]*)
    |(?P<sign>>>>=|===|!==|\*\*=|<<=|>>=|>>>|\.\.\.|->|\+\+|--|&&|\|\||\?\?|\?\.|=>|\*\*|[-+*/%&|^<>=!]=|<<|>>|.)
    """,
    re.VERBOSE | re.DOTALL | re.MULTILINE,
)
_REGULAR_EXPRESSION = re.compile(rb"/(?![*/])(?:\\.|\[(?:\\.|[^\]\\\n])*\]|[^/\\\n])+/[a-z]*")
OTHERS = {
    **{b"+": (b"-",), b"-": (b"+",), b"*": (b"/",), b"/": (b"*",), b"%": (b"*",), b"**": (b"*",)},
    **{b"+=": (b"-=",), b"-=": (b"+=",), b"*=": (b"/=",), b"/=": (b"*=",), b"++": (b"--",), b"--": (b"++",)},
    **{b"<": (b"<=", b">"), b"<=": (b"<", b">"), b">": (b">=", b"<"), b">=": (b">", b"<")},
    **{b"==": (b"!=",), b"!=": (b"==",), b"===": (b"!==",), b"!==": (b"===",)},
    **{b"&&": (b"||",), b"||": (b"&&",), b"??": (b"&&",), b"|": (b"&",), b"&": (b"|",)},
}
WORDS = {
    **{b"true": b"false", b"false": b"true", b"break": b"continue", b"continue": b"break"},
    **{b"sin": b"cos", b"cos": b"sin", b"fmin": b"fmax", b"fmax": b"fmin", b"min": b"max", b"max": b"min"},
    **{b"floor": b"ceil", b"ceil": b"floor", b"some": b"every", b"every": b"some"},
}
# Statements that begin with these are not calls or assignments.
KEYWORDS = frozenset(
    b"return if else for while do switch case default goto break continue const static extern struct enum union typedef"
    b" let var function class import export throw try catch new delete async await unsigned signed int double char"
    b" void size_t bool float long short".split()
)
# Calls whose first two arguments commute.
_COMMUTATIVE = {b"min", b"max", b"fmin", b"fmax", b"dot", b"hypot"}
_BINARY = {b"+", b"-", b"*", b"/", b"%", b"<", b">", b"|", b"&"}


@dataclass(frozen=True)
class Token:
    kind: str
    text: bytes
    start: int

    @property
    def end(self) -> int:
        return self.start + len(self.text)


def token_changes(source: bytes) -> Iterator[list[Change]]:
    """The changes at each place of a source; a few may not compile."""
    tokens = tokens_of(source)
    for k, token in enumerate(tokens):
        before = tokens[k - 1].text if k else b""
        if _is_size_of_an_array(tokens, k):
            continue
        if token.kind == "number":
            others = [other.encode() for other in other_numbers(token.text.decode())]
        elif token.kind == "word" and before not in {b".", b"->"} - (
            {b"."} if token.text in {b"min", b"max"} else set()
        ):
            others = [WORDS[token.text]] if token.text in WORDS else []
        elif token.kind == "sign" and (token.text not in _BINARY or _is_binary(source, tokens, k)):
            others = list(OTHERS.get(token.text, ()))
        else:
            others = []
        if token.text in {b"!", b"-"} and not others and token.kind == "sign":
            others = [b""]
        if others:
            yield [Change(token.start, token.end, other) for other in others]
    yield from _conditions(source, tokens)
    yield from _statements(tokens)
    yield from _arguments(source, tokens)


def tokens_of(source: bytes) -> list[Token]:
    tokens: list[Token] = []
    place = 0
    while place < len(source):
        ends_operand = tokens and (
            tokens[-1].kind in {"number", "word", "text"} or tokens[-1].text in {b")", b"]", b"}"}
        )
        if tokens and tokens[-1].text == b"return":
            ends_operand = False
        found = None if ends_operand else _REGULAR_EXPRESSION.match(source, place)
        kind = "text"
        if found is None:
            found = _TOKEN.match(source, place)
            assert found is not None
            kind = found.lastgroup or ""
        if kind != "blank":
            tokens.append(Token(kind, found.group(), place))
        place = found.end()
    return tokens


def _is_binary(source: bytes, tokens: list[Token], k: int) -> bool:
    """Whether an operator is binary: pointers and signs have no blank after them."""
    if k == 0 or not (tokens[k - 1].kind in {"number", "word", "text"} or tokens[k - 1].text in {b")", b"]"}):
        return False
    around = source[tokens[k].start - 1 : tokens[k].start], source[tokens[k].end : tokens[k].end + 1]
    return tokens[k - 1].text not in KEYWORDS and around[0].isspace() == around[1].isspace()


def _is_size_of_an_array(tokens: list[Token], k: int) -> bool:
    """Whether a token is in brackets of a declaration, where another size has no effect or does not compile."""
    opening = next((j for j in range(k - 1, -1, -1) if tokens[j].text in {b"[", b"]", b";", b"{", b"}", b"="}), None)
    if opening is None or tokens[opening].text != b"[":
        return False
    first = opening
    while first and tokens[first - 1].text not in {b";", b"{", b"}", b"(", b","}:
        first -= 1
    return tokens[first].text != b"return" and _declares(tokens[first:opening])


def closing(tokens: list[Token], k: int) -> int | None:
    depth = 0
    for j in range(k, len(tokens)):
        depth += tokens[j].text in {b"(", b"[", b"{"}
        depth -= tokens[j].text in {b")", b"]", b"}"}
        if depth == 0:
            return j
    return None


def _conditions(source: bytes, tokens: list[Token]) -> Iterator[list[Change]]:
    for k, token in enumerate(tokens[:-1]):
        if token.text == b"if" and tokens[k + 1].text == b"(" and (last := closing(tokens, k + 1)):
            start, end = tokens[k + 1].start, tokens[last].end
            yield [Change(start, end, b"(!" + source[start:end] + b")")]


def _statements(tokens: list[Token]) -> Iterator[list[Change]]:
    """Removed calls and assignments."""
    depth = 0
    for k, token in enumerate(tokens):
        starts = (
            depth == 0
            and k > 0
            and (tokens[k - 1].text in {b";", b"{", b"}", b"else"} or _ends_condition(tokens, k - 1))
        )
        depth += token.text in {b"(", b"["}
        depth -= token.text in {b")", b"]"}
        if not starts or token.kind != "word" or token.text in KEYWORDS or k + 1 == len(tokens):
            continue
        if tokens[k + 1].kind == "word" or tokens[k + 1].text in {b"*", b":", b","}:
            continue  # a declaration, a label or an enumeration
        inner = 0
        for j in range(k, len(tokens)):
            inner += tokens[j].text in {b"(", b"[", b"{"}
            inner -= tokens[j].text in {b")", b"]", b"}"}
            if inner < 0:
                break
            if tokens[j].text == b";" and inner == 0:
                yield [Change(token.start, tokens[j].end, b";")]
                break


def _ends_condition(tokens: list[Token], k: int) -> bool:
    """Whether this parenthesis closes an `if (…)` or `for (…)`."""
    if tokens[k].text != b")":
        return False
    opening = next((j for j in range(k - 1, 0, -1) if tokens[j].text == b"(" and closing(tokens, j) == k), 0)
    return opening > 0 and tokens[opening - 1].text in {b"if", b"for", b"while"}


def _arguments(source: bytes, tokens: list[Token]) -> Iterator[list[Change]]:
    """First two arguments of a call exchanged."""
    for k in range(1, len(tokens)):
        called = (
            tokens[k].text == b"("
            and tokens[k - 1].kind == "word"
            and tokens[k - 1].text not in KEYWORDS | _COMMUTATIVE
        )
        last = closing(tokens, k) if called else None
        if last is None or tokens[min(last + 1, len(tokens) - 1)].text == b"{":
            continue
        commas, depth = [], 0
        for j in range(k, last):
            depth += tokens[j].text in {b"(", b"[", b"{"}
            depth -= tokens[j].text in {b")", b"]", b"}"}
            if tokens[j].text == b"," and depth == 1:
                commas.append(j)
        if not commas:
            continue
        end = (commas[1:] or [last])[0]
        spans = [(tokens[k + 1].start, tokens[commas[0] - 1].end), (tokens[commas[0] + 1].start, tokens[end - 1].end)]
        first, second = (source[a:b] for a, b in spans)
        if any(token.kind == "text" for token in tokens[k:end]):
            continue  # texts are not changed
        if first != second and not _declares(tokens[k + 1 : commas[0]]):
            yield [Change(spans[0][0], spans[1][1], second + source[spans[0][1] : spans[1][0]] + first)]


def _declares(tokens: list[Token]) -> bool:
    """Whether an argument is a parameter of a declaration: two successive words, or a word and a pointer."""
    return any(
        a.kind == "word" and (b.kind == "word" or (b.text == b"*" and b.start > a.end and c.start == b.end))
        for a, b, c in zip(tokens, tokens[1:], [*tokens[2:], Token("", b"", -1)], strict=False)
    )
