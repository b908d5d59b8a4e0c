"""A notch in the controller: less gain around one frequency, such as that of a resonance of the machine."""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from gough_stewart.harness.control.component import Link
from gough_stewart.harness.control.state_space import Solve, StateSpace, matrices_at
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.quantities import Frequency, PositiveNumber, Share


class Notch(Link):
    """N(s) = (s² + 2 d ζ ω s + ω²) / (s² + 2 ζ ω s + ω²) with ω = 2π `frequency`, `damping` ζ and `depth` d.

    |N| is d at the frequency and 1 far from it; between ω (√(1 + ζ²) ∓ ζ) it is less than √((1 + d²)/2). Discretised by
    Tustin's rule, prewarped at that frequency. It filters the force of each channel, or the wrench.

    Raises
    ------
    ControllerError
        Impossible values.

    Examples
    --------
    >>> controller = gs.PD(bandwidth=3, notch=gs.Notch(frequency=30, damping=0.5, depth=0.1))
    >>> gs.margins("heave_step", {"controller": controller}).disk.alpha
    """

    error: ClassVar[type[ControllerError]] = ControllerError
    name: ClassVar[str] = "notch"
    conditions: ClassVar[Mapping[str, str]] = {"frequency": "value * sample_time < 0.5", "depth": "value < 1"}

    frequency: Annotated[Frequency, Field(description="of the notch")]
    damping: Annotated[PositiveNumber, Field(description="damping ratio of the notch: half its relative width")] = 0.5
    depth: Annotated[Share, Field(description="gain at its frequency, from 0 to below 1")] = 0.0

    def check(self, sample_time: float) -> None:
        """Refuse a frequency that is not below the Nyquist frequency of a sample time [s]."""
        highest = 0.5 / sample_time
        if not self.frequency < highest:
            raise ControllerError(
                f"notch.frequency is {self.frequency:g} Hz; expected less than {highest:g} Hz, half the sampling "
                "frequency"
            )

    @staticmethod
    def linear(values: Mapping[str, Any], sample_time: Any, solve: Solve = np.linalg.solve) -> StateSpace:
        """ẋ₁ = ω x₂, ẋ₂ = ω (u − x₁ − 2 ζ x₂), y = u − 2 ζ (1 − d) x₂, by Tustin's rule with T' = 2/ω tan(ω T/2)."""
        omega, zeta, depth = 2 * np.pi * values["frequency"], values["damping"], values["depth"]
        zero = 0 * omega
        A = np.array([[zero, omega], [-omega, -2 * zeta * omega]])[..., 0]
        B = np.array([[zero], [omega]])[..., 0]
        C = np.array([[zero, -2 * zeta * (1 - depth)]])[..., 0]
        warped = 2 / omega * np.tan(omega * sample_time / 2)  # (1,): a bare symbol would treat an array as a matrix
        return matrices_at(StateSpace(A, B, C, np.array([[1.0]])), warped, "tustin", solve)
