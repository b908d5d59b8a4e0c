"""The platform as a system: nonlinear, linearised exactly at rest, and its modes.

python-control and the compiled kernel are imported where systems are made, since other functions of this module do not
need these slow imports.
"""

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.state_space import StateSpace
from gough_stewart.model import interface
from gough_stewart.model.dynamics import holding_motor_position, static_leg_forces
from gough_stewart.model.errors import InterfaceError
from gough_stewart.model.interface import SLIDING, Variant
from gough_stewart.model.kinematics import LARGEST_PITCH
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import Array, FloatArray, real_array

if TYPE_CHECKING:
    import control

OUTPUTS = tuple(v.name for v in interface.OUTPUTS)
INPUT_NAMES = [name for v in interface.INPUTS for name in v.scalar_names]


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
    p, o = pose_of(platform, position, orientation)
    wrench = np.zeros(6) if np.ndim(external_wrench) == 0 and not external_wrench else external_wrench
    wrench = _checked("external_wrench", wrench, (6,))
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


def pose_of(platform: Platform, position: Array | None, orientation: Array | None) -> tuple[FloatArray, FloatArray]:
    """Position and orientation, by default at home; refused as `trim` does."""
    p = _checked("position", platform.home_position if position is None else position, (3,))
    o = _checked("orientation", platform.home_orientation if orientation is None else orientation, (3,))
    if not abs(o[1]) < LARGEST_PITCH:
        raise InterfaceError("orientation", f"has a pitch of {o[1]:.6g} rad; expected less than {LARGEST_PITCH:.6g}")
    return p, o


def _checked(name: str, value: object, shape: tuple[int, ...]) -> FloatArray:
    try:
        return real_array(value, shape)
    except ValueError as error:
        raise InterfaceError(name, str(error)) from None


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
