"""Makers of controllers with memory: each run of each member gets a controller of its own."""

import copy
import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from gough_stewart.harness.errors import ControllerError
from gough_stewart.model.interface import nearest
from gough_stewart.model.platform import Platform

MAKE = "make(platform, sample_time, **parameters)"


class Maker(ABC):
    """Makes controllers of one design; a host asks it once for each real member, at that member's first sample.

    Copies that fill a vector of members and records never ask.
    """

    _ahead: tuple[Any, ...] = ()

    def make(self) -> Any:
        """A controller that shares no memory with those made before.

        Raises
        ------
        ControllerError
            The user's code fails.
        """
        if self._ahead:
            (found,), self._ahead = self._ahead, ()
            return found
        return self._make()

    def peek(self) -> Any:
        """The controller that `make` will give next, made by now and not called; otherwise as `make`."""
        if not self._ahead:
            self._ahead = (self._make(),)
        return self._ahead[0]

    @abstractmethod
    def _make(self) -> Any:
        """As `make`."""


@dataclass(frozen=True)
class Design:
    """What a class or factory designs a controller from."""

    platform: Platform  # the nominal model
    sample_time: float  # [s]
    parameters: Mapping[str, Any] = field(default_factory=dict)  # from `[controller.parameters]`


class Constructed(Maker):
    """Controllers made by a class or a factory.

    Raises
    ------
    ControllerError
        It cannot be called as `make(platform, sample_time, **parameters)`; names the keywords that it accepts.
    """

    def __init__(self, make: Callable[..., Any], design: Design) -> None:
        check_call(make, design)
        self._maker, self._design = make, design

    def _make(self) -> Any:
        return called(self._maker, self._design)


class Copied(Maker):
    """Deep copies of an object; the caller's own stays as it is.

    Raises
    ------
    ControllerError
        It cannot be copied.
    """

    def __init__(self, original: Any) -> None:
        # as it is now: what the caller does with it later does not matter
        self.original = _copied(original)

    def _make(self) -> Any:
        return _copied(self.original)


def _copied(original: Any) -> Any:
    try:
        return copy.deepcopy(original)
    except Exception as error:  # user code may raise anything
        raise ControllerError(
            f"the controller {name_of(original)} cannot be copied for each run ({type(error).__name__}: {error}); "
            f"use a factory, a class or function called as {MAKE} that makes a new one"
        ) from error


def called(make: Callable[..., Any], design: Design) -> Any:
    """A controller from a class or factory.

    Raises
    ------
    ControllerError
        It fails.
    """
    try:
        return make(design.platform, design.sample_time, **design.parameters)
    except ControllerError:
        raise
    except (Exception, SystemExit) as error:  # user code may raise anything
        raise ControllerError(f"{name_of(make)} failed with {type(error).__name__}: {error}") from error


def is_maker(controller: Callable[..., Any]) -> bool:
    """Whether a callable makes controllers: a class, or a function with two required arguments.

    Raises
    ------
    ControllerError
        It takes neither a sample alone, nor platform and sample time.
    """
    unwrapped = controller.func if isinstance(controller, partial) else controller
    if inspect.isclass(unwrapped):
        return True
    signature = _signature(controller)
    if signature is None or _binds(signature, None):
        return False
    required = [p for p in _named_parameters(signature) if p.default is p.empty]
    if _binds(signature, None, None, **{p.name: None for p in required}):
        return True
    raise ControllerError(
        f"{name_of(controller)} takes {signature}; expected a function of one Sample, or a class or factory called as "
        f"{MAKE}"
    )


def check_call(make: Callable[..., Any], design: Design) -> None:
    """Refuse a class or factory that cannot be called with the parameters of a design.

    Raises
    ------
    ControllerError
        Names what is wrong, and the keywords that it accepts.
    """
    signature = _signature(make)
    if signature is None or _binds(signature, None, None, **design.parameters):
        return
    own = _named_parameters(signature)
    accepted = [p.name for p in own]
    what = name_of(make)
    takes = f"{what} accepts {', '.join(accepted)}" if accepted else f"{what} accepts no parameters"
    takes_any = any(p.kind is p.VAR_KEYWORD for p in signature.parameters.values())
    for name in design.parameters:
        if name not in accepted and (not takes_any or name in signature.parameters):
            hint = nearest(name, accepted) if accepted else ""
            raise ControllerError(f"parameters: {takes}; found '{name}'{hint}")
    missing = [p.name for p in own if p.default is p.empty and p.name not in design.parameters]
    if missing and _binds(signature, None, None, **{**design.parameters, **dict.fromkeys(missing)}):
        raise ControllerError(f"parameters: {takes}; missing {', '.join(missing)}, add it to [controller.parameters]")
    raise ControllerError(f"{what} takes {signature}; expected to be called as {MAKE}")


def name_of(thing: Any) -> str:
    """A class, function or object in messages."""
    if inspect.isclass(thing):
        return f"class {thing.__qualname__}"
    name = getattr(thing, "__qualname__", None)
    return f"{name}()" if name else f"object of class {type(thing).__qualname__}"


def _named_parameters(signature: inspect.Signature) -> list[inspect.Parameter]:
    """The parameters after platform and sample time that may be given by name."""
    parameters = list(signature.parameters.values())
    positional = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    return [p for p in parameters if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY) and p not in positional[:2]]


def _signature(function: Callable[..., Any]) -> inspect.Signature | None:
    """None for built-in functions that have none."""
    try:
        return inspect.signature(function)
    except (TypeError, ValueError):
        return None


def _binds(signature: inspect.Signature, *arguments: Any, **keywords: Any) -> bool:
    try:
        signature.bind(*arguments, **keywords)
    except TypeError:
        return False
    return True
