"""Converts formulas to MathML when the site is built, so that browsers draw them without a script.

Pages have LaTeX between dollar signs, which code hosts also render. `pymdownx.arithmatex` finds it, and this hook
converts it.
"""

import re
from typing import Any

from gough_stewart.fmu_build.documents import mathml

INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
BLOCK = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)


def on_page_content(content: str, **_: Any) -> str:
    """Convert all formulas of a page after its conversion to HTML."""
    content = INLINE.sub(lambda found: mathml(found[1], "inline"), content)
    return BLOCK.sub(lambda found: f'<div class="formula">{mathml(found[1], "block")}</div>', content)
