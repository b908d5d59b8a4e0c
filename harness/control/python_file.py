"""A controller from a Python file of the user."""

import importlib.util
import sys
from hashlib import sha256
from pathlib import Path
from typing import Any

from gough_stewart.harness.control.laws import ControlFunction, Controller, LinearController, Sample, controller_of
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError


def controller_from_file(file: Path, name: str) -> Controller:
    """An object of a Python file. The file is executed with the user's rights.

    Raises
    ------
    ControllerError
        No such file or name, the file fails, or the object is not a controller.
    """
    if not file.is_file():
        raise ControllerError(f"{file}: no such file; expected a Python file that defines '{name}'")
    # a unique module name; pickles and dataclasses look up the module by it
    module_name = f"_gough_stewart_controller_{sha256(str(file.absolute()).encode()).hexdigest()[:16]}"
    spec = importlib.util.spec_from_file_location(module_name, file)
    if spec is None or spec.loader is None:
        raise ControllerError(f"{file}: is not a Python file; expected a name that ends in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:  # user code may raise anything
        del sys.modules[module_name]
        raise ControllerError(f"{file}: fails with {type(error).__name__}: {error}") from error
    if not hasattr(module, name):
        raise ControllerError(f"{file}: defines no '{name}'; expected the controller under that name")
    found = controller_of(getattr(module, name))
    return found if isinstance(found, LinearController | UnitController) else _FromFile(found, file.absolute(), name)


class _FromFile:
    """A control function of a file; it pickles as its location, so that another process can load it."""

    def __init__(self, function: ControlFunction, file: Path, name: str) -> None:
        self._function, self._file, self._name = function, file, name

    def __call__(self, sample: Sample) -> Any:
        return self._function(sample)

    def __reduce__(self) -> tuple[Any, ...]:
        return controller_from_file, (self._file, self._name)
