"""Steps of a plant whose bristles forget fast: the exponential scheme ETDRK4, and steps under error control.

A sliding bristle obeys ż = v − d z with a rate d = α σ0 |v|/g of up to 10⁵/s, by which explicit steps of 1 ms diverge.
ETDRK4 takes the linear part −d z exactly, with d as it is at the begin of the step:

    S. M. Cox, P. C. Matthews, "Exponential Time Differencing for Stiff Systems", J. Comput. Phys. 176(2), 2002,
    eqs. (26)–(29).

For all other states, with d = 0, it is classical RK4. Order 4 where the friction is smooth; 2 over a step in which a
leg reverses or breaks away, since the law has a kink there.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gough_stewart.model.errors import StepError
from gough_stewart.model.integrator import MOST_INTERNAL_STEPS
from gough_stewart.model.vectors import FloatArray

Derivatives = Callable[[FloatArray], FloatArray]
# Below this |z| the functions φ are summed as series, above it taken from e^z, with at most two digits lost.
_SERIES_BELOW = 1.0
_TERMS = 18


class Coefficients(NamedTuple):
    """Of ETDRK4 for a step h and rates d of the bristles (6,)."""

    step: float  # h [s]
    whole: FloatArray  # e^(−h d)
    half: FloatArray  # e^(−h d/2)
    inner: FloatArray  # (h/2) φ1(−h d/2) [s]
    first: FloatArray  # h (φ1 − 3 φ2 + 4 φ3) [s]
    middle: FloatArray  # h (2 φ2 − 4 φ3) [s]
    last: FloatArray  # h (4 φ3 − φ2) [s]


def coefficients(decay: FloatArray, h: float) -> Coefficients:
    """The coefficients for rates [1/s] and a step [s]."""
    z = -h * decay
    one, two, three, _ = phi_functions(z)
    inner = phi_functions(z / 2)[0]
    return Coefficients(
        h,
        np.exp(z),
        np.exp(z / 2),
        h / 2 * inner,
        h * (one - 3 * two + 4 * three),
        h * (2 * two - 4 * three),
        h * (4 * three - two),
    )


def phi_functions(z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """φ1 to φ4 of z ≤ 0: φ0 = e^z, φ_(k+1) = (φ_k − 1/k!)/z; the series Σ z^j/(j + k)! near 0."""
    small = np.abs(z) < _SERIES_BELOW
    near, far = np.where(small, z, 0.0), np.where(small, -1.0, z)
    fourth = np.zeros_like(near)
    # Horner: φ4 = 1/4! (1 + z/5 (1 + z/6 (1 + …)))
    for j in range(_TERMS, 4, -1):
        fourth = near / j * (1 + fourth)
    fourth = (1 + fourth) / 24
    third = 1 / 6 + near * fourth
    second, e = 0.5 + near * third, np.exp(far)
    one = (e - 1) / far
    two = (one - 1) / far
    three = (two - 0.5) / far
    return (
        np.where(small, 1 + near * second, one),
        np.where(small, second, two),
        np.where(small, third, three),
        np.where(small, fourth, (three - 1 / 6) / far),
    )


def exponential_step(
    derivatives: Derivatives,
    x: FloatArray,
    decay: FloatArray,
    at: slice,
    c: Coefficients,
    rate: FloatArray | None = None,
) -> FloatArray:
    """The state after one step of ETDRK4.

    Parameters
    ----------
    derivatives
        ẋ for a state (n, ...); a new array in every call.
    decay
        Rates d of the bristles at x (6, ...) [1/s].
    at
        Where the bristles are in x.
    c
        The `coefficients` for these rates and a step.
    rate
        ẋ at x, if it is known.
    """
    z, h = x[at], c.step

    def stage(base: FloatArray, slope: FloatArray, bristle: FloatArray, weight: float) -> FloatArray:
        found = base + weight * slope
        found[at] = bristle
        return found

    k1 = derivatives(x) if rate is None else rate
    n1 = k1[at] + decay * z
    za = c.half * z + c.inner * n1
    a = stage(x, k1, za, h / 2)
    k2 = derivatives(a)
    n2 = k2[at] + decay * za
    zb = c.half * z + c.inner * n2
    k3 = derivatives(stage(x, k2, zb, h / 2))
    n3 = k3[at] + decay * zb
    zc = c.half * za + c.inner * (2 * n3 - n1)
    k4 = derivatives(stage(x, k3, zc, h))
    n4 = k4[at] + decay * zc
    end = c.whole * z + c.first * n1 + c.middle * (n2 + n3) + c.last * n4
    return stage(x, k1 + 2 * (k2 + k3) + k4, end, h / 6)


class Bristled(NamedTuple):
    """Equations with bristles, for `integrate_bristles`."""

    derivatives: Derivatives  # ẋ of x
    decays: Derivatives  # rates of the bristles at x (6,) [1/s]
    at: slice  # where the bristles are in x
    sizes: FloatArray  # by which absolute tolerances are scaled (n,): 1, less for bristles


def integrate_bristles(
    system: Bristled,
    x: FloatArray,
    span: tuple[float, float],
    tolerance: float,
    internal_step: float | None,
    check: Callable[[FloatArray, float], object],
) -> tuple[FloatArray, float]:
    """As `integrator.integrate`, with steps of ETDRK4: the distance of two halves from the whole is the error.

    It is relative to |x|, and absolute in SI units times the `sizes` of the system.
    """
    (time, end), (derivatives, decays, at, sizes) = span, system
    h = end - time if internal_step is None else internal_step
    steps, known = 0, _Coefficients()
    with np.errstate(all="ignore"):
        rate, decay = derivatives(x), decays(x)
        while time < end:
            steps += 1
            if steps > MOST_INTERNAL_STEPS:
                raise StepError(
                    "internal steps",
                    steps,
                    time,
                    f"too many for one step to time {end:g} s at tolerance {tolerance:g}; forces too large, bristles "
                    "too stiff, or step too long",
                )
            size = min(h, end - time)
            whole, half = known(decay, size), known(decay, size / 2)
            coarse = exponential_step(derivatives, x, decay, at, whole, rate)
            middle = exponential_step(derivatives, x, decay, at, half, rate)
            # the same rate in both halves: any is right, the nearest is the most exact
            fine = exponential_step(derivatives, middle, decay, at, half)
            scale = tolerance * (sizes + np.maximum(np.abs(x), np.abs(fine)))
            error = float((np.abs(fine - coarse) / scale).max()) / (2**4 - 1)
            factor = _factor(error)
            if error <= 1:
                is_last = size == end - time
                x, time = fine, end if is_last else time + size
                rate, decay = derivatives(x), decays(x)
                check(x, time)
                h = max(h, size * factor) if size < h else size * factor
            else:
                h = size * factor
                if not h > 16 * np.spacing(end):
                    raise StepError(
                        "internal step size",
                        h,
                        time,
                        f"the tolerance {tolerance:g} cannot be met; forces too large, or pose nearly singular",
                    )
    return x, h


def _factor(error: float) -> float:
    """By which the next step is longer: 0.9 r^(−1/5), from 0.2 to 4; 0.1 if the error r is not finite."""
    if not np.isfinite(error):
        return 0.1
    return min(4.0, max(0.2, 0.9 * error**-0.2)) if error > 0 else 4.0


class _Coefficients:
    """The latest coefficients of two sizes: of legs that stand they stay the same."""

    def __init__(self) -> None:
        self._known: list[tuple[bytes, Coefficients]] = []

    def __call__(self, decay: FloatArray, h: float) -> Coefficients:
        key = (h * decay).tobytes() + np.float64(h).tobytes()
        for have, found in self._known:
            if have == key:
                return found
        found = coefficients(decay, h)
        self._known = [*self._known[-1:], (key, found)]
        return found
