"""The loop of an experiment as a linear system: the transfer from the actuators around the loop and back.

And the structural modes of a platform on elastic legs: what they do to the bandwidth of a loop.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gough_stewart.harness.control.laws_of_members import displacements, inputs_of
from gough_stewart.harness.control.linear import Mode, linear_matrices, modes, pose_of
from gough_stewart.harness.control.linear_controller import LinearController
from gough_stewart.harness.control.loop_margins import disk_margin, frequency_range, is_stable, response
from gough_stewart.harness.control.state_space import StateSpace, discretised, matrices_of, series
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.plants import signals
from gough_stewart.model.interface import SLIDING, Variant, size_of
from gough_stewart.model.kinematics import leg_jacobian
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import Array, FloatArray

# Doubling the number multiplies the time for eigenvalues by ten, to half a minute.
MOST_STATES = 300
# Relative tolerance within which a time is a whole number of samples.
_ROUNDING = 1e-6
# The search for the largest bandwidth: down to this share of the first mode, by this factor at first, to this share.
_LOWEST, _STEP, _RESOLUTION = 1 / 64, 1.5, 0.01
_STATES_OF_PLATFORM = 12


def loop_transfer(
    platform: Platform,
    controller: LinearController,
    sample_time: float,  # [s]
    *,
    delay: int = 0,  # [samples]
    lag: float = 0.0,  # τ [s]
    late: float = 0.0,  # θ, a further delay between force and reading, of any length [s]
    position: Array | None = None,
    orientation: Array | None = None,
    coulomb_friction: bool = False,  # keep its slope at rest; see `linearise`
    believed: Platform | None = None,  # whose legs' Jacobian a controller in task space uses; by default the same
    side: signals.Side = "leg",  # of elastic legs, where their lengths and velocities are measured
) -> StateSpace:
    """Loop transfer L(z) (6×6) at the actuators, u = −L u, of the sampled loop at a pose (default: home).

    L = C(z) · z⁻ᵈ · ZOH{P(s) e⁻ˢᶿ / (τ s + 1)}: the linear plant with the actuators' lag between hold and sampler, the
    computational delay, and the controller from measurement to force with inverted sign.
    """
    controller.check_sample_time(sample_time)
    samples = math.floor(late / sample_time + _ROUNDING)
    rest = late - samples * sample_time
    rest, delay = rest if rest > _ROUNDING * sample_time else 0.0, delay + samples
    # those of elastic legs, or of an ideal platform; sliding legs have no bristles
    variant = Variant.of(platform if coulomb_friction else platform.with_parameters(SLIDING))
    under_way = delay + (1 if rest else 0)
    states = size_of(variant.states) + 6 * (lag > 0) + 6 * under_way + controller.system.nstates
    if states > MOST_STATES:
        raise ControllerError(
            f"a delay of {under_way} samples of {sample_time:g} s gives a linear loop of {states} states; expected at "
            f"most {MOST_STATES}: a delay of fewer, longer samples"
        )
    pose = position, orientation
    plant = held_plant(
        platform, controller, sample_time, lag, *pose, late=rest, coulomb_friction=coulomb_friction, side=side
    )
    none, identity = np.zeros((6, 6)), np.eye(6)
    for _ in range(delay):
        plant = series(StateSpace(none, identity, identity, none, sample_time), plant)
    return series(plant, feedback_part(platform if believed is None else believed, controller, position, orientation))


def held_plant(
    platform: Platform,
    controller: LinearController,
    sample_time: float,
    lag: float = 0.0,
    position: Array | None = None,
    orientation: Array | None = None,
    *,
    late: float = 0.0,
    coulomb_friction: bool = False,
    side: signals.Side = "leg",
) -> StateSpace:
    """ZOH{P(s) e⁻ˢᶿ / (τ s + 1)}: from commanded forces to the controller's signals; `late` θ is less than a sample."""
    at_motor = side == "motor" and platform.leg_stiffness > 0
    outputs = [signals.AT_MOTORS.get(name, name) for name in controller.signals] if at_motor else controller.signals
    linear = linear_matrices(platform, position, orientation, outputs, coulomb_friction=coulomb_friction)
    plant = StateSpace(linear.A, linear.B[:, :6], linear.C, linear.D[:, :6])
    if lag > 0:  # ḟ = (r − f)/τ
        identity = np.eye(6)
        plant = series(StateSpace(-identity / lag, identity / lag, identity, 0 * identity), plant)
    if not late:
        return discretised(plant, sample_time, "zoh")
    # within a sample the last force acts for θ, and the new one for the rest
    last, new = (discretised(plant, time, "zoh") for time in (late, sample_time - late))
    none = np.zeros((6, plant.nstates))
    return StateSpace(
        np.block([[new.A @ last.A, new.A @ last.B], [none, np.zeros((6, 6))]]),
        np.concatenate([new.B, np.eye(6)]),
        np.concatenate([plant.C, plant.D], axis=1),
        np.zeros_like(plant.D),
        sample_time,
    )


