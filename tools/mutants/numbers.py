"""Numbers slightly different from a literal, in the syntax of its language."""

import re

_NUMBER = re.compile(r"(?P<value>0[xX][0-9a-fA-F]+|[0-9.][0-9_.]*([eE][+-]?[0-9]+)?)(?P<suffix>[uUlLfFzn]*)$")


def other_numbers(text: str) -> list[str]:
    """An integer plus and minus one; another number times 1.1, and its negative."""
    found = _NUMBER.match(text)
    if found is None:
        return []
    value, suffix = found["value"].replace("_", ""), found["suffix"]
    if re.fullmatch(r"0[xX][0-9a-fA-F]+|[0-9]+", value):
        is_hex = value[1:2] in {"x", "X"}
        integer = int(value, 16 if is_hex else 10)
        return [
            f"{other:#x}{suffix}" if is_hex else f"{other}{suffix}"
            for other in (integer + 1, integer - 1)
            if other >= 0
        ]
    larger = 1.1 * float(value)
    return [f"{larger!r}{suffix}", f"(-{value}{suffix})"] if larger else [f"1.0{suffix}"]
