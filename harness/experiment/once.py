"""A cache of results by the objects they were made from."""

from collections.abc import Callable
from typing import Any, TypeVar

_T = TypeVar("_T")
# With more entries, the parts are not repeated but always different.
_KEPT = 64
_PLAIN = (str, int, float, bool, type(None))


class Once:
    """A cache by name and parts; objects are compared by identity, numbers and strings by value."""

    def __init__(self) -> None:
        self._made: dict[str, dict[tuple[object, ...], tuple[tuple[object, ...], Any]]] = {}

    def __call__(self, name: str, parts: tuple[object, ...], make: Callable[[], _T]) -> _T:
        """The result of `make`, cached for equal parts."""
        key = tuple(part if isinstance(part, _PLAIN) else (id(part),) for part in parts)
        made = self._made.setdefault(name, {})
        if key not in made:
            value = make()
            if len(made) >= _KEPT:
                made.clear()
            # keep the parts alive, so that no other object gets their identity
            made[key] = parts, value
        found: _T = made[key][1]
        return found
