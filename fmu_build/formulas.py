"""Formulas of Markdown pages as MathML, which browsers render without a script, for the site and the FMU's page."""

import html
import re
from functools import cache

from latex2mathml.converter import convert

# The converter's output for \begin{bmatrix}.
_MATRIX = re.compile(r"<mo>&#x0005B;</mo>(<mtable>.*?</mtable>)<mo>&#x0005D;</mo>", re.DOTALL)
_HEADING = re.compile(r"(#+) (.*)")
_INLINE = re.compile(r"\$(?P<formula>[^$]+)\$|`(?P<code>[^`]+)`|\*\*(?P<strong>[^*]+)\*\*")


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
    elements = []
    for text in re.split(r"\n\s*\n", html.escape(markdown, quote=False).strip()):
        block = text.strip()
        if heading := _HEADING.fullmatch(block):
            level = len(heading[1]) + 1
            elements.append(f"<h{level}>{_inline(heading[2])}</h{level}>")
        elif block.startswith("$$") and block.endswith("$$"):
            elements.append(f'<div class="formula">{mathml(block[2:-2], "block")}</div>')
        elif block:
            elements.append(f"<p>{_inline(block)}</p>")
    return "\n".join(elements)


def _inline(text: str) -> str:
    """An escaped text with its formulas, code and bold parts as elements."""

    def element(match: re.Match[str]) -> str:
        if match["formula"]:
            return mathml(match["formula"], "inline")
        return f"<code>{match['code']}</code>" if match["code"] else f"<strong>{_inline(match['strong'])}</strong>"

    return _INLINE.sub(element, text)
