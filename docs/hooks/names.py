"""Mends what the theme and Markdown leave out for screen readers: a name of the search, cells that head nothing."""

import re
from typing import Any

_SEARCH = '<div class="md-search" data-md-component="search" role="dialog"'
_EMPTY_HEAD = re.compile(r"<th([^>]*)></th>")


def on_page_content(html: str, **_: Any) -> str:
    """Make empty heads of tables plain cells."""
    return _EMPTY_HEAD.sub(r"<td\1></td>", html)


def on_post_page(output: str, **_: Any) -> str:
    """Name the search dialog."""
    return output.replace(_SEARCH, f'{_SEARCH} aria-label="Search"')


def on_post_template(output_content: str, **_: Any) -> str:
    """Name it on the 404 page, too."""
    return output_content.replace(_SEARCH, f'{_SEARCH} aria-label="Search"')
