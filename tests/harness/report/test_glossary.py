"""Words that the page explains are marked in texts without harm to them."""

import html
import re

from gough_stewart.harness.report.glossary import GLOSSARY, explained, with_terms


def test_words_are_in_order() -> None:
    """As readers of the documentation look them up."""
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
