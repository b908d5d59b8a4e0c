"""Writes the glossary of reports into the page that has its mark: the words are said once, in the code."""

from typing import Any

from gough_stewart.harness.report.words import GLOSSARY

MARK = "<!-- glossary -->"


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Replace the mark by a table."""
    rows = [f"| {word} | {meaning} |" for word, meaning in GLOSSARY.items()]
    return markdown.replace(MARK, "\n".join(["| word | meaning |", "| --- | --- |", *rows]))
