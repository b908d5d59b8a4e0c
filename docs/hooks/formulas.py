"""Formulas as MathML when the site is built, so that browsers draw them without a script.

Pages write LaTeX between dollars, which code hosts draw too. `pymdownx.arithmatex` finds it, this hook converts it.
"""

import re
from typing import Any

from gough_stewart.fmu_build.formulas import mathml

INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
BLOCK = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)


def on_page_content(content: str, **_: Any) -> str:
    """Every formula of a page that is HTML already."""
    content = INLINE.sub(lambda found: mathml(found[1], "inline"), content)
    return BLOCK.sub(lambda found: f'<div class="formula">{mathml(found[1], "block")}</div>', content)
