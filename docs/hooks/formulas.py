"""Formulas as MathML when the site is built, so that browsers draw them without a script.

Pages write LaTeX between dollars, which code hosts draw too. `pymdownx.arithmatex` finds it, this hook converts it.
"""

import html
import re
from typing import Any

from latex2mathml.converter import convert

INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
# As the converter writes \begin{bmatrix}.
MATRIX = re.compile(r"<mo>&#x0005B;</mo>(<mtable>.*?</mtable>)<mo>&#x0005D;</mo>", re.DOTALL)
BLOCK = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)


def mathml(latex: str, display: str) -> str:
    """One formula. A command that the converter does not know, or browsers do not, is an error."""
    made = convert(html.unescape(latex).strip(), display=display)
    # browsers know upright letters, not those without serifs
    made = made.replace('mathvariant="sans-serif"', 'mathvariant="normal"')
    unknown = re.search(r'\\\w+|mathvariant="(?!normal)[\w-]+"', html.unescape(made))
    if unknown:
        raise ValueError(f"no MathML for {unknown[0]} in the formula {latex.strip()}")
    # Brackets grow with a matrix only where there is a font for mathematics; those of the style sheet always do.
    return MATRIX.sub(r'<mrow class="matrix">\1</mrow>', made)


def on_page_content(content: str, **_: Any) -> str:
    """Every formula of a page that is HTML already."""
    content = INLINE.sub(lambda found: mathml(found[1], "inline"), content)
    return BLOCK.sub(lambda found: f'<div class="formula">{mathml(found[1], "block")}</div>', content)
