"""Texts in XML."""

import re

# What XML 1.0 does not allow, and the rest of the control characters.
_REFUSED = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")


def xml_text(text: str) -> str:
    """A text with a visible mark for each character that XML cannot have."""
    return _REFUSED.sub("\N{REPLACEMENT CHARACTER}", text)
