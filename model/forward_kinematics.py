"""Forward kinematics: the pose for given leg lengths, near a guess, by Newton's method."""

from dataclasses import dataclass

import numpy as np

from gough_stewart.model import interface
from gough_stewart.model.errors import InterfaceError, NoPoseError
from gough_stewart.model.kinematics import conditioning_of_legs, handedness_of_legs, jacobian_of_legs, leg_geometry
from gough_stewart.model.platform import Platform
from gough_stewart.model.pose_limits import SINGULAR_CONDITION_NUMBER
from gough_stewart.model.rotations import (
    matrix_from_orientation,
    matrix_from_quaternion,
    nearest_angle,
    orientation_from_matrix,
)
from gough_stewart.model.vectors import FloatArray

# Bound of a Newton step: translation as a fraction of the platform's size, rotation in rad.
LARGEST_STEP = 0.5
SMALLEST_SHARE = 1e-4


@dataclass(frozen=True)
class ForwardKinematics:
    """Result of the iteration."""

    position: FloatArray  # (3,) [m]
    orientation: FloatArray  # (3,) [rad]
    converged: bool
    iterations: int
    residual: float  # largest |L − L_given| [m]
    residual_history: tuple[float, ...]  # before each iteration and after the last; converges quadratically


def forward_kinematics(
    platform: Platform,
    leg_length: FloatArray,
    position: FloatArray | None = None,
    orientation: FloatArray | None = None,
    tolerance: float = 1e-12,
    max_iterations: int = 50,
) -> ForwardKinematics:
    """Pose with given leg lengths, in the assembly mode of the guess.

    Newton's method for L(pose) = L_given with the leg Jacobian: J [δt; δφ] = L_given − L, t ← t + δt, R ← exp(δφ~) R;
    quadratic convergence near the solution. Steps that do not reduce the residual are shortened, which makes the
    iteration robust for distant guesses. It never crosses a singular pose, so it stays in the assembly mode.

    Parameters
    ----------
    leg_length
        Leg lengths (6,) [m].
    position, orientation
        Guess; the home pose by default.
    tolerance
        Largest error of a leg length, relative to the longest leg.

    Returns
    -------
    ForwardKinematics
        `position` (3,) [m], `orientation` (3,) [rad], `converged`, `iterations`, and the largest error of a leg length:
        `residual` [m], and `residual_history` [m], before each iteration and after the last.

    Raises
    ------
    NoPoseError
        No pose found near the guess; the error's `result` has the last iterate.
    OrientationError
        The guess or an iterate has a pitch of ±90°.
    InterfaceError
        Lengths or guess with a wrong shape or not finite, lengths ≤ 0, or an invalid tolerance.

    Examples
    --------
    >>> pose = gs.forward_kinematics(gs.load_preset("liu2000"), [3.24, 3.25, 3.26, 3.25, 3.24, 3.25])
    >>> pose.position, pose.orientation, pose.residual
    """
    if not 0 < tolerance <= 1e-3:
        raise InterfaceError("tolerance", f"is {tolerance!r}; expected in (0, 1e-3], for example 1e-12")
    if max_iterations < 0:
        raise InterfaceError("max_iterations", f"is {max_iterations!r}; expected at least 0")
    target = interface.checked_value(interface.BY_NAME["leg_length"], leg_length)
    if target.min() <= 0:
        raise InterfaceError("leg_length", f"is {target.tolist()} m; expected lengths > 0")
    t = platform.home_position if position is None else position
    o = platform.home_orientation if orientation is None else orientation
    t = interface.checked_value(interface.BY_NAME["position"], t)
    o = interface.checked_value(interface.BY_NAME["orientation"], o)
    R = matrix_from_orientation(o)
    o = nearest_angle(orientation_from_matrix(R), o)
    legs = leg_geometry(platform, t, o)
    side, error = handedness_of_legs(legs), target - legs.length
    history = [float(np.abs(error).max())]
    close = tolerance * float(target.max())

    while history[-1] > close:
        if len(history) > max_iterations:
            raise _no_pose(f"no convergence after {max_iterations} iterations", t, o, history)
        if not conditioning_of_legs(legs).condition_number < SINGULAR_CONDITION_NUMBER:
            raise _no_pose("the leg Jacobian is singular there", t, o, history)
        step = np.linalg.solve(jacobian_of_legs(legs), error)
        # limit the step by the platform's size, then halve it until the lengths improve without a singular pose between
        size = max(np.linalg.norm(step[:3]) / platform.characteristic_length, np.linalg.norm(step[3:]))
        share = min(1.0, LARGEST_STEP / float(size))
        while share > SMALLEST_SHARE:
            t_next = t + share * step[:3]
            # exp(δφ~) by the quaternion (sin(φ/2) v/φ, cos(φ/2)) with φ = |v|
            turn = share * step[3:]
            half = np.linalg.norm(turn) / 2
            quaternion = np.append(np.sinc(half / np.pi) * turn / 2, np.cos(half))
            R_next = matrix_from_quaternion(quaternion) @ R
            o_next = nearest_angle(orientation_from_matrix(R_next), o)
            legs = leg_geometry(platform, t_next, o_next)
            error_next = target - legs.length
            improves = np.linalg.norm(error_next) < (1 - 1e-4 * share) * np.linalg.norm(error)
            if improves and handedness_of_legs(legs) == side:
                break
            share /= 2
        else:
            raise _no_pose("no step reduces the length errors", t, o, history)
        t, R, o, error = t_next, R_next, o_next, error_next
        history.append(float(np.abs(error).max()))
    return ForwardKinematics(t, o, True, len(history) - 1, history[-1], tuple(history))


def _no_pose(reason: str, t: FloatArray, o: FloatArray, history: list[float]) -> NoPoseError:
    result = ForwardKinematics(t, o, False, len(history) - 1, history[-1], tuple(history))
    return NoPoseError(
        f"no pose near this guess: {reason}; the largest length error is {history[-1]:.3g} m at position "
        f"{np.round(t, 6).tolist()} m, orientation {np.round(o, 6).tolist()} rad after {result.iterations} "
        "iterations; check the lengths or use a closer guess",
        result,
    )
