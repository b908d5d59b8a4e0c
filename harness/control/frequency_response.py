"""S, T and L of a loop from a periodic injection: averages over periods, coherence, and confidence."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtri

from gough_stewart.harness.control.structured import ComplexArray
from gough_stewart.harness.errors import ControllerError
from gough_stewart.model.vectors import FloatArray

CONFIDENCE = 0.95


class Response(NamedTuple):
    """The response of one channel at the lines of the injection, the other channels closed."""

    S: ComplexArray  # u/d, from the injected to the total force
    radius: FloatArray  # of the 95 % confidence circle about S, or about T
    coherence: FloatArray  # share of the power of u that the injection explains, 0 to 1
    periods: int

    @property
    def T(self) -> ComplexArray:
        """1 − S: the share of the injected force that the controller cancels."""
        return np.asarray(1 - self.S)

    @property
    def L(self) -> ComplexArray:
        """1/S − 1, the loop transfer with this channel cut and the others closed."""
        return np.asarray(1 / self.S - 1)

    @property
    def loop_radius(self) -> FloatArray:
        """Radius of the circle about L: radius/|S|², valid while it is small."""
        return np.asarray(self.radius / np.abs(self.S) ** 2)


def response_of_periods(
    injected: FloatArray, force: FloatArray, samples: int, lines: NDArray[np.intp], settle: int
) -> Response:
    """S at the harmonics of a period, from forces (n,) [N] at the samples of a loop.

    With D_p, U_p the transforms of period p: S = ∑ U_p D_p* / ∑ |D_p|², coherence |∑ U_p D_p*|² / (∑ |U_p|² ∑ |D_p|²).
    If the deviations between P periods are circular complex normal with variance s², |S − S_true|² P |D|²/s² has
    Fisher's distribution with 2 and 2 (P − 1) degrees of freedom [Pintelon & Schoukens, System Identification, 2012,
    ch. 2].

    Parameters
    ----------
    injected, force
        The injected force, and the total force with the feedback's reaction; whole periods from the beginning.
    samples
        Samples per period.
    settle
        Number of periods that are dropped.

    Raises
    ------
    ControllerError
        Fewer than two periods are left.
    """
    periods = len(force) // samples - settle
    if periods < 2:
        raise ControllerError(
            f"{len(force) / samples:.3g} periods, of which {settle} settle; expected at least two more: a longer run"
        )
    used = slice(settle * samples, (settle + periods) * samples)
    D, U = (np.fft.rfft(values[used].reshape(periods, samples), axis=1)[:, lines] for values in (injected, force))
    power_of_d, power_of_u = (np.abs(D) ** 2).sum(axis=0), (np.abs(U) ** 2).sum(axis=0)
    if not (power_of_d > 0).all():
        raise ControllerError("the injection has no power at some of its lines; expected the injection of this run")
    cross = (U * D.conj()).sum(axis=0)
    S = cross / power_of_d
    variance = (np.abs(U - S * D) ** 2).sum(axis=0) / (periods - 1)
    quantile = fdtri(2, 2 * (periods - 1), CONFIDENCE)
    return Response(
        S, np.sqrt(quantile * variance / power_of_d), np.abs(cross) ** 2 / (power_of_u * power_of_d), periods
    )
