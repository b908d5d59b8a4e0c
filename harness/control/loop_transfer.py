"""The loop of an experiment as a linear system: the transfer from the actuators around the loop and back."""

import math

import numpy as np

from gough_stewart.harness.control.drive import Drive
from gough_stewart.harness.control.laws import LinearController
from gough_stewart.harness.control.linear import linear_matrices
from gough_stewart.harness.control.linear_law import MapsOfPose, displacements, inputs_of
from gough_stewart.harness.control.state_space import StateSpace, beside, discretised, matrices_of, series
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


def loop_transfer(
    platform: Platform,
    controller: LinearController,
    sample_time: float,
    *,
    delay: int = 0,
    lag: float = 0.0,
    late: float = 0.0,
    position: Array | None = None,
    orientation: Array | None = None,
    coulomb_friction: bool = False,
    believed: Platform | None = None,
    side: signals.Side = "leg",
) -> StateSpace:
    """Loop transfer L(z) (6×6) at the actuators, u = −L u, of the sampled loop at a pose (default: home).

    L = C(z) · z⁻ᵈ · ZOH{P(s) e⁻ˢᶿ / (τ s + 1)}: the linear plant with the actuators' lag between hold and sampler, the
    computational delay, and the controller from measurement to force with inverted sign.

    Parameters
    ----------
    sample_time
        [s]
    delay
        [samples]
    lag
        τ [s]
    late
        θ, a further delay between force and reading, of any length [s]
    coulomb_friction
        Keep the slope of Coulomb friction at rest; see `linearise`.
    side
        Of legs that give, where their lengths and velocities are measured: "leg" or "motor".
    believed
        The platform whose legs' Jacobian a controller in task space uses; by default the same.

    Raises
    ------
    ControllerError
        The controller has another sample time, or the delay needs more states than `MOST_STATES`.
    """
    controller.check_sample_time(sample_time)
    drive = Drive.linear({"lag": lag}, sample_time)
    samples = math.floor(late / sample_time + _ROUNDING)
    rest = late - samples * sample_time
    rest, delay = rest if rest > _ROUNDING * sample_time else 0.0, delay + samples
    # those of legs that give, or of an ideal platform; sliding legs have no bristles
    variant = Variant.of(platform if coulomb_friction else platform.with_parameters(SLIDING))
    under_way = delay + (1 if rest else 0)
    states = size_of(variant.states) + 6 * drive.nstates + 6 * under_way + controller.system.nstates
    if states > MOST_STATES:
        raise ControllerError(
            f"a delay of {under_way} samples of {sample_time:g} s gives a linear loop of {states} states; expected at "
            f"most {MOST_STATES}: a delay of fewer, longer samples"
        )
    where = position, orientation
    plant = held_plant(
        platform, controller, sample_time, lag, *where, late=rest, coulomb_friction=coulomb_friction, side=side
    )
    none, one = np.zeros((6, 6)), np.eye(6)
    for _ in range(delay):
        plant = series(StateSpace(none, one, one, none, sample_time), plant)
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
    drive = Drive.linear({"lag": lag}, sample_time)
    at_motor = side == "motor" and platform.leg_stiffness > 0
    outputs = [signals.AT_MOTORS.get(name, name) for name in controller.signals] if at_motor else controller.signals
    linear = linear_matrices(platform, position, orientation, outputs, coulomb_friction=coulomb_friction)
    plant = StateSpace(linear.A, linear.B[:, :6], linear.C, linear.D[:, :6])
    if drive.nstates:
        plant = series(beside(drive, 6), plant)
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
    platform: Platform,
    controller: LinearController,
    position: Array | None = None,
    orientation: Array | None = None,
) -> StateSpace:
    """C with F = −C y: the controller from measurements to forces at a pose, in its own space."""
    K, n = matrices_of(controller.system), len(signals.positions(controller.signals))
    (r, y), to_force = space_of(platform, controller, position, orientation)
    # what a measurement of each signal puts into u, for F = −C y
    u = -np.concatenate(inputs_of(controller.kinds, r, y, np.zeros((6, n))))
    return StateSpace(K.A, K.B @ u, to_force @ K.C, to_force @ K.D @ u, K.dt)


def space_of(
    platform: Platform,
    controller: LinearController,
    position: Array | None = None,
    orientation: Array | None = None,
) -> tuple[tuple[FloatArray, FloatArray], FloatArray]:
    """What measurements make of a controller's references and readings (n, n), and of its outputs, forces (6, 6)."""
    n = len(signals.positions(controller.signals))
    one, none = np.eye(n), np.zeros((n, n))
    if controller.space == "leg":
        return (none, one), np.eye(6)
    p = platform.home_position if position is None else position
    o = platform.home_orientation if orientation is None else orientation
    maps = MapsOfPose(leg_jacobian(platform, p, o))
    # from lengths that have been constant: the memory of task space, a sum, is no state of small signals
    return displacements(maps, none, none, none, one), maps.to_force(np.eye(6))
