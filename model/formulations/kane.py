"""Kane's equations in Huston's form as in Liu, Li & Li (2000); equation numbers are those of the paper.

Each leg and the platform are substructures with their own generalized speeds,

    y_i = (ω_i, ṡ_i),  y_p = (ω_p, v_p),  y = (y_1, …, y_6, y_p), 30 numbers,            (6), (16), (30)

coupled by 24 velocity constraints with Lagrange multipliers: an index-1 DAE with 67 states, integrated by SciPy's RK45,
the Dormand–Prince pair of MATLAB's ode45, which the paper used. Written for verification, not for speed: the run-time
model is `gough_stewart.model.dynamics`, and neither module uses the other.

Frames of a leg: both local frames are parallel, x along u_i. The origin O_i,1 is at B_i and O_i,2 at P_i, so that
q_i = 0, s_i = (L_i, 0, 0), r_i,1 = (`leg_lower_com`, 0, 0) and r_i,2 = (−`leg_upper_com`, 0, 0). Everything below
is in world components already: r1 stands for R_i r_i,1, s + r2 for R_i (s_i + r_i,2), s + q for R_i (s_i + q_i).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from gough_stewart.model.errors import StepError
from gough_stewart.model.interface import Inputs, State
from gough_stewart.model.parameters import Parameters, of_legs
from gough_stewart.model.process.progress import TimeProgress
from gough_stewart.model.rotations import (
    matrix_from_orientation,
    matrix_from_quaternion,
    orientation_from_matrix,
    quaternion_rate,
)
from gough_stewart.model.vectors import Array, apply, cross, dot, outer, per_leg, skew


class Configuration(NamedTuple):
    """Positions of the substructures, which the paper integrates together with y."""

    leg_rotation: Array  # R_i (..., 6, 3, 3), leg frame to world; its first column is u_i
    slide: Array  # s_i (..., 6) [m], from O_i,1 to O_i,2 along u_i
    position: Array  # of Op in world (..., 3) [m]
    rotation: Array  # 0_R_p (..., 3, 3), platform to world


class KaneSolution(NamedTuple):
    """Solution of the augmented system."""

    acceleration: Array  # ẏ (..., 30)
    joint_force: Array  # λ of the closures (..., 6, 3) [N]: force of leg i on the platform at P_i

    @property
    def platform_acceleration(self) -> Array:
        """[v̇; ω̇] (..., 6) of the platform, in the order of the task-space dynamics."""
        return np.concatenate([self.acceleration[..., 27:], self.acceleration[..., 24:27]], axis=-1)


class Constraints(NamedTuple):
    """Φ_q y = 0: per leg three closure rows, then six spin rows; (24), (25), (27), (28)."""

    jacobian: Array  # Φ_q (..., 24, 30)
    jacobian_rate: Array  # Φ̇_q (..., 24, 30), so that Φ_q ẏ = −Φ̇_q y
    residual: Array  # Φ (..., 24): closure gaps [m]; 0 for the spin rows, which constrain a velocity only


def _leg_speeds(y: Array) -> tuple[Array, Array]:
    """ω_i (..., 6, 3) and ṡ_i (..., 6) from y; (6), (7)."""
    legs = y[..., :24].reshape(*y.shape[:-1], 6, 4)
    return legs[..., :3], legs[..., 3]


def _partial_velocity(arm: Array, slide_direction: Array | None) -> Array:
    """V = [−(arm)~ slide] (..., 3, 4) of a point of the leg at `arm` from B_i; (11), (12), (19).

    `slide_direction` is u_i for points of the upper part, None for the lower part. With it v_point = v y_i, which
    is (9), (10), (18).
    """
    column = np.zeros_like(arm) if slide_direction is None else slide_direction
    return np.concatenate([-skew(arm), column[..., None]], axis=-1)


def _partial_velocity_rate(arm: Array, omega: Array, u: Array, slide_rate: Array | None) -> Array:
    """v̇ = [(arm × ω_i − ṡ_i u_i)~  ω_i × u_i] (..., 3, 4), without ṡ_i and u_i of the lower part; (13), (14), (20)."""
    if slide_rate is None:
        return np.concatenate([skew(cross(arm, omega)), np.zeros_like(arm)[..., None]], axis=-1)
    turning = cross(arm, omega) - slide_rate[..., None] * u
    return np.concatenate([skew(turning), cross(omega, u)[..., None]], axis=-1)


def constraints(parameters: Parameters, configuration: Configuration, y: Array) -> Constraints:
    """The constraints and their rates.

    Closure v_P,i y_i − v_p,i y_p = 0 with v_P,i = [−(s + q)~ u] (19), v_p,i = [−(0_R_p r_p,i)~ 1] (22), whose gap is
    B_i + s_i u_i − (t + 0_R_p r_p,i); spin [u_iᵀ 0] y_i = 0. Their rates are by (20), (23) v̇_p,i = [(0_R_p r_p,i ×
    ω_p)~ 0], and (26) [(ω_i × u_i)ᵀ 0].
    """
    u, (omega, slide_rate), omega_p = configuration.leg_rotation[..., 0], _leg_speeds(y), y[..., None, 24:27]
    arm = apply(configuration.rotation[..., None, :, :], parameters.platform_points)
    along = configuration.slide[..., None] * u
    identity = np.broadcast_to(np.eye(3), (*arm.shape[:-1], 3, 3))
    matrices = []
    for of_leg, of_platform, spin in (
        (_partial_velocity(along, u), np.concatenate([-skew(arm), identity], axis=-1), u),
        (
            _partial_velocity_rate(along, omega, u, slide_rate),
            np.concatenate([skew(cross(arm, omega_p)), np.zeros_like(identity)], axis=-1),
            cross(omega, u),
        ),
    ):
        rows = np.zeros((*arm.shape[:-2], 24, 30))
        for i in range(6):
            rows[..., 3 * i : 3 * i + 3, 4 * i : 4 * i + 4] = of_leg[..., i, :, :]
            rows[..., 3 * i : 3 * i + 3, 24:30] = -of_platform[..., i, :, :]
            rows[..., 18 + i, 4 * i : 4 * i + 3] = spin[..., i, :]
        matrices.append(rows)
    gap = parameters.base_points + along - (configuration.position[..., None, :] + arm)
    gap = gap.reshape(*gap.shape[:-2], 18)
    residual = np.concatenate([gap, np.zeros((*gap.shape[:-1], 6))], axis=-1)
    return Constraints(matrices[0], matrices[1], residual)


def solve(
    parameters: Parameters,
    configuration: Configuration,
    y: Array,
    actuator_force: Array,
    external_wrench: Array | float = 0.0,
    baumgarte: tuple[float, float] = (0.0, 0.0),
    axial_inertia: float = 0.0,
) -> KaneSolution:
    """Accelerations and multipliers from the augmented 54×54 system; (30), (31).

    [[A, Φ_qᵀ], [Φ_q, 0]] [ẏ; λ] = [D; −Φ̇_q y − 2 α Φ_q y − β² Φ], under actuator forces (..., 6) [N] and a wrench at
    Op (..., 6) [N, N m]. Baumgarte's (α, β) [1/s]: the paper has "values between 1 and 20", (0, 0) is none. The inertia
    of leg parts about u [kg m²] has no influence on the motion.
    """
    u, (omega, slide_rate), g = configuration.leg_rotation[..., 0], _leg_speeds(y), parameters.gravity[..., None, :]
    K, D = np.zeros((*y.shape[:-1], 54, 54)), np.zeros((*y.shape[:-1], 54))

    # legs: A_i = Σ_k m_k v_kᵀ v_k + wᵀ J_k w,  D_i = f_i − b_i y_i,  f_i = Σ_k v_kᵀ F_k,
    # b_i = Σ_k m_k v_kᵀ v̇_k + wᵀ ω~ J_k w, over the lower (k = 1) and the upper part (k = 2); (15). F_k is weight, and
    # along u the actuator force less friction: −F + friction on the lower part, the opposite on the upper part. Rotor
    # and screw, which are not in the paper, rotate at 2π/lead · ṡ_i; reflected to ṡ_i, they are `leg_armature`.
    viscous, coulomb = (of_legs(parameters, f"leg_{kind}_friction") for kind in ("viscous", "coulomb"))
    sliding = viscous * slide_rate + coulomb * np.tanh(slide_rate / per_leg(parameters.leg_friction_velocity))
    push = (actuator_force - sliding)[..., None] * u
    r1 = of_legs(parameters, "leg_lower_com")[..., None] * u
    s_r2 = (configuration.slide - of_legs(parameters, "leg_upper_com"))[..., None] * u
    velocities = (
        (_partial_velocity(r1, None), _partial_velocity_rate(r1, omega, u, None), -push),
        (_partial_velocity(s_r2, u), _partial_velocity_rate(s_r2, omega, u, slide_rate), push),
    )
    w = np.eye(3, 4)  # of both parts, constant; (8a), (8b)
    A_legs, D_legs = np.zeros((*u.shape[:-1], 4, 4)), np.zeros((*u.shape[:-1], 4))
    for part, (v, dv, along) in zip(("lower", "upper"), velocities, strict=True):
        m, J_t = (of_legs(parameters, f"leg_{part}_{name}")[..., None] for name in ("mass", "inertia"))
        # R diag(J_x, J, J) Rᵀ = J 1 + (J_x − J) u uᵀ
        J = J_t[..., None] * np.eye(3) + (axial_inertia - J_t[..., None]) * outer(u, u)
        A_legs += m[..., None] * v.mT @ v + w.T @ J @ w
        b = m[..., None] * v.mT @ dv + w.T @ skew(omega) @ J @ w
        D_legs += apply(v.mT, m * g + along) - apply(b, np.concatenate([omega, slide_rate[..., None]], axis=-1))
    A_legs[..., 3, 3] += of_legs(parameters, "leg_armature")
    for i in range(6):
        K[..., 4 * i : 4 * i + 4, 4 * i : 4 * i + 4] = A_legs[..., i, :, :]
    D[..., :24] = D_legs.reshape(*D_legs.shape[:-2], 24)

    # platform: A_p = [[J_p − m r~ r~, m r~], [−m r~, m 1]],  D_p = [M_p − m r~ â − ω~ J_p ω; F_p − m â],
    # â = −g + ω×(ω×r), r = 0_R_p r_G; (17)
    omega_p, R, mass = y[..., 24:27], configuration.rotation, np.asarray(parameters.platform_mass)[..., None]
    r, J = apply(R, parameters.platform_com), R @ parameters.platform_inertia @ R.mT
    mr, a_hat = mass[..., None] * skew(r), cross(omega_p, cross(omega_p, r)) - parameters.gravity
    K[..., 24:27, 24:27], K[..., 24:27, 27:30] = J - mr @ skew(r), mr
    K[..., 27:30, 24:27], K[..., 27:30, 27:30] = -mr, mass[..., None] * np.eye(3)
    external = np.broadcast_to(external_wrench, (*omega_p.shape[:-1], 6))
    D[..., 24:27] = external[..., 3:] - apply(mr, a_hat) - cross(omega_p, apply(J, omega_p))
    D[..., 27:30] = external[..., :3] - mass * a_hat

    # constraints
    Phi_q, rate, residual = constraints(parameters, configuration, y)
    alpha, beta = baumgarte
    K[..., :30, 30:], K[..., 30:, :30] = Phi_q.mT, Phi_q
    D[..., 30:] = -apply(rate, y) - 2 * alpha * apply(Phi_q, y) - beta**2 * residual
    x = np.linalg.solve(K, D[..., None])[..., 0]
    return KaneSolution(x[..., :30], x[..., 30:48].reshape(*x.shape[:-1], 6, 3))


def consistent_start(parameters: Parameters, state: State) -> tuple[Configuration, Array]:
    """Configuration and speeds that satisfy all constraints for a pose and twist of the platform, each (..., 3).

    s_i u_i = t + 0_R_p r_p,i − B_i;  ṡ_i = u_i·v_P,  ω_i = u_i × v_P / s_i (no spin), from (18), (21), (24), (25).
    """
    position, rotation = state.position, matrix_from_orientation(state.orientation)
    velocity, angular_velocity = state.velocity, state.angular_velocity
    arm = apply(rotation[..., None, :, :], parameters.platform_points)
    l = position[..., None, :] + arm - parameters.base_points
    slide = np.sqrt(dot(l, l))
    u = l / slide[..., None]
    point_velocity = velocity[..., None, :] + cross(angular_velocity[..., None, :], arm)
    omega = cross(u, point_velocity) / slide[..., None]
    legs = np.concatenate([omega, dot(u, point_velocity)[..., None]], axis=-1)
    y = np.concatenate([legs.reshape(*legs.shape[:-2], 24), angular_velocity, velocity], axis=-1)
    # any frame with first column u: the angle about the leg is arbitrary, since legs do not spin
    across = cross(u, np.eye(3)[np.argmin(np.abs(u), axis=-1)])
    across = across / np.sqrt(dot(across, across))[..., None]
    return Configuration(np.stack([u, across, cross(u, across)], axis=-1), slide, position, rotation), y


@dataclass(frozen=True)
class KaneTrajectory:
    """Motion of all substructures at the output times; the leading axis is time."""

    time: Array  # (n,) [s]
    configuration: Configuration
    speeds: Array  # y (n, 30)
    joint_force: Array  # λ of the closures (n, 6, 3) [N]
    position_violation: Array  # largest closure gap |Φ| (n,) [m]
    velocity_violation: Array  # largest |Φ_q y| (n,) [m/s, rad/s]

    @property
    def platform(self) -> State:
        """Pose and twist of the platform, each (n, 3)."""
        orientation = orientation_from_matrix(self.configuration.rotation)
        return State(self.configuration.position, orientation, self.speeds[..., 27:], self.speeds[..., 24:27])


def integrate(
    parameters: Parameters,
    configuration: Configuration,
    speeds: Array,
    inputs: Inputs,
    time: Array,
    baumgarte: tuple[float, float] = (10.0, 10.0),
    rtol: float = 1e-10,
    own_steps: bool = False,
    progress: TimeProgress | None = None,
) -> KaneTrajectory:
    """Integrate eq. (31) under constant inputs from a configuration and speeds y (30,), consistent or not.

    States: six leg orientations and the platform's as quaternions (so that the paper's d(R)/dt = ω~ R, eq. (3), keeps
    R a rotation), six slides, the position of Op, and the 30 generalized speeds y. Output at increasing times (n,) [s],
    or at the integrator's own steps between the first and the last, which shows the drift of the constraints without
    interpolation errors. `rtol` is also the absolute tolerance in SI units. `StepError` if the integration failed.
    """
    wrench = np.concatenate([inputs.external_force, inputs.external_torque])
    legs, body = (Rotation.from_matrix(R).as_quat() for R in (configuration.leg_rotation, configuration.rotation))
    start = np.concatenate([legs.reshape(24), configuration.slide, configuration.position, body, speeds])

    def parts_of(x: Array) -> tuple[Configuration, Array]:
        legs = matrix_from_quaternion(x[..., :24].reshape(*x.shape[:-1], 6, 4))
        return Configuration(legs, x[..., 24:30], x[..., 30:33], matrix_from_quaternion(x[..., 33:37])), x[..., 37:]

    def derivative(t: float, x: Array) -> Array:
        if progress is not None:
            progress(t)
        at, y = parts_of(x)
        ydot = solve(parameters, at, y, inputs.actuator_force, wrench, baumgarte).acceleration
        omega, slide_rate = _leg_speeds(y)
        turning = quaternion_rate(x[:24].reshape(6, 4), omega).reshape(24)
        return np.concatenate([turning, slide_rate, y[27:], quaternion_rate(x[33:37], y[24:27]), ydot])

    solution = solve_ivp(
        derivative,
        (time[0], time[-1]),
        start,
        method="RK45",
        t_eval=None if own_steps else time,
        rtol=rtol,
        atol=rtol,
        # dense output has a lower order than the steps: keep the steps short
        max_step=np.inf if own_steps else float(np.diff(time).max()),
    )
    if not solution.success:
        raise StepError("Kane's DAE", float("nan"), float(solution.t[-1]), solution.message)
    configuration, y = parts_of(solution.y.T)
    Phi_q, _, gap = constraints(parameters, configuration, y)
    forces = solve(parameters, configuration, y, inputs.actuator_force, wrench, baumgarte).joint_force
    gaps, slips = np.abs(gap).max(axis=-1), np.abs(apply(Phi_q, y)).max(axis=-1)
    return KaneTrajectory(solution.t, configuration, y, forces, gaps, slips)
