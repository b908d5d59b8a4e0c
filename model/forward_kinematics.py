"""Forward kinematics: poses for given leg lengths, near a guess or along a log, by Newton's method."""

from ctypes import c_double, c_size_t, c_void_p
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gough_stewart.model import interface
from gough_stewart.model.errors import InterfaceError, NoPoseError
from gough_stewart.model.interface import IDEAL
from gough_stewart.model.kinematics import (
    SINGULAR_CONDITION_NUMBER,
    conditioning_of_legs,
    jacobian_of_legs,
    leg_geometry,
)
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import (
    matrix_from_orientation,
    matrix_from_quaternion,
    nearest_angle,
    orientation_from_matrix,
)
from gough_stewart.model.vectors import FloatArray, without_warnings

# Bound of a Newton step: translation as a fraction of the platform's size, rotation in rad.
LARGEST_STEP = 0.5
SMALLEST_SHARE = 1e-4


@dataclass(frozen=True)
class ForwardKinematics:
    """Poses with given leg lengths; of many rows each field is an array over the leading axes (…)."""

    position: FloatArray  # (…, 3) [m]
    orientation: FloatArray  # (…, 3) [rad]
    converged: bool | NDArray[np.bool_]  # of rows, false where a length is NaN
    iterations: int | NDArray[np.int32]
    residual: float | FloatArray  # largest |L − L_given| [m]
    # [m], before each iteration and after the last; converges quadratically; empty for many rows
    residual_history: tuple[float, ...] = ()
    # of the leg Jacobian with angles scaled to lengths, if it was asked for
    condition_number: float | FloatArray | None = None


@without_warnings
def forward_kinematics(
    platform: Platform,
    leg_length: FloatArray,
    position: FloatArray | None = None,
    orientation: FloatArray | None = None,
    tolerance: float = 1e-12,
    max_iterations: int = 50,
    *,
    conditioning: bool = False,
) -> ForwardKinematics:
    """Poses with given leg lengths, in the assembly mode of the guess; of one pose, or of the rows of a log.

    Newton's method for L(pose) = L_given with the leg Jacobian: J [δt; δφ] = L_given − L, t ← t + δt, R ← exp(δφ~) R;
    quadratic convergence near the solution (Merlet, Parallel Robots, 2006, chapter 4). Steps that do not reduce the
    residual are shortened, which makes the iteration robust for distant guesses. It never crosses a singular pose, so
    it stays in the assembly mode. Rows (…, n, 6) are found by compiled code, each along n from the one before: their
    poses are one continuous motion.

    Parameters
    ----------
    platform
        The geometry; its home pose is the guess by default.
    leg_length
        Leg lengths (6,) or (…, n, 6) [m]. A row with NaN has NaN for its pose.
    position, orientation
        Guess (3,) [m], (3,) [rad], for the first of the rows; the home pose by default.
    tolerance
        Largest error of a leg length, relative to the longest leg.
    max_iterations
        For one pose; rows take at most 30, then as many again from the pose before.
    conditioning
        Whether to compute condition numbers as well.

    Returns
    -------
    ForwardKinematics
        `position` (…, 3) [m], `orientation` (…, 3) [rad], `converged`, `iterations`, and the largest error of a leg
        length: `residual` [m]; of one pose `residual_history` [m], before each iteration and after the last;
        `condition_number` (…), of the leg Jacobian with angles scaled to lengths, if it was asked for.

    Raises
    ------
    NoPoseError
        No pose found near the guess; names the row. The error's `result` has the last iterate.
    OrientationError
        The guess or an iterate has a pitch of ±90°.
    InterfaceError
        Lengths or guess with a wrong shape or not finite, lengths ≤ 0, or an invalid tolerance.
    NotInstalledError
        Of rows: no compiled code came with the package, and it cannot be compiled.

    See Also
    --------
    leg_geometry, leg_jacobian, read_log

    Examples
    --------
    >>> pose = gs.forward_kinematics(gs.load_preset("liu2000"), [3.24, 3.25, 3.26, 3.25, 3.24, 3.25])
    >>> pose.position, pose.orientation, pose.residual
    >>> log = 3.2459 + 0.01 * np.sin(np.linspace(0, 6, 1000))[:, None] * [1, 1, 1, 1, 1, 0.9]
    >>> gs.forward_kinematics(gs.load_preset("liu2000"), log).position.shape
    (1000, 3)
    """
    if not 0 < tolerance <= 1e-3:
        raise InterfaceError("tolerance", f"is {tolerance!r}; expected in (0, 1e-3], for example 1e-12")
    if max_iterations < 0:
        raise InterfaceError("max_iterations", f"is {max_iterations!r}; expected at least 0")
    t = platform.home_position if position is None else position
    o = platform.home_orientation if orientation is None else orientation
    t = interface.checked_value(interface.BY_NAME["position"], t)
    o = interface.checked_value(interface.BY_NAME["orientation"], o)
    if np.ndim(leg_length) > 1:
        return _of_rows(platform, leg_length, np.concatenate([t, o]), tolerance, conditioning=conditioning)
    target = interface.checked_value(interface.BY_NAME["leg_length"], leg_length)
    if target.min() <= 0:
        raise InterfaceError("leg_length", f"is {target.tolist()} m; expected lengths > 0")
    R = matrix_from_orientation(o)
    o = nearest_angle(orientation_from_matrix(R), o)
    legs = leg_geometry(platform, t, o)
    J, error = jacobian_of_legs(legs), target - legs.length
    side = np.sign(np.linalg.det(J))
    history = [float(np.abs(error).max())]
    close = tolerance * float(target.max())

    while history[-1] > close:
        if len(history) > max_iterations:
            raise _no_pose(f"no convergence after {max_iterations} iterations", t, o, history)
        if not conditioning_of_legs(legs).condition_number < SINGULAR_CONDITION_NUMBER:
            raise _no_pose("the leg Jacobian is singular there", t, o, history)
        step = np.linalg.solve(J, error)
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
            J, error_next = jacobian_of_legs(legs), target - legs.length
            improves = np.linalg.norm(error_next) < (1 - 1e-4 * share) * np.linalg.norm(error)
            if improves and np.sign(np.linalg.det(J)) == side:
                break
            share /= 2
        else:
            raise _no_pose("no step reduces the length errors", t, o, history)
        t, R, o, error = t_next, R_next, o_next, error_next
        history.append(float(np.abs(error).max()))
    condition_number = float(conditioning_of_legs(legs).condition_number) if conditioning else None
    return ForwardKinematics(t, o, True, len(history) - 1, history[-1], tuple(history), condition_number)


