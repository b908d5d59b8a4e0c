"""The platform and its loop as linear systems, at rest in a pose.

The platform: nonlinear, linearised exactly, and its modes. The loop of an experiment: the transfer from the actuators
around it and back; and the structural modes of a platform on elastic legs, and what they do to its bandwidth.

python-control and the compiled kernel are imported where systems are made, since other functions of this module do not
need these slow imports.
"""

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.laws_of_members import displacements, inputs_of
from gough_stewart.harness.control.linear_controller import LinearController
from gough_stewart.harness.control.loop_margins import disk_margin, frequency_range, is_stable, response
from gough_stewart.harness.control.state_space import StateSpace, discretised, series
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.plants import signals
from gough_stewart.model import interface
from gough_stewart.model.dynamics import holding_motor_position, static_leg_forces
from gough_stewart.model.errors import InterfaceError
from gough_stewart.model.interface import SLIDING, Variant
from gough_stewart.model.kinematics import LARGEST_PITCH, leg_jacobian
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import Array, FloatArray, real_array

if TYPE_CHECKING:
    import control

OUTPUTS = tuple(v.name for v in interface.OUTPUTS)
INPUT_NAMES = [name for v in interface.INPUTS for name in v.scalar_names]
# Doubling the number multiplies the time for eigenvalues by ten, to half a minute.
MOST_STATES = 300
# Relative tolerance within which a time is a whole number of samples.
_ROUNDING = 1e-6
# The search for the largest bandwidth: down to this share of the first mode, by this factor at first, to this share.
_LOWEST, _STEP, _RESOLUTION = 1 / 64, 1.5, 0.01
_STATES_OF_PLATFORM = 12


Pose = tuple[FloatArray, FloatArray]  # position (3,) [m] and orientation (3,) [rad]


class OperatingPoint(NamedTuple):
    """A state at rest with the inputs that hold it."""

    state: FloatArray  # (12,)
    inputs: FloatArray  # (12,)


class Mode(NamedTuple):
    """A mode of a linear system; a conjugate pair counts as one."""

    eigenvalue: complex  # in continuous time [1/s]; of a pair, the one with positive imaginary part
    frequency: float  # |eigenvalue| / 2π [Hz]
    damping_ratio: float  # −Re / |eigenvalue|; negative if the mode is unstable


def plant_system(platform: Platform, outputs: Iterable[str] = OUTPUTS) -> "control.NonlinearIOSystem":
    """The platform as a nonlinear python-control system: ẋ = f(x, u), y = g(x, u).

    States, inputs and outputs have the interface's scalar names: `position[1]`, `actuator_force[6]`, `leg_length[3]`.
    python-control treats such names as elements of one signal: `interconnect` connects `plant.leg_length` as a whole,
    and `plant.leg_length[2:4]` is elements 2 and 3. Elements with two indices, such as `joint_force[2,1]`, can only be
    connected one by one.

    Parameters
    ----------
    platform
        The platform with its parameters.
    outputs
        Names of outputs or locals of the interface.

    Returns
    -------
    control.NonlinearIOSystem
        12 states, the pose and the twist, then those of a platform with stiction or elastic legs; 12 inputs,
        the actuator forces and the external wrench; the outputs asked for.

    Raises
    ------
    InterfaceError
        Another name, a repeated name, or no name.

    See Also
    --------
    linearise, trim, SteppingModel

    Examples
    --------
    >>> plant = gs.plant_system(gs.load_preset("liu2000"), outputs=("leg_length",))
    >>> plant.input_labels[:6], plant.nstates
    """
    from control import nlsys

    from gough_stewart.model.kernel import Kernel, parameter_vector

    variant = Variant.of(platform)
    kernel, p = Kernel(variant), parameter_vector(platform, variant)
    names, rows = _rows(outputs, variant)

    return nlsys(
        lambda _t, x, u, _params: kernel.derivatives(x, u, p).copy(),
        lambda _t, x, u, _params: kernel.outputs(x, u, p)[rows],
        states=[name for v in variant.states for name in v.scalar_names],
        inputs=INPUT_NAMES,
        outputs=names,
        name="plant",
    )


