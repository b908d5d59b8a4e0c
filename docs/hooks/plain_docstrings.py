"""Docstrings are plain text: two brackets in a row, as in K [a; b] [c; d], are no link."""

from typing import Any

from griffe import Extension, Object


class PlainDocstrings(Extension):
    """Sets brackets two spaces apart, which Markdown takes for text and browsers draw as one space."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Called for every module, class, function and attribute."""
        if obj.docstring:
            obj.docstring.value = obj.docstring.value.replace("] [", "]  [")
