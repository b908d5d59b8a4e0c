"""Sees memory in a function that all members share: values that its calls change."""

import dis
import pickle
from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from hashlib import sha256
from types import BuiltinFunctionType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any

from gough_stewart.harness.control.python.makers import name_of
from gough_stewart.harness.errors import SharedMemoryError

_PACKAGE = __name__.partition(".")[0]


class Watch:
    """Remembers what a function holds, to find out whether its calls change it.

    Seen are closure variables, default values, attributes and the globals that it names, also through functions of the
    same module that it names, as far as they can be pickled. Not seen is what others hold for it: attributes of
    modules and classes, files, and memory in compiled code.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self._before = dict(_digests(function))

    def changed(self) -> str:
        """What the calls have changed, in words; "" if nothing that is seen."""
        now = dict(_digests(self._function))
        names = (name for name in (*self._before, *now) if self._before.get(name) != now.get(name))
        return next(names, "")

    def check(self) -> None:
        """Refuse a function whose calls have changed something.

        Raises
        ------
        SharedMemoryError
            Names what has changed.
        """
        name = self.changed()
        if name:
            raise SharedMemoryError(
                f"the function {name_of(self._function)} keeps memory between samples: {name} has changed, and all "
                "members would share it; use a factory: a class or function, called as make(platform, sample_time), "
                "that makes a controller for each member"
            )


def _digests(function: Callable[..., Any]) -> Iterator[tuple[str, str]]:
    for name, value in values_of(function):
        try:
            yield name, sha256(pickle.dumps(value)).hexdigest()
        except Exception:
            continue


def values_of(function: Any, seen: set[int] | None = None) -> Iterator[tuple[str, Any]]:
    """What a function holds, by name; constants of this package and of modules are left out."""
    seen = set() if seen is None else seen
    if id(function) in seen:
        return
    seen.add(id(function))
    if not isinstance(function, FunctionType):
        return
    code, where = function.__code__, function.__qualname__
    for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
        try:
            yield from _values(f"the closure variable '{name}' of {where}", cell.cell_contents, function, seen)
        except ValueError:  # not bound yet
            continue
    arguments = code.co_varnames[: code.co_argcount]
    defaults = function.__defaults__ or ()
    for name, value in zip(arguments[len(arguments) - len(defaults) :], defaults, strict=True):
        yield from _values(f"the default of '{name}' of {where}", value, function, seen)
    for name, value in (function.__kwdefaults__ or {}).items():
        yield from _values(f"the default of '{name}' of {where}", value, function, seen)
    for name, value in vars(function).items():
        yield from _values(f"the attribute '{name}' of {where}", value, function, seen)
    for name in sorted(_names(code)):
        if name in function.__globals__:
            yield from _values(f"the global '{name}'", function.__globals__[name], function, seen)


def functions_in(thing: Any, depth: int = 4) -> Iterator[FunctionType]:
    """The functions that an object holds, which its deep copies share with it."""
    if isinstance(thing, FunctionType):
        yield thing
    if depth == 0 or isinstance(thing, FunctionType | type | ModuleType) or _is_ours(thing):
        return
    parts: list[Any] = []
    if isinstance(thing, MethodType):
        parts = [thing.__self__]
    elif isinstance(thing, partial):
        parts = [thing.func, *thing.args, *thing.keywords.values()]
    elif isinstance(thing, dict):
        parts = list(thing.values())
    elif isinstance(thing, list | tuple | set):
        parts = list(thing)
    elif hasattr(thing, "__dict__"):
        parts = list(vars(thing).values())
    for part in parts:
        yield from functions_in(part, depth - 1)


def _values(name: str, value: Any, function: FunctionType, seen: set[int]) -> Iterator[tuple[str, Any]]:
    if isinstance(value, FunctionType):
        if value.__globals__ is function.__globals__:
            yield from values_of(value, seen)
    elif not isinstance(value, type | ModuleType | BuiltinFunctionType) and not _is_ours(value):
        yield name, value


def _is_ours(value: Any) -> bool:
    """Whether it is an object of this package, such as a platform: constant, but with values computed on demand."""
    return type(value).__module__.partition(".")[0] == _PACKAGE


@lru_cache(256)
def _names(code: CodeType) -> frozenset[str]:
    """The globals that code names, with the functions inside it."""
    own = {each.argval for each in dis.get_instructions(code) if each.opname.endswith(("_GLOBAL", "_NAME"))}
    inner = (each for each in code.co_consts if isinstance(each, CodeType))
    return frozenset(own).union(*(_names(each) for each in inner))
