"""Words that the page explains: the same as in the documentation, and marked in texts without harm to them."""

import html
import re
from pathlib import Path

from gough_stewart.harness.report.words import GLOSSARY, explained, with_terms

DOCS = Path(__file__).parents[3] / "docs"


def test_the_documentation_has_the_same_words() -> None:
    """Expected: the table of docs/notation.md, row by row."""
    section = (DOCS / "notation.md").read_text(encoding="utf-8").split("## Glossary")[1]
    rows = [tuple(cell.strip() for cell in line.split("|")[1:-1]) for line in section.splitlines() if "|" in line]
    assert dict(rows[2:]) == GLOSSARY  # type: ignore[arg-type]
    assert list(GLOSSARY) == sorted(GLOSSARY, key=str.casefold)


def test_the_first_of_each_word_is_marked_and_the_text_stays() -> None:
    """Expected: whole words only, in singular or plural, longer terms first; markup of a user stays text."""
    text = "The phase margins <b>and the phase margin</b> of feedforwarding a Reference & home"
    found = with_terms(text)
    assert html.unescape(re.sub(r"</?span[^>]*>", "", found)) == text
    assert re.findall(r'tabindex="0" data-means="[^"]+">([^<]+)<', found) == ["phase margins", "Reference", "home"]
    assert html.escape(GLOSSARY["phase margin"]) in found
    assert with_terms("nothing of the kind") == "nothing of the kind"
    assert explained("rise", 'a "time"') == '<span class="term" tabindex="0" data-means="a &#34;time&#34;">rise</span>'
