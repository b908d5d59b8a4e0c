"""Bugs of meaning in C and JavaScript sources, by their tokens: the same mistakes as in `semantic_python`."""

from collections.abc import Iterator

from tools.mutants.mutation import Change
from tools.mutants.semantic_python import OTHER_NAMES
from tools.mutants.token_changes import KEYWORDS, Token, closing, tokens_of

_OPEN, _CLOSE = {b"(", b"[", b"{"}, {b")", b"]", b"}"}
# What ends an operand of && and of a conditional expression.
_WEAKER = {b"&&", b"||", b",", b";", b"?", b":", b"=", b"=>", b"return", b"+=", b"-=", b"??"}
_FACTORS = {b"1000", b"1000.0", b"1e3", b"1e6", b"1e-3", b"100", b"180"}


def semantic_tokens(source: bytes) -> Iterator[list[Change]]:
    """The changes at each place of a source; a few may not compile."""
    tokens = tokens_of(source)
    for k, token in enumerate(tokens):
        if token.text in (b"&&", b"||"):
            yield from _dropped(source, tokens, k)
        elif token.text == b"?":
            yield from _options(source, tokens, k)
        elif token.text == b"[" and k + 2 < len(tokens) and tokens[k + 2].text == b"]":
            if tokens[k + 1].kind == "word" and k and tokens[k - 1].kind == "word":
                yield [Change(tokens[k + 1].start, tokens[k + 1].end, b"0", "stale")]
        elif token.text in (b"fabs", b"abs") and k + 1 < len(tokens) and tokens[k + 1].text == b"(":
            end = closing(tokens, k + 1)
            if end is not None:
                inner = source[tokens[k + 1].start : tokens[end].end]
                first = tokens[k - 2].start if k > 1 and tokens[k - 2].text == b"Math" else token.start
                yield [Change(first, tokens[end].end, sign + inner, "one side") for sign in (b"", b"-")]
        elif token.text in _FACTORS and k and tokens[k - 1].text in (b"*", b"/"):
            yield [Change(tokens[k - 1].start, token.end, b"", "unit")]
        elif token.text == b"<" and _is_of_a_loop(tokens, k):
            yield [Change(tokens[k + 1].end, tokens[k + 1].end, b" - 1", "block")]
        elif token.kind == "text" and token.text[1:-1].decode() in OTHER_NAMES:
            other = OTHER_NAMES[token.text[1:-1].decode()].encode()
            yield [Change(token.start + 1, token.end - 1, other, "name")]
        elif token.text in (b"{", b"["):
            yield from _swapped(source, tokens, k)
    yield from _siblings(tokens)


def _first_of(tokens: list[Token], k: int) -> int:
    """The first token of the operand that ends at k."""
    depth = 0
    for j in range(k, -1, -1):
        depth += tokens[j].text in _CLOSE
        depth -= tokens[j].text in _OPEN
        if depth < 0 or (depth == 0 and tokens[j].text in _WEAKER):
            return j + 1
    return 0


def _last_of(tokens: list[Token], k: int) -> int:
    """The last token of the operand that begins at k."""
    depth = 0
    for j in range(k, len(tokens)):
        depth += tokens[j].text in _OPEN
        depth -= tokens[j].text in _CLOSE
        if depth < 0 or (depth == 0 and tokens[j].text in _WEAKER):
            return j - 1
    return len(tokens) - 1


def _dropped(source: bytes, tokens: list[Token], k: int) -> Iterator[list[Change]]:
    first, last = _first_of(tokens, k - 1), _last_of(tokens, k + 1)
    if first < k < last + 1:
        span = (tokens[first].start, tokens[last].end)
        left = source[span[0] : tokens[k - 1].end]
        right = source[tokens[k + 1].start : span[1]]
        yield [Change(*span, left, "dropped"), Change(*span, right, "dropped")]


def _options(source: bytes, tokens: list[Token], k: int) -> Iterator[list[Change]]:
    """`c ? a : b` as `a`, and as `b`; only of simple alternatives."""
    first, middle = _first_of(tokens, k - 1), _last_of(tokens, k + 1)
    if middle + 2 >= len(tokens) or tokens[middle + 1].text != b":":
        return
    last = _last_of(tokens, middle + 2)
    if tokens[min(last + 1, len(tokens) - 1)].text in (b"?", b"&&", b"||"):
        return
    span = (tokens[first].start, tokens[last].end)
    texts = (source[tokens[k + 1].start : tokens[middle].end], source[tokens[middle + 2].start : span[1]])
    yield [Change(*span, b"(" + text + b")", "option") for text in texts]


def _is_of_a_loop(tokens: list[Token], k: int) -> bool:
    """Whether this < is the condition of `for (…; k < n; …)` with a simple bound."""
    return (
        2 <= k < len(tokens) - 2
        and tokens[k - 2].text == b";"
        and tokens[k + 2].text == b";"
        and tokens[k + 1].kind in ("word", "number")
    )


def _swapped(source: bytes, tokens: list[Token], k: int) -> Iterator[list[Change]]:
    """Neighbouring elements of an initialiser or array exchanged."""
    end = closing(tokens, k)
    before = tokens[k - 1].text if k else b""
    is_list = before in (b"=", b"(", b",", b"return", b"[", b"{", b":") or before == b"=>"
    if end is None or not is_list or (tokens[k].text == b"{" and before not in (b"=", b"{", b",")):
        return
    commas, depth = [k], 0
    for j in range(k, end):
        depth += tokens[j].text in _OPEN
        depth -= tokens[j].text in _CLOSE
        if depth == 1 and tokens[j].text == b",":
            commas.append(j)
        if tokens[j].text == b";" or (depth == 1 and tokens[j].text == b":"):
            return  # a block of statements, or an object with keys
    bounds = [*commas, end]
    for a, b, c in zip(bounds, bounds[1:], bounds[2:], strict=False):
        if b - a < 2 or c - b < 2:
            continue
        one, two = (tokens[a + 1].start, tokens[b - 1].end), (tokens[b + 1].start, tokens[c - 1].end)
        first, second = source[slice(*one)], source[slice(*two)]
        if first != second:
            yield [Change(one[0], two[1], second + source[one[1] : two[0]] + first, "swap")]


def _siblings(tokens: list[Token]) -> Iterator[list[Change]]:
    """A member of an object for the next one that the same function reads of it."""
    depth, reads = 0, dict[bytes, list[Token]]()
    for k, token in enumerate(tokens):
        depth += token.text == b"{"
        depth -= token.text == b"}"
        if token.text in (b"->", b".") and 0 < k < len(tokens) - 2 and tokens[k + 1].kind == "word":
            is_plain = tokens[k - 1].kind == "word" and (k < 2 or tokens[k - 2].text not in (b"->", b"."))
            is_written = tokens[k + 2].text in (b"=", b"(")
            if is_plain and not is_written and tokens[k - 1].text not in KEYWORDS | {b"Math"}:
                reads.setdefault(tokens[k - 1].text, []).append(tokens[k + 1])
        if depth == 0 and token.text == b"}":
            yield from _exchanged(reads)
            reads = {}
    yield from _exchanged(reads)


def _exchanged(reads: dict[bytes, list[Token]]) -> Iterator[list[Change]]:
    for members in reads.values():
        names = list(dict.fromkeys(member.text for member in members))
        for member in members if len(names) > 1 else ():
            other = names[(names.index(member.text) + 1) % len(names)]
            yield [Change(member.start, member.end, other, "sibling")]
