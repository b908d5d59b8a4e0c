"""A controller from a Python file of the user."""

import inspect
import sys
import threading
from collections.abc import Iterator
from contextlib import chdir, contextmanager
from importlib import invalidate_caches
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from importlib.util import module_from_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from gough_stewart.harness.control.laws import Controller, controller_of
from gough_stewart.harness.control.python.makers import Constructed, Design, is_maker, name_of
from gough_stewart.harness.control.state_space import is_control_system
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError

NAME = "controller"
_PACKAGE = __name__.partition(".")[0]
_LOCK = threading.RLock()


def controller_of_file(file: Path, name: str | None, factory: str | None, design: Design) -> Controller:
    """The controller that a Python file defines; the file is executed with the user's rights.

    Of a class or factory the maker of fresh ones, others as `controller_of`.

    Parameters
    ----------
    name
        Of a controller: a class, a discrete python-control system, a `LinearController`, or an object or function that
        is called with a `Sample`; by default "controller".
    factory
        Of a function that makes one, `make(platform, sample_time, **parameters)`, instead of a name.

    Raises
    ------
    ControllerError
        No such file or name, the file fails, the object is not a controller, or it does not accept the parameters.
    """
    wanted, folder = factory or name or NAME, UserFolder(file.absolute().parent)
    thing = _defined(file, wanted, folder)
    try:
        if factory is not None or inspect.isclass(thing):
            return FromFile(thing, wanted, design, folder)
        return _controller(thing, wanted, design, folder)
    except ControllerError as error:
        raise ControllerError(f"{file}: {error}") from error


class UserFolder:
    """The folder of a user's Python file: inside, imports find its modules first and relative file names resolve."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._modules = dict[str, ModuleType]()  # of the user, while others run

    def executed(self, file: Path) -> ModuleType:
        """A file of the folder as a module.

        Raises
        ------
        Exception
            Anything that the file raises.
        """
        name = f"{_PACKAGE}_file_{file.stem}"
        loader = SourceFileLoader(name, str(self.path / file.name))
        spec = ModuleSpec(name, loader, origin=loader.path)
        spec.has_location = True  # so that it has a __file__
        module = module_from_spec(spec)
        self._modules[name] = module  # dataclasses look for it among the loaded ones
        with self.inside():
            loader.exec_module(module)
        return module

    @contextmanager
    def inside(self) -> Iterator[None]:
        """Import paths, loaded modules and working folder belong to the process: others wait meanwhile."""
        with _LOCK, chdir(self.path):
            # the clock of folders and compiled modules is too coarse to see that a file was changed again
            invalidate_caches()
            writes_no_bytecode, sys.dont_write_bytecode = sys.dont_write_bytecode, True
            others = self._taken()
            sys.modules.update(self._modules)
            sys.path.insert(0, str(self.path))
            try:
                yield
            finally:
                sys.path.remove(str(self.path))
                self._modules = self._taken()
                sys.modules.update(others)
                sys.dont_write_bytecode = writes_no_bytecode

    def _taken(self) -> dict[str, ModuleType]:
        """Loaded modules of the names that the folder has, taken out: helpers of one name in two folders never meet."""
        listed = {entry.name.partition(".")[0] for entry in self.path.iterdir()}
        beside = {top for top in listed.intersection(map(_top, sys.modules)) if self._has(top)}
        names = [name for name in sys.modules if _top(name) in beside or name in self._modules]
        return {name: sys.modules.pop(name) for name in names}

    def _has(self, name: str) -> bool:
        if name == _PACKAGE or name in sys.builtin_module_names:
            return False
        spec = PathFinder.find_spec(name, [str(self.path)])
        if spec is None or spec.loader is not None:
            return spec is not None
        # a folder without __init__.py counts only if nothing else has this name
        return str(self.path / name) in getattr(sys.modules[name], "__path__", ())


def _top(module: str) -> str:
    return module.partition(".")[0]


class FromFile(Constructed):
    """Controllers made by a class or factory of a file, in its folder.

    Raises
    ------
    ControllerError
        Not a class or function, or as `Constructed`.
    """

    def __init__(self, make: Any, name: str, design: Design, folder: UserFolder) -> None:
        if not callable(make):
            raise ControllerError(f"factory = '{name}' is {make!r}; expected a function or class")
        super().__init__(make, design)
        self._folder = folder

    def _make(self) -> Any:
        with self._folder.inside():
            return super()._make()


def _defined(file: Path, name: str, folder: UserFolder) -> Any:
    """The object that a file defines under a name; the file is executed."""
    if not file.is_file():
        raise ControllerError(f"{file}: no such file; expected a Python file that defines '{name}'")
    if file.suffix != ".py":
        raise ControllerError(f"{file}: is not a Python file; expected a name that ends in .py")
    try:
        module = folder.executed(file)
    except (Exception, SystemExit) as error:  # user code may raise anything
        raise ControllerError(f"{file}: fails with {type(error).__name__}: {error}") from error
    if not hasattr(module, name):
        raise ControllerError(f"{file}: defines no '{name}'; expected the controller under that name")
    return getattr(module, name)


def _controller(thing: Any, name: str, design: Design, folder: UserFolder) -> Controller:
    """A controller that a file defines itself."""
    if design.parameters:
        parameters = ", ".join(design.parameters)
        raise ControllerError(f"parameters: {parameters} are for a class or factory; '{name}' is neither")
    if isinstance(thing, str | Path):
        return UnitController(folder.path / thing)
    if callable(thing) and not is_control_system(thing) and is_maker(thing):
        raise ControllerError(
            f"{name_of(thing)} has to be called with platform and sample time; expected factory = '{name}' instead of "
            "name"
        )
    return controller_of(thing)
