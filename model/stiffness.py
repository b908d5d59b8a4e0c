"""Stiffness of a platform on legs that give, and its natural frequencies; over any leading axes of poses, NumPy only.

With motors that hold, leg i is a spring k along its direction, so that a wrench w at Op moves the platform by the small
twist K⁻¹ w, K = k Jᵀ J. What gravity adds by turning the legs is left out: mg/L, a millionth of k.
"""

from typing import NamedTuple

import numpy as np

from gough_stewart.model.dynamics import mass_matrix
from gough_stewart.model.errors import PlatformError
from gough_stewart.model.kinematics import jacobian_of_legs, leg_geometry
from gough_stewart.model.machine_dynamics import platform_side
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.variant import Variant
from gough_stewart.model.vectors import Array, FloatArray, per_leg, transpose

_WITH_SPRINGS = Variant(springs=True)


class PoseStiffness(NamedTuple):
    """Stiffness and first mode at poses, each (...); 0 at singular poses."""

    translational_stiffness: FloatArray  # force at Op over displacement along it, in the softest direction [N/m]
    translational_stiffness_max: FloatArray  # in the stiffest [N/m]
    rotational_stiffness: FloatArray  # torque over rotation about it, about the softest axis [N m/rad]
    rotational_stiffness_max: FloatArray  # about the stiffest [N m/rad]
    first_mode: FloatArray  # lowest natural frequency with motors that hold [Hz]


def compliance(parameters: Parameters, position: Array, orientation: Array) -> Array:
    """Compliance K⁻¹ (..., 6, 6) of a platform whose motors hold: small twist [m, rad] per wrench at Op [N, N m].

    K⁻¹ = J⁻¹ J⁻ᵀ/k with the leg Jacobian J and k = `leg_stiffness`, in world components; position [m], orientation
    [rad] (..., 3).

    Returns
    -------
    ndarray
        (..., 6, 6), symmetric: blocks [m/N], [rad/N] = [1/N] and [rad/(N m)].

    Raises
    ------
    PlatformError
        Rigid legs, `leg_stiffness` is 0.

    Examples
    --------
    >>> soft = gs.load_preset("motion_base").with_parameters({"leg_stiffness": 2e7})
    >>> 1e6 * gs.compliance(soft, soft.home_position, soft.home_orientation)[2, 2]  # µm/N
    """
    k = _stiffness_of(parameters)
    J = jacobian_of_legs(leg_geometry(parameters, position, orientation))
    inverse = np.linalg.inv(J)
    return np.asarray(inverse @ transpose(inverse) / k[..., None])


def held_frequencies(parameters: Parameters, position: Array, orientation: Array) -> Array:
    """Natural frequencies (..., 6) [Hz] of the platform on its legs, motors held, lowest first; damping left out.

    det(k Jᵀ J − ω² M) = 0 with M without armature: ω² are eigenvalues of k J M⁻¹ Jᵀ; 0 where a leg has no direction.
    """
    k = _stiffness_of(parameters)
    J = jacobian_of_legs(leg_geometry(parameters, position, orientation))
    M = mass_matrix(platform_side(_WITH_SPRINGS, parameters), position, orientation)
    answer = np.nan_to_num(J @ np.linalg.solve(M, transpose(J)))
    squares = k * np.linalg.eigvalsh((answer + transpose(answer)) / 2)
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)) / (2 * np.pi))


def pose_stiffness(parameters: Parameters, position: Array, orientation: Array) -> PoseStiffness:
    """Stiffness in the softest and stiffest directions, and the first mode, at poses (..., 3) [m], [rad].

    In all other directions the platform is free to move: stiffness is the inverse of an eigenvalue of the 3×3 block of
    the compliance, λ(K⁻¹_tt) or λ(K⁻¹_rr).
    """
    k = _stiffness_of(parameters)[..., 0]
    J = np.asarray(jacobian_of_legs(leg_geometry(parameters, position, orientation)), dtype=float)
    regular = np.isfinite(J).all(axis=(-2, -1)) & (np.linalg.det(np.nan_to_num(J)) != 0)
    known = np.where(regular[..., None, None], J, np.eye(6))
    found = []
    with np.errstate(all="ignore"):
        inverse = np.linalg.inv(known)
        for rows in (inverse[..., :3, :], inverse[..., 3:, :]):
            sigma = np.linalg.svd(rows, compute_uv=False)
            found += [np.where(regular, k / sigma[..., edge] ** 2, 0.0) for edge in (0, -1)]
        frequency = np.where(regular, np.nan, 0.0)
        at = np.broadcast_arrays(np.asarray(position, float), np.asarray(orientation, float))
        frequency[regular] = held_frequencies(parameters, at[0][regular], at[1][regular])[..., 0]
    return PoseStiffness(found[0], found[1], found[2], found[3], frequency)


def _stiffness_of(parameters: Parameters) -> FloatArray:
    """The stiffness k of a leg (..., 1) [N/m]."""
    k = np.asarray(per_leg(parameters.leg_stiffness), dtype=float)
    if not (k > 0).all():
        raise PlatformError("leg_stiffness", "is 0, rigid legs, which have no stiffness; expected a number > 0 [N/m]")
    return k