def feedback_part(
    platform: Platform, controller: LinearController, position: Array | None = None, orientation: Array | None = None
) -> StateSpace:
    """C with F = −C y: the controller from measurements to forces at a pose, in its own space."""
    K, n = matrices_of(controller.system), len(signals.positions(controller.signals))
    (r, y), to_force = space_of(platform, controller, position, orientation)
    # what a measurement of each signal puts into u, for F = −C y
    u = -np.concatenate(inputs_of(controller.kinds, r, y, np.zeros((6, n))))
    return StateSpace(K.A, K.B @ u, to_force @ K.C, to_force @ K.D @ u, K.dt)


def space_of(
    platform: Platform, controller: LinearController, position: Array | None = None, orientation: Array | None = None
) -> tuple[tuple[FloatArray, FloatArray], FloatArray]:
    """What measurements make of a controller's references and readings (n, n), and of its outputs, forces (6, 6)."""
    n = len(signals.positions(controller.signals))
    identity, none = np.eye(n), np.zeros((n, n))
    if controller.space == "leg":
        return (none, identity), np.eye(6)
    J_inverse = np.linalg.inv(leg_jacobian(platform, *pose_of(platform, position, orientation)))
    # from lengths that have been constant: the memory of task space, a sum, is no state of small signals
    return displacements(lambda change: J_inverse @ change, none, none, none, identity), J_inverse.T


class StructuralMode(NamedTuple):
    """A mode of the platform on its legs."""

    frequency: float  # of the machine, whose motors are free: a resonance of the loop [Hz]
    damping_ratio: float
    held_frequency: float  # with motors that hold; nan if it does not oscillate [Hz]
    gain: float  # largest singular value of the loop transfer there; below 1 no phase makes it unstable


class LoopStructure(NamedTuple):
    """The structural modes of a loop, and the bandwidth that they allow."""

    modes: tuple[StructuralMode, ...]  # lowest first; none that is overdamped
    disk: float  # the disk margin that `bandwidth` keeps
    # largest of this controller at that disk margin [Hz]; nan if there is none, None of a controller without bandwidth
    bandwidth: float | None


def structural_modes(
    platform: Platform, position: Array | None = None, orientation: Array | None = None
) -> tuple[tuple[Mode, ...], FloatArray]:
    """Modes of the platform on its legs in a pose (default: home), lowest first, and those of held motors [Hz].

    Of the linear model: with free motors these are its oscillating modes above the first mode of held motors, at most
    six; motors are held where their states are left out. Legs slide.
    """
    A, none = linear_matrices(platform, position, orientation).A, np.zeros((0, 0))
    free, held_modes = (
        [mode for mode in modes(StateSpace(block, none, none, none)) if mode.eigenvalue.imag > 0]
        for block in (A, A[:_STATES_OF_PLATFORM, :_STATES_OF_PLATFORM])
    )
    held = np.array([mode.frequency for mode in held_modes])
    first = float(held[0]) if len(held) else 0.0
    return tuple(mode for mode in free if mode.frequency > first)[-6:], held[-6:]


def structure_of(
    platform: Platform,
    transfer: StateSpace,  # L (6×6)
    family: tuple[float, Callable[[float], StateSpace]] | None,
    disk: float,  # the disk margin to keep
    position: Array | None = None,
    orientation: Array | None = None,
) -> LoopStructure | None:
    """The structural modes of a loop in a pose; None of rigid legs.

    The family is the bandwidth [Hz] of its controller, and the same loop with another one; None if it has none.
    """
    if not platform.leg_stiffness > 0:
        return None
    free, held = structural_modes(platform, position, orientation)
    held = np.concatenate([held, np.full(len(free), math.nan)])
    _, top = frequency_range(transfer)
    loop_modes = []
    for mode, held_frequency in zip(free, held[: len(free)], strict=True):
        omega, gain = 2 * math.pi * mode.frequency, math.nan  # no gain beyond half of the sample rate
        if omega < top:
            gain = float(np.linalg.norm(response(transfer, np.array([omega]))[0], 2))
        loop_modes.append(StructuralMode(mode.frequency, mode.damping_ratio, float(held_frequency), gain))
    if family is None or not free:
        return LoopStructure(tuple(loop_modes), disk, None)
    start, with_bandwidth = family
    first = free[0].frequency

    def keeps(bandwidth: float) -> bool:
        try:
            loop = with_bandwidth(bandwidth)
        except ControllerError:  # no such controller, as a PID whose integral time is too short for it
            return False
        return is_stable(loop) and disk_margin(loop).alpha >= disk

    # the largest bandwidth below the first mode, to 1 %: upwards as long as the margin is kept, downwards until it is
    low = high = min(start, first)
    if keeps(low):
        while high < first and keeps(high := min(first, _STEP * high)):
            low = high
    else:
        while not keeps(low := low / _STEP):
            if low < _LOWEST * first:
                return LoopStructure(tuple(loop_modes), disk, math.nan)
        high = _STEP * low
    while high > (1 + _RESOLUTION) * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if keeps(middle) else (low, middle)
    return LoopStructure(tuple(loop_modes), disk, low)
