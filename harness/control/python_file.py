"""A controller from a Python file of the user."""

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gough_stewart.harness.control.laws import Controller, LinearController, controller_of
from gough_stewart.harness.control.python.casadi_function import is_casadi_function
from gough_stewart.harness.control.python.makers import Design, Maker, called, check_call, is_maker, name_of
from gough_stewart.harness.control.python.private_modules import PrivateModules, inside
from gough_stewart.harness.control.python.sample import Sample
from gough_stewart.harness.control.state_space import is_control_system
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError

NAME = "controller"


def controller_of_file(file: Path, name: str | None, factory: str | None, design: Design) -> Controller:
    """The controller that a Python file defines; the file is executed with the user's rights.

    A linear controller as it is; for a class, a factory, an object or a function the maker of fresh ones.

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
    maker = FromFile(file, name or NAME, factory, design)
    found = maker.first
    return found if isinstance(found, LinearController | UnitController) else maker


class FromFile(Maker):
    """Makes controllers from a Python file, which is executed anew for each."""

    def __init__(self, file: Path, name: str, factory: str | None, design: Design) -> None:
        self._file, self._name, self._is_factory = file.absolute(), factory or name, factory is not None
        self._design = design
        opened = _Opened(file, self._name)
        try:
            self.first = self._checked(opened.found)
        except ControllerError as error:
            raise ControllerError(f"{file}: {error}") from error
        # executed, but not called yet: the first controller may have it
        self._opened = [opened]

    def _make(self) -> Any:
        try:
            opened = self._opened.pop()
        except IndexError:
            opened = _Opened(self._file, self._name)
        found = opened.found
        if self._makes(found):
            with inside(opened.modules.folder):
                found = called(found, self._design)
        if not callable(found) or is_control_system(found) or is_casadi_function(found) or inspect.isclass(found):
            return found  # a linear one, plain operations, or refused where it is used
        return _FileFunction(found, opened.modules, (FromFile.make, (self,)))

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "_opened": []}

    def _makes(self, found: Any) -> bool:
        return self._is_factory or inspect.isclass(found)

    def _checked(self, found: Any) -> Any:
        """What the file names, if it can be a controller or make one."""
        parameters = ", ".join(self._design.parameters)
        if self._makes(found):
            if not callable(found):
                raise ControllerError(f"factory = '{self._name}' is {found!r}; expected a function or class")
            check_call(found, self._design)
            return None
        if parameters:
            raise ControllerError(f"parameters: {parameters} are for a class or factory; '{self._name}' is neither")
        if isinstance(found, str | Path):
            return UnitController(self._file.parent / found)
        if is_control_system(found) or not callable(found):
            return controller_of(found)
        if isinstance(found, LinearController | UnitController):
            return found
        if is_maker(found):
            raise ControllerError(
                f"{name_of(found)} has to be called with platform and sample time; expected factory = '{self._name}' "
                "instead of name"
            )
        return None


class _Opened:
    """A file, executed, and the object that it defines under a name."""

    def __init__(self, file: Path, name: str) -> None:
        if not file.is_file():
            raise ControllerError(f"{file}: no such file; expected a Python file that defines '{name}'")
        if file.suffix != ".py":
            raise ControllerError(f"{file}: is not a Python file; expected a name that ends in .py")
        try:
            self.modules = PrivateModules(file)
        except (Exception, SystemExit) as error:  # user code may raise anything
            raise ControllerError(f"{file}: fails with {type(error).__name__}: {error}") from error
        if not hasattr(self.modules.module, name):
            raise ControllerError(f"{file}: defines no '{name}'; expected the controller under that name")
        self.found = getattr(self.modules.module, name)


class _FileFunction:
    """A control function of a file, called in its folder; it keeps its modules, and pickles as its origin."""

    def __init__(self, function: Callable[..., Any], modules: PrivateModules, origin: tuple[Any, ...]) -> None:
        self._function, self._modules, self._origin = function, modules, origin
        self._folder = modules.folder

    def __call__(self, sample: Sample) -> Any:
        with inside(self._folder):
            return self._function(sample)

    def __reduce__(self) -> tuple[Any, ...]:
        return self._origin
