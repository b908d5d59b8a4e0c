"""Controllers of the user in Python: what they are told, how each member gets its own, and the files they come from."""

import copy
import inspect
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, chdir, contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from importlib import invalidate_caches
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from importlib.util import module_from_spec
from pathlib import Path
from types import FrameType, MappingProxyType, ModuleType
from typing import Any, NamedTuple, cast

import numpy as np

from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.model.interface import nearest
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

NO_FORCE = np.zeros(N_LEGS)
NO_FORCE.flags.writeable = False
_MAKE = "make(platform, sample_time, **parameters)"
_PACKAGE = __name__.partition(".")[0]
_LOCK = threading.RLock()
_LIBRARIES = frozenset(("casadi", "importlib", "numpy", _PACKAGE))


class Sample(NamedTuple):
    """What a controller in Python receives at a sample: the information that a digital controller on the machine has.

    Signals are by name, in SI units: position, orientation, velocity, angular_velocity, leg_length, leg_velocity.
    Arrays are copies: changing or keeping them does not affect the run.

    Examples
    --------
    >>> def law(sample: gs.Sample):
    ...     error = sample.reference["leg_length"] - sample.measured["leg_length"]
    ...     return 8e4 * error - 9e3 * sample.measured["leg_velocity"]
    >>> record = gs.run("heave_step", {"loop.duration": 0.1}, controller=law)

    With memory, as a class:

    >>> class Integral:
    ...     def __init__(self, platform, sample_time, ki=2e5):
    ...         self.gain, self.force = ki * sample_time, 0.0
    ...     def __call__(self, sample):
    ...         self.force += self.gain * (sample.reference["leg_length"] - sample.measured["leg_length"])
    ...         return law(sample) + self.force
    >>> record = gs.run("heave_step", {"loop.duration": 0.1}, controller=Integral)
    """

    time: float
    """[s], a multiple of the sample time, also with jitter."""
    reference: Mapping[str, FloatArray]
    """The reference signals (3,) or (6,) in SI units, with acceleration and angular_acceleration."""
    measured: Mapping[str, FloatArray]
    """The measurements of the sensors (3,) or (6,) in SI units."""
    index: int = 0  # type: ignore[assignment]  # hides the method of a tuple
    """The number of the sample, from 0."""
    sample_time: float = 0.0
    """[s]."""
    command: FloatArray = NO_FORCE
    """The forces (6,) [N] commanded at the last sample, with feedforward and injection, before the limits: the
    `controller.force` of a record. Zeros at the first sample."""
    excess: FloatArray = NO_FORCE
    """What the limits took off that command (6,) [N]: the force that force and rate limits left, minus the command."""
    feedforward: FloatArray = NO_FORCE
    """The forces (6,) [N] that the loop adds at this sample to those that the controller returns."""
    platform: Platform = cast("Platform", None)
    """The nominal model."""
    force_limit: float = np.inf
    """The largest force of an actuator [N]; infinite without a limit."""
    rate_limit: float = np.inf
    """The largest rate of an actuator's force [N/s]; infinite without a limit."""
    gains: Mapping[str, Any] = MappingProxyType({})
    """The `[controller.parameters]` of the experiment, by name."""


@dataclass(frozen=True)
class Design:
    """What a class or factory designs a controller from."""

    platform: Platform  # the nominal model
    sample_time: float  # [s]
    parameters: Mapping[str, Any] = field(default_factory=dict)  # from `[controller.parameters]`


@dataclass(eq=False)
class Maker:
    """Makes controllers of one design; a host asks it once for each real member, at that member's first sample.

    Copies that fill a vector of members and records never ask.
    """

    fresh: Callable[[], Any]
    """Makes a controller that shares no memory with those made before."""
    original: Any = None
    """What they are copies of, if they are."""
    _ahead: tuple[Any, ...] = field(default=(), init=False)

    def make(self) -> Any:
        """A controller that shares no memory with those made before; the user's code may fail."""
        controller, self._ahead = self.peek(), ()
        return controller

    def peek(self) -> Any:
        """The controller that `make` will give next, made by now and not called."""
        if not self._ahead:
            self._ahead = (self.fresh(),)
        return self._ahead[0]


def constructed(
    make: Callable[..., Any], design: Design, inside: Callable[[], AbstractContextManager[None]] = nullcontext
) -> Maker:
    """The maker of controllers by a class or a factory, which is called `inside` the folder of its file."""
    maker, (signature, named) = name_of(make), _parameters(make)
    if signature is not None and not _binds(signature, None, None, **design.parameters):
        accepted = [p.name for p in named]
        accepts = f"parameters: {maker} accepts {', '.join(accepted) or 'no parameters'}"
        takes_any = any(p.kind is p.VAR_KEYWORD for p in signature.parameters.values())
        for name in design.parameters:
            if name not in accepted and (not takes_any or name in signature.parameters):
                raise ControllerError(f"{accepts}; found '{name}'{nearest(name, accepted) if accepted else ''}")
        missing = [p.name for p in named if p.default is p.empty and p.name not in design.parameters]
        if missing and _binds(signature, None, None, **{**design.parameters, **dict.fromkeys(missing)}):
            raise ControllerError(f"{accepts}; missing {', '.join(missing)}, add it to [controller.parameters]")
        raise ControllerError(f"{maker} takes {signature}; expected to be called as {_MAKE}")

    def fresh() -> Any:
        with inside():
            try:
                return make(design.platform, design.sample_time, **design.parameters)
            except ControllerError:
                raise
            except (Exception, SystemExit) as error:  # user code may raise anything
                text = f"{maker} failed with {type(error).__name__}: {error}{place_in_code(error)}"
                raise ControllerError(text) from error

    return Maker(fresh)


