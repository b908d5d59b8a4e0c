"""Fixed steps of a plant with bristles: ETDRK4 in the momentum of legs, divided where it does not resolve a bristle.

Friction has the part σ1 ż, and ż = v − d z falls within 1/d, a hundredth of a step of 1 ms at speed. Its sum over the
stages of a step would be wrong by a factor of up to h d; its integral is σ1 times a difference of z. So in place of the
velocities ν a step has

    w = ν + Γ (z − z0),    ẇ = ν̇ + Γ ż

with the gain Γ of `friction.Grip` at its begin: ẇ has nothing of σ1 ż but what Γ changes within the step. Likewise the
weights of RK4 give a wrong ∫ z dt where z falls within a step. ETDRK4 has it exactly, as of a state that −z drives, and
its difference from the sum of RK4 is taken from the velocities at the end. Without decay that is 0, and all is RK4.

The error of the bristles costs next to nothing. With the rate at the end instead of that of the fourth stage the scheme
has order 3; their distance is that of these rates times the stage's coefficient. That is blind to a kink between the
stages: where a leg reverses, the error of Simpson's rule over the kink is added. A step that is off by more than
`RESOLUTION` of a bristle's reach is divided: where a leg breaks away or reverses, or slides with a bristle that is not
bent yet. Of the accelerations ẇ there is the same distance, a tenth of the difference of both rates, in units of what
Coulomb friction would give: modes of legs that give, which RK4 damps, are resolved while a jump of the force lets them
ring. The order is 4 where friction is smooth, 2 over a reversal.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gough_stewart.model.errors import StepError
from gough_stewart.model.exponential import Derivatives, coefficients, exponential_step, phi_functions
from gough_stewart.model.friction import Grip
from gough_stewart.model.integrator import rk4_step
from gough_stewart.model.interface import N_INPUTS
from gough_stewart.model.kernel import Kernel
from gough_stewart.model.variant import Variant
from gough_stewart.model.vectors import FloatArray

# Error of a bristle in one substep, in units of its reach: 1 nm of 10 µm.
RESOLUTION = 1e-4
# Error of the accelerations in one substep, in units of what Coulomb friction of all legs gives.
FORCE_RESOLUTION = 1e-2
# In one step, those that are too long included.
MOST_SUBSTEPS = 200
# The largest h |λ| of the modes of legs that stick or give, within the half disc in which RK4 is stable; and the
# largest step [s] where legs stick.
LARGEST_PRODUCT = 2.6
LARGEST_FIXED_STEP = 1e-3
# Where states are: of the platform, the bristles, and of motors with springs.
_TWIST, _BRISTLES, _MOTORS = slice(6, 12), slice(12, 18), slice(24, 30)
# The next substep over this one: at most, at least, and with what reserve.
LARGEST_FACTOR, SMALLEST_FACTOR, SAFETY = 4.0, 0.1, 0.8


class Gripped(NamedTuple):
    """Equations with bristles, for `fixed_step`."""

    derivatives: Derivatives  # ẋ of x; a new array in every call
    grip: Callable[[FloatArray], Grip]  # of x
    sliding: Callable[[FloatArray], FloatArray]  # of x: the velocity v of each bristle [m/s]
    bristles: slice  # where they are in x
    velocities: slice  # of what friction brakes: the platform, or motors with springs


def gripped(kernel: Kernel, variant: Variant, u: FloatArray, p: FloatArray) -> Gripped:
    """The equations of a variant under constant inputs."""
    return Gripped(
        lambda x: kernel.derivatives(x, u, p).copy(),
        lambda x: Grip(*(part.copy() for part in kernel.grip(x, p))),
        lambda x: kernel.sliding(x, p).copy(),
        _BRISTLES,
        _MOTORS if variant.springs else _TWIST,
    )


def largest_step(kernel: Kernel, variant: Variant, x: FloatArray, p: FloatArray) -> float:
    """The largest fixed step [s] that resolves the modes of legs that stick or give at the pose of x; ∞ without any.

    h |λ| is at most `LARGEST_PRODUCT` for the poles λ at rest, where all legs stick.
    """
    if not variant.parts:
        return np.inf
    rest = x.copy()
    rest[_TWIST] = 0.0
    if variant.bristles:
        rest[_BRISTLES] = 0.0
    if variant.springs:
        rest[-6:] = 0.0
    poles = np.linalg.eigvals(kernel.jacobians(rest, np.zeros(N_INPUTS), p).A)
    largest = LARGEST_PRODUCT / float(np.abs(poles).max())
    return min(largest, LARGEST_FIXED_STEP) if variant.bristles else largest


def check_step(h: float, largest: float, time: float) -> None:
    """Refuse a step that does not resolve the modes of legs, which would grow or rest where they should not.

    Raises
    ------
    StepError
        Above the `largest_step`.
    """
    # the difference of two rounded times may be larger than the size that was set
    if h > largest * (1 + 1e-9):
        raise StepError(
            "fixed_step_size",
            h,
            time,
            f"is too large for legs that stick or give like these; expected at most {largest:.3g} s, or 0 for error "
            "control",
        )


def step_of_machine(
    kernel: Kernel, variant: Variant, u: FloatArray, p: FloatArray
) -> Callable[[FloatArray, float, float], FloatArray]:
    """The state after a fixed step from x, of time and size [s], under constant inputs: of RK4, or `fixed_step`."""
    system = gripped(kernel, variant, u, p)
    if not variant.bristles:
        return lambda x, _time, h: rk4_step(system.derivatives, x, h)
    return lambda x, time, h: fixed_step(system, x, system.derivatives(x), h, time)[0]


def fixed_step(
    system: Gripped, x: FloatArray, rate: FloatArray, h: float, time: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """State and derivatives after a step h [s] from x with the derivatives there, divided where needed.

    Raises
    ------
    StepError
        It would take more than `MOST_SUBSTEPS`; the message has the step that would not.
    """
    left = size = h
    for _ in range(MOST_SUBSTEPS):
        parts = np.ceil(left / size - 1e-9)
        part = left / parts
        end, end_rate, error = momentum_step(system, x, rate, part)
        factor = SAFETY * error**-0.25 if error > 0 else LARGEST_FACTOR
        size = part * min(LARGEST_FACTOR, max(SMALLEST_FACTOR, factor))
        if error <= 1:
            x, rate, left = end, end_rate, left - part
            if parts == 1:
                return x, rate
    possible = h - left if left < h else size
    raise StepError(
        "substeps",
        MOST_SUBSTEPS,
        time + h - left,
        f"do not resolve a step of {h:g} s; expected at most {possible:.2g} s",
    )


def momentum_step(system: Gripped, x: FloatArray, rate: FloatArray, h: float) -> tuple[FloatArray, FloatArray, float]:
    """One undivided step: state, derivatives, and the largest error of bristles and accelerations.

    It is in units of `RESOLUTION` and `FORCE_RESOLUTION`, and infinite for a step that has diverged.
    """
    derivatives, grip_of, _, at, velocities = system
    grip = grip_of(x)
    c, z0 = coefficients(grip.decay, h), x[at].copy()

    def of_momentum(found: FloatArray) -> FloatArray:
        found = found.copy()
        found[velocities] += grip.gain @ found[at]
        return found

    def state_of(y: FloatArray) -> FloatArray:
        state = y.copy()
        state[velocities] -= grip.gain @ (y[at] - z0)
        return state

    # at the begin w = ν
    stages = [(x, of_momentum(rate))]

    def in_momentum(y: FloatArray) -> FloatArray:
        stages.append((y, of_momentum(derivatives(state_of(y)))))
        return stages[-1][1]

    end = state_of(exponential_step(in_momentum, x, grip.decay, at, c, stages[0][1]))
    z, n = (np.array([part[at] for part in each]) for each in zip(*stages, strict=True))
    n = n + grip.decay * z
    end[velocities] -= grip.gain @ (grip.ratio * missed_integral(h * grip.decay, h, z, n))
    end_rate = derivatives(end)
    is_finite = np.isfinite(end).all() and np.isfinite(end_rate).all()
    if not is_finite:
        return end, end_rate, np.inf
    error = np.abs(c.last * (end_rate[at] + grip.decay * end[at] - n[3])) + reversal(system, grip, x, end, h)
    friction = np.abs(grip.gain) @ (grip.ratio * grip.reach)
    forces = np.abs(of_momentum(end_rate)[velocities] - stages[3][1][velocities]) / (10 * friction)
    largest = max((error / (RESOLUTION * grip.reach)).max(), forces.max() / FORCE_RESOLUTION)
    return end, end_rate, float(largest)


def reversal(system: Gripped, grip: Grip, x: FloatArray, end: FloatArray, h: float) -> FloatArray:
    """Error (6,) [m] of bristles whose leg turns within a step h from x to `end`; 0 of others.

    Where v crosses 0, the slope of d z jumps by the slope of v times |d z/v|. The rule's error for max(0, a (t − τ)) is
    a h² (ϑ²/2 − ϑ/6), ϑ = τ/h or 1 − τ/h below ½: about a h² ϑ (1 − ϑ)/6, at most 0.042 a h².
    """
    before, after = grip.sliding, system.sliding(end)
    turned = before * after < 0
    if not turned.any():
        return np.zeros_like(before)
    before, after = np.where(turned, before, 1.0), np.where(turned, after, -1.0)
    kink = np.abs(grip.decay * x[system.bristles] / before) + np.abs(
        system.grip(end).decay * end[system.bristles] / after
    )
    return np.where(turned, kink * h / 6 * np.abs(before * after / (after - before)), 0.0)


def missed_integral(hd: FloatArray, h: float, z: FloatArray, n: FloatArray) -> FloatArray:
    """∫ z dt over a step h of ETDRK4 less the sum of RK4, for bristles z (4, ...) of its stages and n = ż + d z there.

    The scheme for ζ̇ = z has the next function φ at each place: ∫ z dt = h φ1 z0 + h² Σ b_i n_i, b with φ2, φ3, φ4 of
    −h d in place of φ1, φ2, φ3.
    """
    one, two, three, four = phi_functions(-hd)
    exact = one * z[0] + h * (
        (two - 3 * three + 4 * four) * n[0] + (2 * three - 4 * four) * (n[1] + n[2]) + (4 * four - three) * n[3]
    )
    return np.asarray(h * (exact - (z[0] + 2 * (z[1] + z[2]) + z[3]) / 6))
