"""Newton–Euler check: thirteen free bodies with all constraint forces as unknowns, a linear system of size 150.

Derived from free-body diagrams; shares only the parameters with the task-space dynamics and with Kane's
equations. Unknowns per leg (24): accelerations of the centres of mass G1, G2 and angular accelerations of both
parts, joint force at B, torque along u in the universal joint, guide force across u (2), guide moment about G2,
joint force at P. For the platform (6): acceleration of G and angular acceleration. Balance of force and moment
gives 13·6 = 78 equations, the joints 12 per leg.
"""

from typing import NamedTuple

import numpy as np

from gough_stewart.model.parameters import Parameters
from gough_stewart.model.vectors import Array

# Columns of one leg's 24 unknowns.
_A1, _ALPHA1, _A2, _ALPHA2 = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
_F_B, _T_SPIN, _N, _M_GUIDE, _F_P = slice(12, 15), 15, slice(16, 18), slice(18, 21), slice(21, 24)
_A_G, _ALPHA_P = slice(144, 147), slice(147, 150)


class Solution(NamedTuple):
    """Accelerations of the platform frame and all constraint forces, world components."""

    linear: Array  # v̇ of Op (..., 3) [m/s2]
    angular: Array  # ω̇ (..., 3) [rad/s2]
    base_force: Array  # of the base on the leg at B_i (..., 6, 3) [N]
    spin_torque: Array  # of the base on the leg, along u_i (..., 6) [N m]
    guide_force: Array  # of the lower on the upper part, across u_i (..., 6, 3) [N]
    guide_moment: Array  # of the lower on the upper part, about G2 (..., 6, 3) [N m]
    joint_force: Array  # of the leg on the platform at P_i (..., 6, 3) [N]


def solve(
    parameters: Parameters,
    position: Array,
    rotation: Array,
    velocity: Array,
    angular_velocity: Array,
    actuator_force: Array,
    external_force: Array,
    external_torque: Array,
    axial_inertia: float = 0.0,
) -> Solution:
    """Accelerations and constraint forces by force and moment balance of every body.

    Position, velocity, angular velocity, external force and torque at Op (..., 3), rotation from platform to
    world (..., 3, 3), actuator forces (..., 6); SI units. `axial_inertia` [kg m²] is that of each leg part about u.
    """
    legs = _leg_bodies(parameters, position, rotation, velocity, angular_velocity, actuator_force, axial_inertia)
    r_G = np.einsum("...ab,...b->...a", rotation, parameters.platform_com)
    block, on_platform, right = _leg_equations(legs, r_G, angular_velocity, parameters.gravity)

    # The platform's balance about G takes f_P at P_i and the external wrench at Op.
    n, one = position.shape[:-1], np.eye(3)
    m = np.broadcast_to(parameters.platform_mass, n)[..., None]
    J = rotation @ parameters.platform_inertia @ np.swapaxes(rotation, -1, -2)
    K, k = np.zeros((*n, 150, 150)), np.zeros((*n, 150))
    for i in range(6):
        rows, joint = slice(24 * i, 24 * i + 24), slice(24 * i + 21, 24 * i + 24)
        K[..., rows, rows], K[..., rows, 144:150] = block[..., i, :, :], on_platform[..., i, :, :]
        k[..., rows] = right[..., i, :]
        K[..., _A_G, joint] = -one
        K[..., _ALPHA_P, joint] = -_tilde(legs.arm[..., i, :] - r_G)
    K[..., _A_G, _A_G] = m[..., None] * one
    K[..., _ALPHA_P, _ALPHA_P] = J
    k[..., _A_G] = m * parameters.gravity + external_force
    k[..., _ALPHA_P] = external_torque - np.cross(r_G, external_force) - _gyroscopic(J, angular_velocity)

    x = np.linalg.solve(K, k[..., None])[..., 0]
    of_legs, alpha = x[..., :144].reshape((*n, 6, 24)), x[..., _ALPHA_P]
    return Solution(
        linear=x[..., _A_G] - np.cross(alpha, r_G) - _centripetal(angular_velocity, r_G),
        angular=alpha,
        base_force=of_legs[..., _F_B],
        spin_torque=of_legs[..., _T_SPIN],
        guide_force=(legs.across @ of_legs[..., _N, None])[..., 0],
        guide_moment=of_legs[..., _M_GUIDE],
        joint_force=of_legs[..., _F_P],
    )