def copied(original: Any) -> Maker:
    """The maker of deep copies of an object as it is now; what the caller does with it later does not matter."""

    def copy_of(controller: Any) -> Any:
        try:
            return copy.deepcopy(controller)
        except Exception as error:  # user code may raise anything
            raise ControllerError(
                f"the controller {name_of(controller)} cannot be copied for each run ({type(error).__name__}: "
                f"{error}); use a factory, a class or function called as {_MAKE} that makes a new one"
            ) from error

    snapshot = copy_of(original)
    return Maker(lambda: copy_of(snapshot), snapshot)


def is_maker(controller: Callable[..., Any]) -> bool:
    """Whether a callable makes controllers: a class, or a function with two required arguments."""
    if inspect.isclass(controller.func if isinstance(controller, partial) else controller):
        return True
    signature, named = _parameters(controller)
    if signature is None or _binds(signature, None):
        return False
    if _binds(signature, None, None, **{p.name: None for p in named if p.default is p.empty}):
        return True
    raise ControllerError(
        f"{name_of(controller)} takes {signature}; expected a function of one Sample, or a class or factory called as "
        f"{_MAKE}"
    )


def name_of(thing: Any) -> str:
    """A class, function or object in messages."""
    if inspect.isclass(thing):
        return f"class {thing.__qualname__}"
    name = getattr(thing, "__qualname__", None)
    return f"{name}()" if name else f"object of class {type(thing).__qualname__}"


def is_of_user(frame: FrameType) -> bool:
    """Whether code is neither of this package nor of a library that computes for the user's."""
    return str(frame.f_globals.get("__name__", "")).partition(".")[0] not in _LIBRARIES


def place_in_code(error: BaseException) -> str:
    """The last line of the user's that an error passed, for the end of a message; nothing if there is none."""
    places = [
        f" ({Path(frame.f_code.co_filename).name}, line {line})"
        for frame, line in traceback.walk_tb(error.__traceback__)
        if is_of_user(frame)
    ]
    return places[-1] if places else ""


def _parameters(function: Callable[..., Any]) -> tuple[inspect.Signature | None, list[inspect.Parameter]]:
    """The signature, None of built-in functions, and what may be given by name after platform and sample time."""
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return None, []
    parameters = list(signature.parameters.values())
    first = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)][:2]
    return signature, [p for p in parameters if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY) and p not in first]


def _binds(signature: inspect.Signature, *arguments: Any, **keywords: Any) -> bool:
    try:
        signature.bind(*arguments, **keywords)
    except TypeError:
        return False
    return True


@dataclass(eq=False)
class UserFolder:
    """The folder of a user's Python file: inside, imports find its modules first and relative file names resolve."""

    path: Path
    _modules: dict[str, ModuleType] = field(default_factory=dict, init=False)  # of the user, while others run

    def defined(self, file: Path, name: str) -> Any:
        """The object that a file of the folder defines under a name; the file is executed with the user's rights."""
        if not file.is_file():
            raise ControllerError(f"{file}: no such file; expected a Python file that defines '{name}'")
        if file.suffix != ".py":
            raise ControllerError(f"{file}: is not a Python file; expected a name that ends in .py")
        module_name = f"{_PACKAGE}_file_{file.stem}"
        loader = SourceFileLoader(module_name, str(self.path / file.name))
        spec = ModuleSpec(module_name, loader, origin=loader.path)
        spec.has_location = True  # so that it has a __file__
        module = module_from_spec(spec)
        self._modules[module_name] = module  # dataclasses look for it among the loaded ones
        try:
            with self.inside():
                loader.exec_module(module)
        except (Exception, SystemExit) as error:  # user code may raise anything
            text = f"{file}: fails with {type(error).__name__}: {error}{place_in_code(error)}"
            raise ControllerError(text) from error
        if not hasattr(module, name):
            raise ControllerError(f"{file}: defines no '{name}'; expected the controller under that name")
        return getattr(module, name)

    @contextmanager
    def inside(self) -> Iterator[None]:
        """Import paths, loaded modules and working folder belong to the process: others wait meanwhile."""
        with _LOCK, chdir(self.path):
            # the clock of folders and compiled modules is too coarse to see that a file was changed again
            invalidate_caches()
            writes_no_bytecode, sys.dont_write_bytecode = sys.dont_write_bytecode, True
            modules_of_others = self._taken()
            sys.modules.update(self._modules)
            sys.path.insert(0, str(self.path))
            try:
                yield
            finally:
                sys.path.remove(str(self.path))
                self._modules = self._taken()
                sys.modules.update(modules_of_others)
                sys.dont_write_bytecode = writes_no_bytecode

    def _taken(self) -> dict[str, ModuleType]:
        """Loaded modules of the names that the folder has, taken out: helpers of one name in two folders never meet."""
        listed = {entry.name.partition(".")[0] for entry in self.path.iterdir()}
        loaded = {module: module.partition(".")[0] for module in sys.modules}
        beside = {top for top in listed.intersection(loaded.values()) if self._has(top)}
        names = [module for module, top in loaded.items() if top in beside or module in self._modules]
        return {name: sys.modules.pop(name) for name in names}

    def _has(self, name: str) -> bool:
        if name == _PACKAGE or name in sys.builtin_module_names:
            return False
        spec = PathFinder.find_spec(name, [str(self.path)])
        if spec is None or spec.loader is not None:
            return spec is not None
        # a folder without __init__.py counts only if nothing else has this name
        return str(self.path / name) in getattr(sys.modules[name], "__path__", ())
