"""Names for screen readers where the theme has none."""

from typing import Any

_SEARCH = '<div class="md-search" data-md-component="search" role="dialog"'


def on_post_page(output: str, **_: Any) -> str:
    """The search is a dialog, and is called so."""
    return output.replace(_SEARCH, f'{_SEARCH} aria-label="Search"')


def on_post_template(output_content: str, **_: Any) -> str:
    """The same on the page for addresses that are not there."""
    return output_content.replace(_SEARCH, f'{_SEARCH} aria-label="Search"')
