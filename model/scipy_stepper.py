"""The judge of compiled integration: the kernel's derivatives, integrated by SciPy under error control."""

from typing import Any

import numpy as np

from gough_stewart.model import interface
from gough_stewart.model.errors import StepError
from gough_stewart.model.interface import MOST_INTERNAL_STEPS, N_INPUTS, Variant
from gough_stewart.model.kernel import Kernel
from gough_stewart.model.parameters import PlatformFields
from gough_stewart.model.pose_limits import check_pose
from gough_stewart.model.vectors import FloatArray

# Below this tolerance, LSODA's multistep formulas do not reach it where bristles are stiff; Radau's do.
_TIGHT = 1e-12


class ScipyStepper:
    """A plant's state and its steps: DOP853, or LSODA for bristles, which are stiff, and Radau if it is tight.

    The vectors x, u, p are read and written in place; after x, p or the time have been written, `begin` is called.
    Inputs are u at the begin of a step and change at `input_rates` within it, 0 unless they are written. It takes no
    fixed steps, so `largest_step` stays 0.
    """

    largest_step = 0.0

    def __init__(self, variant: Variant, tolerance: float) -> None:
        n, q = interface.size_of(variant.states), interface.size_of(variant.parameters)
        self.x, self.u, self.p = np.zeros(n), np.zeros(N_INPUTS), np.zeros(q)
        self.input_rates = np.zeros(N_INPUTS)
        self.internal_step: float | None = None
        self._variant, self._tolerance, self._kernel = variant, tolerance, Kernel(variant)
        self._y = self._kernel.outputs(self.x, self.u, self.p)
        self.results = interface.unpack(variant.results, self._y)

    def begin(
        self, platform: PlatformFields, time: float, internal_step: float | None, _largest_step: float = 0.0
    ) -> None:
        """Go on from the state and the parameters in x and p."""
        self._platform, self._time, self.internal_step = platform, time, internal_step
        self._handedness: float | None = None

    def step(self, time: float, step: float) -> None:
        """Integrate from the present time to `time + step`.

        Raises
        ------
        StepError
            The pose is beyond a limit at the end of an internal step, or the tolerance cannot be met.
        """
        end, tolerance, steps = time + step, self._tolerance, 0
        side = self._handedness or check_pose(self._platform, self.x, self._time)
        # a trial step can reach a pole: infinities there mean a rejected step and need no warning
        with np.errstate(all="ignore"):
            solver = self._solver(end)
            while solver.t < end:
                steps += 1
                if steps > MOST_INTERNAL_STEPS:
                    raise StepError(
                        "internal steps",
                        steps,
                        float(solver.t),
                        f"too many internal steps for one step to time {end:g} s at tolerance {tolerance:g}; forces "
                        "too large, leg_friction_velocity too small, or step too long",
                    )
                # LSODA only tells the last one
                proposed = float(getattr(solver, "h_abs", solver.step_size or end - solver.t))
                # if ẋ overflows, SciPy finds no first step size and would reduce it for ever
                if not proposed > 0 or solver.step() is not None or not np.isfinite(solver.y).all():
                    raise StepError(
                        "internal step size",
                        proposed,
                        float(solver.t),
                        f"the tolerance {tolerance:g} cannot be met; forces too large, or pose nearly singular",
                    )
                check_pose(self._platform, solver.y, float(solver.t), side)
        self.x[:], self._time, self._handedness = solver.y, end, side
        if not self._variant.bristles:
            # the last step was shortened to end on time; its original size carries over
            self.internal_step = max(proposed, float(solver.h_abs))

    def find_results(self) -> None:
        """Write the `results` of the present state and inputs."""
        self._kernel.outputs(self.x, self.u, self.p)

    def result_vector(self) -> FloatArray:
        """The results in the order of `Variant.columns`, a copy."""
        return self._kernel.outputs(self.x, self.u, self.p).copy()

    def _solver(self, end: float) -> Any:
        from scipy.integrate import DOP853, LSODA, Radau  # a third of a second of imports

        start, kernel, p = self._time, self._kernel, self.p

        def derivatives(time: float, x: FloatArray) -> FloatArray:
            return kernel.derivatives(x, self.u + self.input_rates * (time - start), p).copy()

        problem = derivatives, start, self.x.copy(), end
        tolerances: dict[str, Any] = {"rtol": self._tolerance, "atol": self._tolerance * np.array(self._variant.scales)}
        if not self._variant.bristles:
            first = None if self.internal_step is None else min(self.internal_step, end - start)
            return DOP853(*problem, first_step=first, **tolerances)
        return (LSODA if self._tolerance >= _TIGHT else Radau)(*problem, **tolerances)
