"""Templates of the hand-written C around the traced functions, with placeholders and optional parts."""

import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from textwrap import fill

_ROOM = Path(__file__).parent / "c"


def read(name: str) -> str:
    """A template."""
    return (_ROOM / name).read_text(encoding="utf-8")


SOURCE, HEADER, EXAMPLE = map(read, ("step.c", "step.h", "example_main.c"))
_CONDITION = re.compile(r"^@(if|else|end)\b ?(\w*)\n", re.M)


def filled(text: str, facts: Mapping[str, str | bool]) -> str:
    """A text with `@NAME@` replaced; lines between `@if name`, `@else` and `@end` are kept only if the name is true."""
    lines: list[str] = []
    written = [True]
    for line in text.splitlines(keepends=True):
        mark = _CONDITION.fullmatch(line)
        if mark is None:
            if all(written):
                lines.append(re.sub(r"@(\w+)@", lambda match: str(facts[match[1]]), line))
        elif mark[1] == "if":
            written.append(bool(facts[mark[2]]))
        elif mark[1] == "else":
            written[-1] = not written[-1]
        else:
            written.pop()
    return "".join(lines)


# Comments in ASCII, for every compiler and editor.
_ASCII = str.maketrans({"×": "x", "±": "+-", "°": " deg", "–": "-", "—": "-", "µ": "u"})


def comment(paragraphs: Iterable[str]) -> str:
    """Paragraphs inside a comment of C, a line of at most 120 characters each, without the end of the comment."""
    plain = (text.translate(_ASCII).encode("ascii", "replace").decode() for text in paragraphs)
    safe = (text.replace("*/", "* /").replace("/*", "/ *").replace("\\", "/") for text in plain)
    return "\n".join(fill(text, 120, initial_indent="   - ", subsequent_indent="     ") for text in safe)


def number(value: float) -> str:
    """A number in C, exactly."""
    if math.isinf(value):
        return "HUGE_VAL" if value > 0 else "-HUGE_VAL"
    return repr(float(value))


def numbers(values: Iterable[float]) -> str:
    """Numbers separated by commas; a zero if there are none."""
    return ", ".join(number(float(value)) for value in values) or "0.0"
