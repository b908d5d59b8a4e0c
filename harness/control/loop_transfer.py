"""The loop of an experiment as a linear system: the transfer from the actuators around the loop and back."""

import numpy as np

from gough_stewart.harness.control.drive import Drive
from gough_stewart.harness.control.laws import LinearController
from gough_stewart.harness.control.linear import linear_matrices
from gough_stewart.harness.control.linear_law import MapsOfPose, displacements, inputs_of
from gough_stewart.harness.control.state_space import StateSpace, beside, discretised, matrices_of, series
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.plants import signals
from gough_stewart.model.interface import size_of
from gough_stewart.model.kinematics import leg_jacobian
from gough_stewart.model.platform import Platform
from gough_stewart.model.variant import SLIDING, Variant
from gough_stewart.model.vectors import Array, FloatArray

# Doubling the number multiplies the time for eigenvalues by ten, to half a minute.
MOST_STATES = 300


def loop_transfer(
    platform: Platform,
    controller: LinearController,
    sample_time: float,
    *,
    delay: int = 0,
    lag: float = 0.0,
    position: Array | None = None,
    orientation: Array | None = None,
    coulomb_friction: bool = False,
    believed: Platform | None = None,
    side: signals.Side = "leg",
) -> StateSpace:
    """Loop transfer L(z) (6×6) at the actuators, u = −L u, of the sampled loop at a pose (default: home).

    L = C(z) · z⁻ᵈ · ZOH{P(s) / (τ s + 1)}: the linear plant with the actuators' lag between hold and sampler, the
    computational delay, and the controller from measurement to force with inverted sign.

    Parameters
    ----------
    sample_time
        [s]
    delay
        [samples]
    lag
        τ [s]
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
    drive = Drive.linear({"lag": lag}, sample_time)
    # those of legs that give, or of an ideal platform; sliding legs have no bristles
    variant = Variant.of(platform if coulomb_friction else platform.with_parameters(SLIDING))
    states = size_of(variant.states) + 6 * drive.nstates + 6 * delay + controller.system.nstates
    if states > MOST_STATES:
        raise ControllerError(
            f"a delay of {delay} samples of {sample_time:g} s gives a linear loop of {states} states; expected at most "
            f"{MOST_STATES}: a delay of fewer, longer samples"
        )
    plant = held_plant(
        platform, controller, sample_time, lag, position, orientation, coulomb_friction=coulomb_friction, side=side
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
    coulomb_friction: bool = False,
    side: signals.Side = "leg",
) -> StateSpace:
    """ZOH{P(s) / (τ s + 1)}: from commanded forces to the controller's signals, at its sample time."""
    controller.check_sample_time(sample_time)
    drive = Drive.linear({"lag": lag}, sample_time)
    at_motor = side == "motor" and platform.leg_stiffness > 0
    outputs = [signals.AT_MOTORS.get(name, name) for name in controller.signals] if at_motor else controller.signals
    linear = linear_matrices(platform, position, orientation, outputs, coulomb_friction=coulomb_friction)
    plant = StateSpace(linear.A, linear.B[:, :6], linear.C, linear.D[:, :6])
    if drive.nstates:
        plant = series(beside(drive, 6), plant)
    return discretised(plant, sample_time, "zoh")


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
