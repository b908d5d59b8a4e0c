"""Formulas of Markdown pages as MathML, which browsers render without a script, for the site and the FMU's page."""

import html
import re
from functools import cache

from latex2mathml.converter import convert

# The converter's output for \begin{bmatrix}.
_MATRIX = re.compile(r"<mo>&#x0005B;</mo>(<mtable>.*?</mtable>)<mo>&#x0005D;</mo>", re.DOTALL)
_HEADING = re.compile(r"(#+) (.*)")
_INLINE = re.compile(r"\$(?P<formula>[^$]+)\$|`(?P<code>[^`]+)`|\*\*(?P<strong>[^*]+)\*\*")
# MathML brackets around a matrix grow with it only if a mathematics font is installed; these always do.
STYLE = """
.formula { margin: 0.8rem 0 0.8rem 2rem; overflow-x: auto; }
mrow.matrix { border: solid currentColor; border-width: 0 0.08em; padding: 0 0.2em;
       background: linear-gradient(currentColor, currentColor) 0 0 / 0.35em 0.08em no-repeat,
       linear-gradient(currentColor, currentColor) 0 100% / 0.35em 0.08em no-repeat,
       linear-gradient(currentColor, currentColor) 100% 0 / 0.35em 0.08em no-repeat,
       linear-gradient(currentColor, currentColor) 100% 100% / 0.35em 0.08em no-repeat; }
"""


@cache  # the pages of both FMI versions have their formulas in common
def mathml(latex: str, display: str) -> str:
    """One formula, `inline` or `block`.

    Raises
    ------
    ValueError
        A command that the converter or browsers do not support.
    """
    element: str = convert(html.unescape(latex).strip(), display=display)
    # browsers support upright letters, but not sans-serif ones
    element = element.replace('mathvariant="sans-serif"', 'mathvariant="normal"')
    unknown = re.search(r'\\\w+|mathvariant="(?!normal)[\w-]+"', html.unescape(element))
    if unknown:
        raise ValueError(f"no MathML for {unknown[0]} in the formula {latex.strip()}")
    return _MATRIX.sub(r'<mrow class="matrix">\1</mrow>', element)


def to_html(markdown: str) -> str:
    """HTML of paragraphs, headings and formulas `$$…$$` separated by empty lines; `$…$`, code and bold text inline.

    A heading with one # becomes h2, and so on.
    """
    blocks = [block.strip() for block in re.split(r"\n\s*\n", markdown) if block.strip()]
    return "\n".join(_block(block) for block in blocks)


def _block(block: str) -> str:
    heading = _HEADING.fullmatch(block)
    if heading:
        level = len(heading[1]) + 1
        return f"<h{level}>{_inline(heading[2])}</h{level}>"
    if block.startswith("$$") and block.endswith("$$"):
        return f'<div class="formula">{mathml(block[2:-2], "block")}</div>'
    return f"<p>{_inline(block)}</p>"


def _inline(text: str) -> str:
    parts, at = [], 0
    for found in _INLINE.finditer(text):
        parts.append(html.escape(text[at : found.start()], quote=False))
        at = found.end()
        if found["formula"]:
            parts.append(mathml(found["formula"], "inline"))
        elif found["code"]:
            parts.append(f"<code>{html.escape(found['code'], quote=False)}</code>")
        else:
            parts.append(f"<strong>{_inline(found['strong'])}</strong>")
    return "".join([*parts, html.escape(text[at:], quote=False)])
