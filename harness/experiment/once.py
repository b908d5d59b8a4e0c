"""What is made from the same things is made once."""

from collections.abc import Callable
from typing import Any, TypeVar

_T = TypeVar("_T")
# More are not the same things again and again, but different ones.
_KEPT = 64
_PLAIN = (str, int, float, bool, type(None))


class Once:
    """A memory of what was made: by name, and from which parts; objects by identity, numbers and texts by value."""

    def __init__(self) -> None:
        self._made: dict[str, dict[tuple[object, ...], tuple[tuple[object, ...], Any]]] = {}

    def __call__(self, name: str, parts: tuple[object, ...], make: Callable[[], _T]) -> _T:
        """What `make` gives, or gave for the same parts."""
        key = tuple(part if isinstance(part, _PLAIN) else (id(part),) for part in parts)
        made = self._made.setdefault(name, {})
        if key not in made:
            value = make()
            if len(made) >= _KEPT:
                made.clear()
            # with the parts, so that no other object gets their identity
            made[key] = parts, value
        found: _T = made[key][1]
        return found