def trim(
    platform: Platform,
    position: Array | None = None,
    orientation: Array | None = None,
    external_wrench: Array | float = 0.0,
) -> OperatingPoint:
    """The platform at rest in a pose (default: home) under the leg forces that hold it there.

    Jᵀ F = n(pose, 0) − [f_ext; τ_ext], as in `inverse_dynamics`.

    Parameters
    ----------
    platform
        The platform; its home pose is the default.
    position, orientation
        Pose (3,) [m], (3,) [rad]; home by default.
    external_wrench
        [f_ext; τ_ext] (6,) at Op in world components [N, N m].

    Returns
    -------
    OperatingPoint
        `state` (12,), the pose and a twist of zero; `inputs` (12,), actuator forces [N] and external wrench [N, N m].

    Raises
    ------
    InterfaceError
        The pose or the wrench is not finite or has another shape, or the pitch is ±90°.
    SingularPoseError
        The legs cannot hold the pose.

    See Also
    --------
    linearise, static_leg_forces

    Examples
    --------
    >>> point = gs.trim(gs.load_preset("motion_base"), position=[0.2, 0.1, 2.1])
    >>> point.state, point.inputs[:6]
    """
    pose_and_wrench: dict[str, Any] = {
        "position": platform.home_position if position is None else position,
        "orientation": platform.home_orientation if orientation is None else orientation,
        "external_wrench": np.zeros(6) if np.ndim(external_wrench) == 0 and not external_wrench else external_wrench,
    }
    arrays = []
    for name, value in pose_and_wrench.items():
        try:
            arrays.append(real_array(value, (6,) if name == "external_wrench" else (3,)))
        except ValueError as error:
            raise InterfaceError(name, str(error)) from None
    p, o, wrench = arrays
    if not abs(o[1]) < LARGEST_PITCH:
        raise InterfaceError("orientation", f"has a pitch of {o[1]:.6g} rad; expected less than {LARGEST_PITCH:.6g}")
    force = static_leg_forces(platform, p, o, wrench)
    return OperatingPoint(np.concatenate([p, o, np.zeros(6)]), np.concatenate([force, wrench]))


def linearise(
    platform: Platform,
    position: Array | None = None,
    orientation: Array | None = None,
    outputs: Iterable[str] = OUTPUTS,
    *,
    coulomb_friction: bool = False,
) -> "control.StateSpace":
    """Linear model δẋ = A δx + B δu, δy = C δx + D δu at rest in a pose (default: home), by exact Jacobians.

    Signals are named as in `plant_system`. Åström & Murray, Feedback Systems (2021), section 6.4.

    Parameters
    ----------
    platform
        The platform; its home pose is the default.
    position, orientation
        Pose at rest (3,) [m], (3,) [rad]; home by default.
    outputs
        Names of outputs or locals of the interface.
    coulomb_friction
        Keep the slope of the smoothed Coulomb friction at rest, leg_coulomb_friction / leg_friction_velocity [N s/m].
        It acts as a large damper that the moving platform does not have, so it is left out by default. With
        stiction: legs stuck on springs of leg_bristle_stiffness; by default legs slide.

    Returns
    -------
    control.StateSpace
        12 states, the pose and the twist, then those of a platform with stiction or elastic legs; 12 inputs,
        the actuator forces and the external wrench; the outputs asked for. All in SI units, as deviations from rest.

    Raises
    ------
    InterfaceError, SingularPoseError
        As `plant_system` and `trim`.

    See Also
    --------
    plant_system, trim, modes

    Examples
    --------
    >>> linear = gs.linearise(gs.load_preset("liu2000"), outputs=("leg_length", "leg_velocity"))
    >>> linear.A.shape, linear.C.shape
    """
    from control import ss

    variant = Variant.of(platform if coulomb_friction else platform.with_parameters(SLIDING))
    outputs = outputs if isinstance(outputs, str) else tuple(outputs)  # read twice, which an iterator cannot be
    names, _ = _rows(outputs, variant)
    linear = linear_matrices(platform, position, orientation, outputs, coulomb_friction=coulomb_friction)
    states = [name for v in variant.states for name in v.scalar_names]
    labels = {"states": states, "inputs": INPUT_NAMES, "outputs": names}
    return ss(linear.A, linear.B, linear.C, linear.D, **labels, name="plant")


