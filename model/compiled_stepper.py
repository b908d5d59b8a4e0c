"""The unit's own stepper in this process: c/stepper on memory that NumPy owns."""

import subprocess
import sys
from ctypes import PyDLL, c_double, c_size_t
from functools import cache, partial

import numpy as np

from gough_stewart.model import interface
from gough_stewart.model.errors import NotInstalledError, StepError
from gough_stewart.model.interface import IDEAL, N_INPUTS, Variant
from gough_stewart.model.kernel import address_of, kernel_library
from gough_stewart.model.parameters import PlatformFields
from gough_stewart.model.vectors import FloatArray

_COMPILER = "gough_stewart.fmu_build.kernel_library"


class CompiledStepper:
    """A plant's state in the memory of a unit's component, and its steps.

    The vectors are views of that memory, to be read and written in place; after x, p or the time have been written,
    `begin` is called.
    """

    def __init__(self, variant: Variant, tolerance: float, fixed_step_size: float) -> None:
        library = stepper_library(variant)
        layout = (c_size_t * 13)()
        library.stepper_layout(layout)
        memory = np.zeros(-(-layout[0] // 8))
        n, q, m = (interface.size_of(variables) for variables in (variant.states, variant.parameters, variant.results))
        # in the order of c/stepper/stepper.c
        sizes = (1, 1, 1, 1, N_INPUTS, n, q, m, 1, 1)
        views = [memory[place // 8 : place // 8 + size] for place, size in zip(layout[1:11], sizes, strict=True)]
        (
            self._time,
            self._internal_step,
            self._handedness,
            self._largest_step,
            self.u,
            self.x,
            self.p,
            self._y,
            *failure,
        ) = views
        self._failed_at, self._failed_value = failure
        self._memory, self._texts = memory, (layout[11], layout[12])
        address, self._times = address_of(memory), (c_double(), c_double())
        library.stepper_reset(address, c_double(tolerance), c_double(fixed_step_size))
        self._step = partial(library.stepper_step, address, *self._times)
        # writes the `results` of the present state and inputs
        self.find_results = partial(library.stepper_results, address)
        self._forget = partial(library.stepper_forget, address)
        # a unit has its states first, then other outputs, then locals
        outputs = [v for v in variant.results if v.causality == "output" and not v.is_state]
        of_unit = (*variant.states, *outputs, *interface.LOCALS)
        self.results = interface.unpack(of_unit, self._y)
        order = interface.unpack(of_unit, np.arange(m))
        self._order = np.concatenate([order[v.name].ravel() for v in variant.results])

    @property
    def internal_step(self) -> float | None:
        """Size of the next internal step [s]; None before the first."""
        return float(self._internal_step[0]) or None

    @property
    def largest_step(self) -> float:
        """The largest fixed step that is stable, found in the first one under the present parameters [s]; 0 before."""
        return float(self._largest_step[0])

    def begin(
        self, _platform: PlatformFields, time: float, internal_step: float | None, largest_step: float = 0.0
    ) -> None:
        """Go on from the state and the parameters in x and p."""
        self._time[0], self._internal_step[0], self._largest_step[0] = time, internal_step or 0.0, largest_step
        self._forget()

    def step(self, time: float, step: float) -> None:
        """Integrate from the component's time to `time + step`.

        Raises
        ------
        StepError
            The plant cannot; it is as it was.
        """
        times = self._times
        times[0].value, times[1].value = time, step
        if not self._step():
            quantity, reason = (
                self._memory.view(np.uint8)[at:].tobytes().partition(b"\0")[0].decode() for at in self._texts
            )
            raise StepError(quantity, float(self._failed_value[0]), float(self._failed_at[0]), reason)

    def result_vector(self) -> FloatArray:
        """The results in the order of `Variant.columns`, a copy."""
        self.find_results()
        return np.asarray(self._y[self._order])


@cache
def stepper_library(variant: Variant) -> PyDLL:
    """The library of a variant: what came with the package, else what was compiled here.

    Raises
    ------
    NotInstalledError
        It did not come with the package, and cannot be compiled.
    """
    library = kernel_library() if variant == IDEAL else None
    if library is not None:
        return library
    # in a process of its own: the model does not know what builds it
    command = [sys.executable, "-m", _COMPILER, *variant.parts]
    compilation = subprocess.run(command, capture_output=True, text=True, check=False)
    if compilation.returncode != 0:
        reason = compilation.stderr.strip().rpartition("\n")[2]
        raise NotInstalledError(
            f"no machine code steps a platform {variant.words} on this machine, and it cannot be compiled ({reason}); "
            "pip install 'gough-stewart[compile]', or choose integrator=\"scipy\""
        )
    return PyDLL(compilation.stdout.strip())
