"""Outputs that a page shows, `text` blocks right below what prints them, against what was printed.

A line `…` in such a block stands for lines that are left out. Durations and sizes of files differ from run to run.
"""

import re
from collections.abc import Mapping
from itertools import pairwise

from tools.pages.blocks import Block

LEFT_OUT = "…"
# durations, sizes, speeds
_VOLATILE = re.compile(r"(?<=in )(\d+ min )?[\d.]+(?= s\b)|[\d.]+ [kKM]?i?B\b|\d+(?= members/s)")


def shown_below(blocks: list[Block], page_text: str) -> dict[Block, Block]:
    """The output block of every block that has one: with nothing but blank lines in between."""
    found = {}
    for block, below in pairwise(blocks):
        between = page_text[block.start + len(block.text) : below.start].split()
        if between == ["```", "```text"]:
            found[block] = below
    return found


def printed_text(printed: str) -> str:
    """As a page shows it: no spaces at line ends, no blank lines around."""
    lines = [line.rstrip() for line in printed.splitlines()]
    return "\n".join(lines).strip("\n") + "\n"


def excerpt(shown: str, printed: str) -> str:
    """The part of what was printed that is shown: as many first and last lines as around the line `…`."""
    lines = printed_text(printed).splitlines()
    kept = shown.splitlines()
    if LEFT_OUT in kept:
        first = kept.index(LEFT_OUT)
        last = len(kept) - first - 1
        lines = [*lines[:first], LEFT_OUT, *lines[len(lines) - last :]]
    return "\n".join(lines) + "\n"


def up_to_date(shown: str, printed: str) -> str:
    """What the page is to show: what it shows already, unless it differs in more than durations and sizes."""
    new = excerpt(shown, printed)
    return shown if comparable(shown) == comparable(new) else new


def comparable(text: str) -> str:
    """The text without what differs from run to run."""
    return _VOLATILE.sub("#", text)


def with_outputs(page_text: str, outputs: Mapping[Block, str]) -> str:
    """The page with other texts in its output blocks."""
    for block in sorted(outputs, key=lambda each: -each.start):
        page_text = page_text[: block.start] + outputs[block] + page_text[block.start + len(block.text) :]
    return page_text
