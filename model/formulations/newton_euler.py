"""Newton–Euler check: thirteen free bodies with all constraint forces as unknowns, a linear system of size 150.

Derived from free-body diagrams; shares only the parameters and the vector algebra with the task-space dynamics and with
Kane's equations. Unknowns per leg (24): accelerations of the centres of mass G1, G2 and angular accelerations of both
parts, joint force at B, torque along u in the universal joint, guide force across u (2), guide moment about G2,
joint force at P. For the platform (6): acceleration of G and angular acceleration. Balance of force and moment
gives 13·6 = 78 equations, the joints 12 per leg.
"""

from typing import NamedTuple

import numpy as np

from gough_stewart.model.parameters import Parameters, of_legs
from gough_stewart.model.vectors import Array, apply, centripetal, cross, dot, outer, per_leg, skew

# Columns of one leg's 24 unknowns.
_A1, _ALPHA1, _A2, _ALPHA2 = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
_F_B, _T_SPIN, _N, _M_GUIDE, _F_P = slice(12, 15), 15, slice(16, 18), slice(18, 21), slice(21, 24)
_A_G, _ALPHA_P = slice(144, 147), slice(147, 150)


class NewtonEulerSolution(NamedTuple):
    """Accelerations of the platform frame and forces in its joints, world components."""

    linear: Array  # v̇ of Op (..., 3) [m/s2]
    angular: Array  # ω̇ (..., 3) [rad/s2]
    joint_force: Array  # of the leg on the platform at P_i (..., 6, 3) [N]


