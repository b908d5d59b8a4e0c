"""A CasADi function from named signals to forces as a controller in a run, as it is exported."""

import sys
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from gough_stewart.model.vectors import FloatArray

if TYPE_CHECKING:
    import casadi

    from gough_stewart.harness.control.python.sample import Sample

# Names of its inputs and outputs, besides signals and `time`.
MEMORY, MEMORY_NEXT, FORCE, OF_REFERENCE = "memory", "memory_next", "actuator_force", "reference_"


def is_casadi_function(controller: Any) -> "TypeGuard[casadi.Function]":
    """Whether an object is one; without an import, since who has one has imported CasADi."""
    loaded = sys.modules.get("casadi")
    return loaded is not None and isinstance(controller, loaded.Function)


class CasadiFunction:
    """A control function that calls a CasADi function; its memory begins at zero."""

    def __init__(self, function: "casadi.Function") -> None:
        self.function, names = function, function.name_in()
        self._memory = np.zeros(function.numel_in(names.index(MEMORY)) if MEMORY in names else 0)

    def __call__(self, sample: "Sample") -> FloatArray:
        """Forces (6,) at a sample."""
        wanted = {OF_REFERENCE + name: value for name, value in sample.reference.items()}
        known = {"time": sample.time, MEMORY: self._memory, **sample.measured, **wanted}
        given = {
            name: np.reshape(np.asarray(known[name], dtype=float), self.function.size_in(k), order="F")
            for k, name in enumerate(self.function.name_in())
        }
        found = {name: np.asarray(value).ravel(order="F") for name, value in self.function.call(given).items()}
        self._memory = found.get(MEMORY_NEXT, self._memory)
        return np.asarray(found[FORCE], dtype=float)