class _Legs(NamedTuple):
    """Free bodies of the legs; leading axes (..., 6)."""

    arm: Array  # Op to P (3,)
    axis: Array  # u (3,)
    across: Array  # two unit vectors across u, as columns (3, 2)
    turning: Array  # ω of both parts (3,)
    sliding: Array  # L̇
    G1_B: Array  # arms between centres of mass and joints (3,)
    G1_G2: Array
    G2_P: Array
    m1: Array
    m2: Array
    J1: Array  # about G1, G2, world components (3, 3)
    J2: Array
    armature: Array  # rotor and screw, as a mass along u
    push: Array  # actuator force less friction, on the upper part (3,)


def _leg_bodies(
    parameters: Parameters,
    position: Array,
    rotation: Array,
    velocity: Array,
    angular_velocity: Array,
    actuator_force: Array,
    axial_inertia: float,
) -> _Legs:
    def each(value: object) -> Array:
        return np.broadcast_to(np.asarray(value)[..., None], (*position.shape[:-1], 6))

    arm = np.einsum("...ab,...ib->...ia", rotation, parameters.platform_points)
    l = position[..., None, :] + arm - parameters.base_points
    L = np.linalg.norm(l, axis=-1)
    u = l / L[..., None]
    v_P = velocity[..., None, :] + np.cross(angular_velocity[..., None, :], arm)
    sliding = np.einsum("...ia,...ia->...i", u, v_P)
    e1 = np.cross(u, np.eye(3)[np.argmin(np.abs(u), axis=-1)])
    e1 = e1 / np.linalg.norm(e1, axis=-1, keepdims=True)
    G1 = each(parameters.leg_lower_com)[..., None] * u  # from B
    G2 = (L - each(parameters.leg_upper_com))[..., None] * u
    coulomb = each(parameters.leg_coulomb_friction) * np.tanh(sliding / each(parameters.leg_friction_velocity))
    resistance = (
        parameters.leg_viscous_friction_factor * each(parameters.leg_viscous_friction) * sliding
        + parameters.leg_coulomb_friction_factor * coulomb
    )
    return _Legs(
        arm=arm,
        axis=u,
        across=np.stack([e1, np.cross(u, e1)], axis=-1),
        turning=np.cross(u, v_P) / L[..., None],
        sliding=sliding,
        G1_B=-G1,
        G1_G2=G2 - G1,
        G2_P=l - G2,
        m1=each(parameters.leg_lower_mass),
        m2=each(parameters.leg_upper_mass),
        J1=_slender_inertia(each(parameters.leg_lower_inertia), axial_inertia, u),
        J2=_slender_inertia(each(parameters.leg_upper_inertia), axial_inertia, u),
        armature=each(parameters.leg_armature),
        push=(actuator_force - resistance)[..., None] * u,
    )


