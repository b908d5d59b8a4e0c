"""A controller from Python on its way to worker processes: as a pickle."""

import pickle
from functools import lru_cache
from types import ModuleType
from typing import Any

from gough_stewart.harness.control.makers import name_of
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.experiment.plan import EnsemblePlan, GivenController, plan_from


def packed(plan: EnsemblePlan) -> bytes | None:
    """The plan's controller from Python, if there is one, for a worker.

    cloudpickle, which comes with dask.distributed, is used if it is installed: it also packs what is defined in a
    notebook, in a script or inside a function.

    Raises
    ------
    ControllerError
        It cannot be pickled.
    """
    if plan.given is None:
        return None
    controller, pickler = plan.given.controller, _pickler()
    try:
        if pickler is pickle and "__main__" in (type(controller).__module__, getattr(controller, "__module__", "")):
            raise pickle.PicklingError("it is defined in the program itself, which workers do not run")  # noqa: TRY301
        content: bytes = pickler.dumps(controller)
    except Exception as error:  # user code may raise anything
        remedy = "" if pickler is not pickle else "install cloudpickle, "
        raise ControllerError(
            f"the controller {name_of(controller)} cannot be passed to other processes "
            f"({type(error).__name__}: {error}); {remedy}define it in a module, name it in the experiment file "
            "(type = 'python'), or use workers=1"
        ) from error
    return content


def unpacked(text: str, content: bytes | None) -> EnsemblePlan:
    """The plan of a text, with its controller, on a worker.

    Raises
    ------
    ControllerError
        The controller's modules are not there.
    """
    return plan_from(text) if content is None else _with_controller(text, content)


@lru_cache(2)
def _with_controller(text: str, content: bytes) -> EnsemblePlan:
    try:
        controller: Any = pickle.loads(content)
    except Exception as error:  # user code may raise anything
        raise ControllerError(
            f"a worker cannot load the controller ({type(error).__name__}: {error}); its modules have to be on the "
            "workers' path"
        ) from error
    return plan_from(text, GivenController(controller))


def _pickler() -> ModuleType:
    try:
        import cloudpickle
    except ImportError:
        return pickle
    found: ModuleType = cloudpickle
    return found