def linear_matrices(
    platform: Platform,
    position: Array | None = None,
    orientation: Array | None = None,
    outputs: Iterable[str] = OUTPUTS,
    *,
    coulomb_friction: bool = False,
) -> StateSpace:
    """`linearise` without python-control, whose import takes longer than all margins."""
    from gough_stewart.model.kernel import Kernel, parameter_vector

    platform = platform if coulomb_friction else platform.with_parameters(SLIDING)
    variant = Variant.of(platform)
    _, rows = _rows(outputs, variant)
    point = trim(platform, position, orientation)
    # at rest: bristles unbent, motors where their springs carry the platform
    motors = holding_motor_position(platform, point.state[:3], point.state[3:6])
    at_rest = {"leg_bristle": np.zeros(6), "motor_position": motors, "motor_velocity": np.zeros(6)}
    x = np.concatenate([point.state, *(at_rest[v.name] for v in variant.states[len(interface.STATES) :])])
    A, B, C, D = (
        block.copy() for block in Kernel(variant).jacobians(x, point.inputs, parameter_vector(platform, variant))
    )
    return StateSpace(A, B, C[rows], D[rows])


def modes(system: Any) -> list[Mode]:
    """Modes of a linear system, slowest first; discrete poles are mapped by λ = ln(z) / dt.

    A pole at z = 0, of a pure delay, has no continuous counterpart and is left out. Definitions as in Åström & Murray,
    Feedback Systems (2021).

    Parameters
    ----------
    system
        A linear python-control system, continuous or discrete.

    Returns
    -------
    list of Mode
        For each real eigenvalue and each conjugate pair: `eigenvalue` [1/s], the one with positive imaginary part;
        `frequency` |λ|/2π [Hz]; `damping_ratio` −Re λ/|λ|, negative if the mode is unstable.

    Raises
    ------
    ArgumentError
        An argument of another type, shape or unit.

    See Also
    --------
    linearise, margins

    Examples
    --------
    >>> for mode in gs.modes(gs.linearise(gs.load_preset("liu2000"))): print(mode.frequency, mode.damping_ratio)
    """
    poles = np.asarray(system.poles(), dtype=complex)
    if system.isdtime(strict=True):
        poles = np.log(poles[np.abs(poles) > 1e-9]) / system.dt
    upper = [complex(pole) for pole in poles if pole.imag >= -1e-9 * abs(pole)]  # without conjugates
    return sorted(
        (Mode(pole, abs(pole) / (2 * math.pi), -pole.real / abs(pole) if pole else 1.0) for pole in upper),
        key=lambda mode: mode.frequency,
    )


def _rows(outputs: Iterable[str], variant: Variant) -> tuple[list[str], NDArray[np.intp]]:
    """Scalar names of some results, and their positions in the kernel's y."""
    chosen_names = [outputs] if isinstance(outputs, str) else list(outputs)
    place_of = interface.places(variant.results)
    if not chosen_names:
        raise InterfaceError("outputs", "is empty; expected at least one name, such as 'leg_length'")
    for name in chosen_names:
        if name not in place_of:
            raise InterfaceError(str(name), f"is not a result of the plant{interface.nearest(str(name), place_of)}")
        if chosen_names.count(name) > 1:
            raise InterfaceError(name, "is named twice; expected every output once")
    names = [scalar for name in chosen_names for scalar in interface.BY_NAME[name].scalar_names]
    return names, np.concatenate([np.ravel(place_of[name]) for name in chosen_names])


# --- the loop --------------------------------------------------------------------------------------------------------


def loop_transfer(
    platform: Platform,
    controller: LinearController,
    sample_time: float,  # [s]
    pose: Pose,
    *,
    delay: int = 0,  # [samples]
    lag: float = 0.0,  # τ [s]
    late: float = 0.0,  # θ, a further delay between force and reading, of any length [s]
    believed: Platform | None = None,  # whose legs' Jacobian a controller in task space uses; by default the same
    side: signals.Side = "leg",  # of elastic legs, where their lengths and velocities are measured
) -> StateSpace:
    """Loop transfer L(z) (6×6) at the actuators, u = −L u, of the sampled loop at a pose.

    L = C(z) · z⁻ᵈ · ZOH{P(s) e⁻ˢᶿ / (τ s + 1)}: the linear plant with the actuators' lag between hold and sampler, the
    computational delay, and the controller from measurement to force with inverted sign.
    """
    controller.check_sample_time(sample_time)
    samples = math.floor(late / sample_time + _ROUNDING)
    rest = late - samples * sample_time
    rest, delay = rest if rest > _ROUNDING * sample_time else 0.0, delay + samples
    # those of elastic legs, or of an ideal platform; sliding legs have no bristles
    variant = Variant.of(platform.with_parameters(SLIDING))
    under_way = delay + (1 if rest else 0)
    states = variant.n_states + 6 * (lag > 0) + 6 * under_way + len(controller.system.A)
    if states > MOST_STATES:
        raise ControllerError(
            f"a delay of {under_way} samples of {sample_time:g} s gives a linear loop of {states} states; expected at "
            f"most {MOST_STATES}: a delay of fewer, longer samples"
        )
    plant = held_plant(platform, controller, sample_time, pose, lag=lag, late=rest, side=side)
    none, identity = np.zeros((6, 6)), np.eye(6)
    for _ in range(delay):
        plant = series(StateSpace(none, identity, identity, none, sample_time), plant)
    return series(plant, feedback_part(platform if believed is None else believed, controller, pose))


