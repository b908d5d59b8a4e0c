"""Keeps docstrings as plain text: two brackets in a row, as in K [a; b] [c; d], are not a link."""

from typing import Any

from griffe import Extension, Object


class PlainDocstrings(Extension):
    """Puts two spaces between brackets: Markdown reads them as text, browsers show one space."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Called for every module, class, function and attribute."""
        if obj.docstring:
            obj.docstring.value = obj.docstring.value.replace("] [", "]  [")
