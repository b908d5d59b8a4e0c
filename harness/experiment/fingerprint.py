"""What a controller from Python is, and a hash of its code and values, as far as they are visible."""

import dis
import hashlib
import inspect
import pickle
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from gough_stewart.harness.control.linear_controller import LinearController
from gough_stewart.harness.control.makers import name_of
from gough_stewart.harness.control.state_space import is_control_system

_PACKAGE = __name__.partition(".")[0]


def fingerprint(controller: Any) -> str:
    """What a controller is in words, and a hash: the same in another process for the same code and values.

    Code of other modules does not count.
    """
    digest = hashlib.sha256()
    for part in _parts(controller, set()):
        digest.update(part + b"\0")
    name = str(controller) if isinstance(controller, str | Path) else ""
    if isinstance(controller, LinearController) or is_control_system(controller):
        name = type(controller).__name__
    return f"{name or name_of(controller)}, {digest.hexdigest()[:16]}"


def _parts(thing: Any, seen: set[int]) -> Iterator[bytes]:  # noqa: PLR0912 - a section for each kind
    if id(thing) in seen:
        return
    seen.add(id(thing))
    if isinstance(thing, MethodType):
        yield from _parts(thing.__self__, seen)
        yield from _parts(thing.__func__, seen)
    elif isinstance(thing, FunctionType):
        yield from _of_code(thing.__code__)
        # what it encloses and reads, its defaults and attributes: values, and functions of the same module
        code, known_globals = thing.__code__, thing.__globals__
        names, codes = set[str](), [code]
        while codes:  # the globals that it names, also in the functions inside it
            inside = codes.pop()
            steps = dis.get_instructions(inside)
            names |= {step.argval for step in steps if step.opname.endswith(("_GLOBAL", "_NAME"))}
            codes += [constant for constant in inside.co_consts if isinstance(constant, CodeType)]
        held: list[tuple[str, Any]] = [(name, known_globals[name]) for name in sorted(names & known_globals.keys())]
        for name, cell in zip(code.co_freevars, thing.__closure__ or (), strict=True):
            with suppress(ValueError):  # not bound yet
                held.append((name, cell.cell_contents))
        held += [("default", value) for value in thing.__defaults__ or ()]
        held += [*(thing.__kwdefaults__ or {}).items(), *vars(thing).items()]
        for name, value in held:
            # objects of this package, such as platforms, are constant, but keep what they compute on demand
            is_ours = type(value).__module__.partition(".")[0] == _PACKAGE
            is_elsewhere = isinstance(value, FunctionType) and value.__globals__ is not known_globals
            if not (is_ours or is_elsewhere or isinstance(value, type | ModuleType | BuiltinFunctionType)):
                yield name.encode()
                yield from _parts(value, seen) if isinstance(value, FunctionType) else _of_value(value)
    elif inspect.isclass(thing):
        yield thing.__qualname__.encode()
        for base in thing.__mro__:
            yield from _parts(base, seen)
        for name, value in vars(thing).items():
            if not name.startswith("__") or isinstance(value, FunctionType):
                yield name.encode()
                function = getattr(value, "__func__", getattr(value, "fget", value))
                yield from _parts(function, seen) if isinstance(function, FunctionType) else _of_value(function)
    elif isinstance(thing, LinearController):
        yield repr((thing.signals, thing.space)).encode()
        yield from _parts(thing.system, seen)
    elif all(hasattr(thing, name) for name in "ABCD"):
        yield repr([np.asarray(getattr(thing, name)).tolist() for name in "ABCD"] + [thing.dt]).encode()
    else:
        if not is_control_system(thing):
            yield from _parts(type(thing), seen)
        yield from _of_value(thing)


def _of_code(code: CodeType) -> Iterator[bytes]:
    """Instructions and constants, without line numbers and file names."""
    yield code.co_code
    yield repr((code.co_names, code.co_varnames, code.co_freevars)).encode()
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _of_code(constant)
        else:
            yield repr(sorted(constant, key=repr) if isinstance(constant, frozenset) else constant).encode()


def _of_value(value: Any, outer: tuple[int, ...] = ()) -> Iterator[bytes]:
    try:
        yield pickle.dumps(value)
    except Exception:
        # an object of a class that no module has, such as one of a function or a notebook
        yield type(value).__qualname__.encode()
        if id(value) not in outer and not isinstance(value, type | ModuleType):
            for name, inner in getattr(value, "__dict__", {}).items():
                yield name.encode()
                yield from _of_value(inner, (*outer, id(value)))