def held_plant(
    platform: Platform,
    controller: LinearController,
    sample_time: float,
    pose: Pose,
    *,
    lag: float = 0.0,
    late: float = 0.0,
    side: signals.Side = "leg",
) -> StateSpace:
    """ZOH{P(s) e⁻ˢᶿ / (τ s + 1)}: from commanded forces to the controller's signals; `late` θ is less than a sample."""
    at_motor = side == "motor" and platform.leg_stiffness > 0
    outputs = [signals.AT_MOTORS.get(name, name) for name in controller.signals] if at_motor else controller.signals
    linear = linear_matrices(platform, *pose, outputs)
    plant = StateSpace(linear.A, linear.B[:, :6], linear.C, linear.D[:, :6])
    if lag > 0:  # ḟ = (r − f)/τ
        identity = np.eye(6)
        plant = series(StateSpace(-identity / lag, identity / lag, identity, 0 * identity), plant)
    if not late:
        return discretised(plant, sample_time, "zoh")
    # within a sample the last force acts for θ, and the new one for the rest
    last, new = (discretised(plant, time, "zoh") for time in (late, sample_time - late))
    none = np.zeros((6, len(plant.A)))
    return StateSpace(
        np.block([[new.A @ last.A, new.A @ last.B], [none, np.zeros((6, 6))]]),
        np.concatenate([new.B, np.eye(6)]),
        np.concatenate([plant.C, plant.D], axis=1),
        np.zeros_like(plant.D),
        sample_time,
    )


def feedback_part(platform: Platform, controller: LinearController, pose: Pose) -> StateSpace:
    """C with F = −C y: the controller from measurements to forces at a pose, in its own space."""
    K, n = controller.system, len(signals.positions(controller.signals))
    (r, y), to_force = space_of(platform, controller, pose)
    # what a measurement of each signal puts into u, for F = −C y
    u = -np.concatenate(inputs_of(controller.kinds, r, y, np.zeros((6, n))))
    return StateSpace(K.A, K.B @ u, to_force @ K.C, to_force @ K.D @ u, controller.sample_time or 0.0)


def space_of(
    platform: Platform, controller: LinearController, pose: Pose
) -> tuple[tuple[FloatArray, FloatArray], FloatArray]:
    """What measurements make of a controller's references and readings (n, n), and of its outputs, forces (6, 6)."""
    n = len(signals.positions(controller.signals))
    identity, none = np.eye(n), np.zeros((n, n))
    if controller.space == "leg":
        return (none, identity), np.eye(6)
    J_inverse = np.linalg.inv(leg_jacobian(platform, *pose))
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


def structural_modes(platform: Platform, pose: Pose) -> tuple[tuple[Mode, ...], FloatArray]:
    """Modes of the platform on its legs in a pose, lowest first, and those of held motors [Hz].

    Of the linear model: with free motors these are its oscillating modes above the first mode of held motors, at most
    six; motors are held where their states are left out. Legs slide.
    """
    A, none = linear_matrices(platform, *pose).A, np.zeros((0, 0))
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
    pose: Pose,
) -> LoopStructure | None:
    """The structural modes of a loop in a pose; None of rigid legs.

    The family is the bandwidth [Hz] of its controller, and the same loop with another one; None if it has none.
    """
    if not platform.leg_stiffness > 0:
        return None
    free, held = structural_modes(platform, pose)
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