def solve(  # noqa: PLR0915 – bodies, joints and platform, in the order of the equations
    parameters: Parameters,
    position: Array,
    rotation: Array,
    velocity: Array,
    angular_velocity: Array,
    actuator_force: Array,
    external_force: Array,
    external_torque: Array,
    axial_inertia: float = 0.0,
) -> NewtonEulerSolution:
    """Accelerations and joint forces by force and moment balance of every body.

    Position, velocity, angular velocity, external force and torque at Op (..., 3), rotation from platform to
    world (..., 3, 3), actuator forces (..., 6); SI units. `axial_inertia` [kg m²] is that of each leg part about u.
    """
    p, n, identity, omega, g = parameters, position.shape[:-1], np.eye(3), angular_velocity, parameters.gravity
    # legs: arms between centres of mass and joints, turning of both parts, sliding, forces along u
    arm = apply(rotation[..., None, :, :], p.platform_points)
    l = position[..., None, :] + arm - p.base_points
    L = np.sqrt(dot(l, l))
    u = l / L[..., None]
    v_P = velocity[..., None, :] + cross(omega[..., None, :], arm)
    w, sliding = cross(u, v_P) / L[..., None], dot(u, v_P)
    e1 = np.cross(u, identity[np.argmin(np.abs(u), axis=-1)])
    e1 = e1 / np.linalg.norm(e1, axis=-1, keepdims=True)
    across = np.stack([e1, cross(u, e1)], axis=-1)  # two unit vectors across u, as columns
    onto = across.mT
    G1 = of_legs(p, "leg_lower_com")[..., None] * u  # from B
    G2 = (L - of_legs(p, "leg_upper_com"))[..., None] * u
    G1_B, G1_G2, G2_P = -G1, G2 - G1, l - G2
    m1, m2 = (of_legs(p, f"leg_{part}_mass")[..., None] for part in ("lower", "upper"))
    J1, J2 = (
        J[..., None, None] * identity + (axial_inertia - J[..., None, None]) * outer(u, u)
        for J in (of_legs(p, "leg_lower_inertia"), of_legs(p, "leg_upper_inertia"))
    )
    coulomb = of_legs(p, "leg_coulomb_friction") * np.tanh(sliding / per_leg(p.leg_friction_velocity))
    friction = of_legs(p, "leg_viscous_friction") * sliding + coulomb
    push = (actuator_force - friction)[..., None] * u

    # coefficients of a leg's unknowns (24×24) and of the platform's (24×6), and the right-hand side (24)
    block, on_platform, right = np.zeros((*n, 6, 24, 24)), np.zeros((*n, 6, 24, 6)), np.zeros((*n, 6, 24))
    # lower part, forces: m1 a1 = f_B − N − push + m1 g
    block[..., 0:3, _A1] = m1[..., None] * identity
    block[..., 0:3, _F_B] = -identity
    block[..., 0:3, _N] = across
    right[..., 0:3] = m1 * g[..., None, :] - push
    # lower part, moments about G1: J1 α1 + ω×J1ω = (B − G1)×f_B + τ u − M − (G2 − G1)×N
    block[..., 3:6, _ALPHA1] = J1
    block[..., 3:6, _F_B] = -skew(G1_B)
    block[..., 3:6, _T_SPIN] = -u
    block[..., 3:6, _M_GUIDE] = identity
    block[..., 3:6, _N] = skew(G1_G2) @ across
    right[..., 3:6] = -cross(w, apply(J1, w))
    # upper part, forces: m2 a2 = N + push − f_P + m2 g
    block[..., 6:9, _A2] = m2[..., None] * identity
    block[..., 6:9, _N] = -across
    block[..., 6:9, _F_P] = identity
    right[..., 6:9] = m2 * g[..., None, :] + push
    # upper part, moments about G2: J2 α2 + ω×J2ω = M − (P − G2)×f_P
    block[..., 9:12, _ALPHA2] = J2
    block[..., 9:12, _M_GUIDE] = -identity
    block[..., 9:12, _F_P] = skew(G2_P)
    right[..., 9:12] = -cross(w, apply(J2, w))
    # universal joint: B is fixed; no spin acceleration, d/dt (u·ω) = u·α + (ω×u)·ω = u·α
    block[..., 12:15, _A1] = identity
    block[..., 12:15, _ALPHA1] = -skew(G1_B)
    right[..., 12:15] = -centripetal(w, G1_B)
    block[..., 15, _ALPHA1] = u
    # guide: the parts rotate together; across u, G2 moves with the lower part, with Coriolis term 2 ω×(L̇ u)
    block[..., 16:19, _ALPHA2] = identity
    block[..., 16:19, _ALPHA1] = -identity
    block[..., 19:21, _A2] = onto
    block[..., 19:21, _A1] = -onto
    block[..., 19:21, _ALPHA1] = onto @ skew(G1_G2)
    relative = centripetal(w, G1_G2) + 2 * sliding[..., None] * cross(w, u)
    right[..., 19:21] = apply(onto, relative)
    # rotor and screw rotate with the slide: the force that accelerates them, m_a L̈ along u, reduces the push on both;
    # L̈ = u·(a2 − a1 − relative), since α×(G2 − G1) has no component along u
    reflected = of_legs(p, "leg_armature")[..., None, None] * outer(u, u)
    for rows, sign in ((slice(0, 3), -1), (slice(6, 9), 1)):
        block[..., rows, _A2] += sign * reflected
        block[..., rows, _A1] -= sign * reflected
        right[..., rows] += sign * apply(reflected, relative)
    # spherical joint: P of the leg moves with P of the platform
    r_G = apply(rotation, p.platform_com)
    G_P = arm - r_G[..., None, :]
    block[..., 21:24, _A2] = identity
    block[..., 21:24, _ALPHA2] = -skew(G2_P)
    on_platform[..., 21:24, 0:3] = -identity
    on_platform[..., 21:24, 3:6] = skew(G_P)
    right[..., 21:24] = centripetal(omega[..., None, :], G_P) - centripetal(w, G2_P)

    # the platform's balance about G takes f_P at P_i and the external wrench at Op
    m = np.broadcast_to(p.platform_mass, n)[..., None]
    J = rotation @ p.platform_inertia @ rotation.mT
    K, k = np.zeros((*n, 150, 150)), np.zeros((*n, 150))
    for i in range(6):
        rows, joint = slice(24 * i, 24 * i + 24), slice(24 * i + 21, 24 * i + 24)
        K[..., rows, rows], K[..., rows, 144:150] = block[..., i, :, :], on_platform[..., i, :, :]
        k[..., rows] = right[..., i, :]
        K[..., _A_G, joint] = -identity
        K[..., _ALPHA_P, joint] = -skew(G_P[..., i, :])
    K[..., _A_G, _A_G] = m[..., None] * identity
    K[..., _ALPHA_P, _ALPHA_P] = J
    k[..., _A_G] = m * g + external_force
    k[..., _ALPHA_P] = external_torque - np.cross(r_G, external_force) - cross(omega, apply(J, omega))

    x = np.linalg.solve(K, k[..., None])[..., 0]
    alpha = x[..., _ALPHA_P]
    return NewtonEulerSolution(
        linear=x[..., _A_G] - cross(alpha, r_G) - centripetal(omega, r_G),
        angular=alpha,
        joint_force=x[..., :144].reshape((*n, 6, 24))[..., _F_P],
    )