def _leg_equations(legs: _Legs, r_G: Array, omega_p: Array, gravity: Array) -> tuple[Array, Array, Array]:
    """Coefficients of a leg's own unknowns (24×24) and of the platform's (24×6), and the right-hand side (24)."""
    n, one, w, g = legs.sliding.shape, np.eye(3), legs.turning, gravity[..., None, :]
    own, platform, right = np.zeros((*n, 24, 24)), np.zeros((*n, 24, 6)), np.zeros((*n, 24))
    m1, m2 = legs.m1[..., None], legs.m2[..., None]
    onto = np.swapaxes(legs.across, -1, -2)
    # lower part, forces: m1 a1 = f_B − N − push + m1 g
    own[..., 0:3, _A1] = m1[..., None] * one
    own[..., 0:3, _F_B] = -one
    own[..., 0:3, _N] = legs.across
    right[..., 0:3] = m1 * g - legs.push
    # lower part, moments about G1: J1 α1 + ω×J1ω = (B − G1)×f_B + τ u − M − (G2 − G1)×N
    own[..., 3:6, _ALPHA1] = legs.J1
    own[..., 3:6, _F_B] = -_tilde(legs.G1_B)
    own[..., 3:6, _T_SPIN] = -legs.axis
    own[..., 3:6, _M_GUIDE] = one
    own[..., 3:6, _N] = _tilde(legs.G1_G2) @ legs.across
    right[..., 3:6] = -_gyroscopic(legs.J1, w)
    # upper part, forces: m2 a2 = N + push − f_P + m2 g
    own[..., 6:9, _A2] = m2[..., None] * one
    own[..., 6:9, _N] = -legs.across
    own[..., 6:9, _F_P] = one
    right[..., 6:9] = m2 * g + legs.push
    # upper part, moments about G2: J2 α2 + ω×J2ω = M − (P − G2)×f_P
    own[..., 9:12, _ALPHA2] = legs.J2
    own[..., 9:12, _M_GUIDE] = -one
    own[..., 9:12, _F_P] = _tilde(legs.G2_P)
    right[..., 9:12] = -_gyroscopic(legs.J2, w)
    # universal joint: B is fixed; no spin acceleration, d/dt (u·ω) = u·α + (ω×u)·ω = u·α
    own[..., 12:15, _A1] = one
    own[..., 12:15, _ALPHA1] = -_tilde(legs.G1_B)
    right[..., 12:15] = -_centripetal(w, legs.G1_B)
    own[..., 15, _ALPHA1] = legs.axis
    # guide: the parts rotate together; across u, G2 moves with the lower part, with Coriolis term 2 ω×(L̇ u)
    own[..., 16:19, _ALPHA2] = one
    own[..., 16:19, _ALPHA1] = -one
    own[..., 19:21, _A2] = onto
    own[..., 19:21, _A1] = -onto
    own[..., 19:21, _ALPHA1] = onto @ _tilde(legs.G1_G2)
    relative = _centripetal(w, legs.G1_G2) + 2 * legs.sliding[..., None] * np.cross(w, legs.axis)
    right[..., 19:21] = (onto @ relative[..., None])[..., 0]
    # rotor and screw rotate with the slide: the force that accelerates them, m_a L̈ along u, reduces the push on both;
    # L̈ = u·(a2 − a1 − relative), since α×(G2 − G1) has no component along u
    reflected = legs.armature[..., None, None] * legs.axis[..., :, None] * legs.axis[..., None, :]
    missing = (reflected @ relative[..., None])[..., 0]
    for rows, sign in ((slice(0, 3), -1), (slice(6, 9), 1)):
        own[..., rows, _A2] += sign * reflected
        own[..., rows, _A1] -= sign * reflected
        right[..., rows] += sign * missing
    # spherical joint: P of the leg moves with P of the platform
    G_P = legs.arm - r_G[..., None, :]
    own[..., 21:24, _A2] = one
    own[..., 21:24, _ALPHA2] = -_tilde(legs.G2_P)
    platform[..., 21:24, 0:3] = -one
    platform[..., 21:24, 3:6] = _tilde(G_P)
    right[..., 21:24] = _centripetal(omega_p[..., None, :], G_P) - _centripetal(w, legs.G2_P)
    return own, platform, right


def _tilde(a: Array) -> Array:
    """Matrix of a×: column j is a×e_j."""
    return np.cross(a[..., None, :], np.eye(3)).swapaxes(-1, -2)


def _gyroscopic(J: Array, omega: Array) -> Array:
    return np.cross(omega, (J @ omega[..., None])[..., 0])


def _centripetal(omega: Array, arm: Array) -> Array:
    return np.cross(omega, np.cross(omega, arm))


def _slender_inertia(transverse: Array, axial: float, u: Array) -> Array:
    """J 1 + (J_x − J) u uᵀ (..., 6, 3, 3)."""
    J = transverse[..., None, None]
    return np.asarray(J * np.eye(3) + (axial - J) * u[..., :, None] * u[..., None, :])
