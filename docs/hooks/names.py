"""Adds names for screen readers that the theme lacks."""

from typing import Any

_SEARCH = '<div class="md-search" data-md-component="search" role="dialog"'


def on_post_page(output: str, **_: Any) -> str:
    """Name the search dialog."""
    return output.replace(_SEARCH, f'{_SEARCH} aria-label="Search"')


def on_post_template(output_content: str, **_: Any) -> str:
    """The same on the 404 page."""
    return output_content.replace(_SEARCH, f'{_SEARCH} aria-label="Search"')
