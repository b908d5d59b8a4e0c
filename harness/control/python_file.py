"""A controller from a Python file of the user's."""

import importlib.util
import sys
from hashlib import sha256
from pathlib import Path
from typing import Any

from gough_stewart.harness.control.laws import ControlFunction, Controller, LinearController, Sample, controller_of
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError


def controller_from_file(file: Path, name: str) -> Controller:
    """The object of a name in a Python file, which is executed: code of whoever wrote it, with the user's rights.

    Raises
    ------
    ControllerError
        No such file or name, the file fails, or the object is no controller.
    """
    if not file.is_file():
        raise ControllerError(f"{file}: no such file; expected a Python file that defines '{name}'")
    # a name that no other module has; pickles and dataclasses look for the module under it
    module_name = f"_gough_stewart_controller_{sha256(str(file.absolute()).encode()).hexdigest()[:16]}"
    spec = importlib.util.spec_from_file_location(module_name, file)
    if spec is None or spec.loader is None:
        raise ControllerError(f"{file}: is no Python file; expected a name that ends in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:  # the user's code may fail in any way
        del sys.modules[module_name]
        raise ControllerError(f"{file}: fails with {type(error).__name__}: {error}") from error
    if not hasattr(module, name):
        raise ControllerError(f"{file}: defines no '{name}'; expected the controller under that name")
    found = controller_of(getattr(module, name))
    return found if isinstance(found, LinearController | UnitController) else _FromFile(found, file.absolute(), name)


class _FromFile:
    """A control function of a file; its pickle is the place, so that another process finds it again."""

    def __init__(self, function: ControlFunction, file: Path, name: str) -> None:
        self._function, self._file, self._name = function, file, name

    def __call__(self, sample: Sample) -> Any:
        return self._function(sample)

    def __reduce__(self) -> tuple[Any, ...]:
        return controller_from_file, (self._file, self._name)