def _of_rows(
    platform: Platform, leg_length: FloatArray, guess: FloatArray, tolerance: float, *, conditioning: bool
) -> ForwardKinematics:
    """Poses of rows (…, n, 6) by compiled code; those that it does not find by `forward_kinematics`, from the last."""
    from gough_stewart.model.stepping import stepper_library

    lengths = np.ascontiguousarray(leg_length, dtype=float)
    for row in np.argwhere((lengths <= 0) | np.isinf(lengths))[:1]:
        place = ", ".join(map(str, row[:-1]))
        raise InterfaceError("leg_length", f"is {lengths[*row]} m in row {place}; expected lengths > 0, or NaN")
    find = stepper_library(IDEAL).poses_of_lengths
    joints = [np.ascontiguousarray(points, dtype=float) for points in (platform.base_points, platform.platform_points)]
    places = [points.ctypes.data_as(c_void_p) for points in joints]
    pose, residual = np.empty_like(lengths), np.empty(lengths.shape[:-1])
    iterations = np.empty(lengths.shape[:-1], dtype=np.int32)
    size, start = c_double(platform.characteristic_length), guess.ctypes.data_as(c_void_p)
    for batch in np.ndindex(lengths.shape[:-2]):
        log, poses, errors = lengths[batch], pose[batch], residual[batch]
        arrays = (part.ctypes.data_as(c_void_p) for part in (log, poses, errors, iterations[batch]))
        if find(*places, size, start, c_double(tolerance), c_size_t(len(log)), *arrays) == 0:
            continue
        for k in np.flatnonzero(np.isnan(errors) & ~np.isnan(log).any(axis=1)):
            near = poses[k - 1] if k and not np.isnan(errors[k - 1]) else guess
            try:
                found = forward_kinematics(platform, log[k], near[:3], near[3:], tolerance)
            except NoPoseError as error:
                row = (*batch, int(k))
                raise NoPoseError(
                    f"row {', '.join(map(str, row))}, lengths {np.round(log[k], 6).tolist()} m: {error}",
                    error.result,
                    row,
                ) from error
            poses[k], errors[k] = np.concatenate([found.position, found.orientation]), found.residual
            iterations[batch][k] = found.iterations
    condition_number = None
    if conditioning:
        legs = leg_geometry(platform, pose[..., :3], pose[..., 3:])
        condition_number = np.where(np.isnan(residual), np.nan, conditioning_of_legs(legs).condition_number)
    return ForwardKinematics(
        pose[..., :3], pose[..., 3:], ~np.isnan(residual), iterations, residual, condition_number=condition_number
    )


def _no_pose(reason: str, t: FloatArray, o: FloatArray, history: list[float]) -> NoPoseError:
    result = ForwardKinematics(t, o, False, len(history) - 1, history[-1], tuple(history))
    return NoPoseError(
        f"no pose near this guess: {reason}; the largest length error is {history[-1]:.3g} m at position "
        f"{np.round(t, 6).tolist()} m, orientation {np.round(o, 6).tolist()} rad after {result.iterations} "
        "iterations; check the lengths or use a closer guess",
        result,
    )
