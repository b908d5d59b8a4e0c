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
from gough_stewart.model.parameters import Parameters, of_legs
from gough_stewart.model.process.progress import TimeProgress
from gough_stewart.model.rotations import (
    matrix_from_orientation,
    matrix_from_quaternion,
    orientation_from_matrix,
    quaternion_rate,
)
from gough_stewart.model.state import Inputs, State
from gough_stewart.model.vectors import Array, apply, cross, dot, outer, per_leg, skew, transpose


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


def leg_speeds(y: Array) -> tuple[Array, Array]:
    """ω_i (..., 6, 3) and ṡ_i (..., 6) from y; (6), (7)."""
    legs = y[..., :24].reshape(*y.shape[:-1], 6, 4)
    return legs[..., :3], legs[..., 3]


def platform_speeds(y: Array) -> tuple[Array, Array]:
    """ω_p and v_p (..., 3) from y; (16)."""
    return y[..., 24:27], y[..., 27:]


# --- A. legs ---------------------------------------------------------------------------------------------------


def partial_velocity(arm: Array, slide_direction: Array | None) -> Array:
    """V = [−(arm)~ slide] (..., 3, 4) of a point of the leg at `arm` from B_i; (11), (12), (19).

    `slide_direction` is u_i for points of the upper part, None for the lower part. With it v_point = v y_i, which
    is (9), (10), (18).
    """
    column = np.zeros_like(arm) if slide_direction is None else slide_direction
    return np.concatenate([-skew(arm), column[..., None]], axis=-1)


def partial_velocity_rate(arm: Array, omega: Array, u: Array, slide_rate: Array | None) -> Array:
    """v̇ = [(arm × ω_i − ṡ_i u_i)~  ω_i × u_i] (..., 3, 4); (13), (14), (20), by d(R)/dt = ω~ R, (3).

    `slide_rate` is None for points of the lower part: [(arm × ω_i)~ 0].
    """
    if slide_rate is None:
        return np.concatenate([skew(cross(arm, omega)), np.zeros_like(arm)[..., None]], axis=-1)
    turning = cross(arm, omega) - slide_rate[..., None] * u
    return np.concatenate([skew(turning), cross(omega, u)[..., None]], axis=-1)


def leg_equations(
    parameters: Parameters, configuration: Configuration, y: Array, actuator_force: Array, axial_inertia: float = 0.0
) -> tuple[Array, Array]:
    """A_i (..., 6, 4, 4) and D_i (..., 6, 4) of A_i ẏ_i = D_i; (15).

    A_i = Σ_k m_k v_kᵀ v_k + wᵀ J_k w,  D_i = f_i − b_i y_i,  f_i = Σ_k v_kᵀ F_k,
    b_i = Σ_k m_k v_kᵀ v̇_k + wᵀ ω~ J_k w, over the lower (k = 1) and the upper part (k = 2).
    F_k is weight, and along u the actuator force less friction: −F + friction on the lower part, the opposite on
    the upper part. Rotor and screw, which are not in the paper, rotate at 2π/lead · ṡ_i; their inertia, reflected to
    ṡ_i, is `leg_armature`. `axial_inertia` [kg m²] of either part has no effect on the motion, by (25).
    """
    u, omega, slide_rate = _leg_axes(configuration), *leg_speeds(y)
    g = parameters.gravity[..., None, :]
    # of both parts, constant; (8a), (8b)
    w = np.eye(3, 4)
    viscous, coulomb = (of_legs(parameters, f"leg_{kind}_friction") for kind in ("viscous", "coulomb"))
    sliding = viscous * slide_rate + coulomb * np.tanh(slide_rate / per_leg(parameters.leg_friction_velocity))
    push = (actuator_force - sliding)[..., None] * u

    r1 = of_legs(parameters, "leg_lower_com")[..., None] * u
    s_r2 = (configuration.slide - of_legs(parameters, "leg_upper_com"))[..., None] * u
    v1, dv1 = partial_velocity(r1, None), partial_velocity_rate(r1, omega, u, None)
    v2, dv2 = partial_velocity(s_r2, u), partial_velocity_rate(s_r2, omega, u, slide_rate)
    m1, m2 = (of_legs(parameters, f"leg_{part}_mass")[..., None] for part in ("lower", "upper"))

    A = np.zeros((*u.shape[:-1], 4, 4))
    D = np.zeros((*u.shape[:-1], 4))
    parts = (
        (m1, v1, dv1, m1 * g - push, of_legs(parameters, "leg_lower_inertia")),
        (m2, v2, dv2, m2 * g + push, of_legs(parameters, "leg_upper_inertia")),
    )
    for m, v, dv, F, transverse_inertia in parts:
        # R diag(J_x, J, J) Rᵀ = J 1 + (J_x − J) u uᵀ
        J_t = transverse_inertia[..., None, None]
        J = J_t * np.eye(3) + (axial_inertia - J_t) * outer(u, u)
        A += m[..., None] * transpose(v) @ v + w.T @ J @ w
        b = m[..., None] * transpose(v) @ dv + w.T @ skew(omega) @ J @ w
        D += apply(transpose(v), F) - apply(b, np.concatenate([omega, slide_rate[..., None]], axis=-1))
    A[..., 3, 3] += of_legs(parameters, "leg_armature")
    return A, D


# --- B. platform -----------------------------------------------------------------------------------------------


def platform_equations(
    parameters: Parameters, configuration: Configuration, y: Array, external_wrench: Array | float = 0.0
) -> tuple[Array, Array]:
    """A_p (..., 6, 6) and D_p (..., 6) of A_p ẏ_p = D_p; (17).

    A_p = [[J_p − m r~ r~, m r~], [−m r~, m 1]],  D_p = [M_p − m r~ â − ω~ J_p ω; F_p − m â],
    â = −g + ω×(ω×r), r = 0_R_p r_G. `external_wrench` = [F_p; M_p] (..., 6) at Op.
    """
    omega, _ = platform_speeds(y)
    R = configuration.rotation
    r = apply(R, parameters.platform_com)
    m = np.asarray(parameters.platform_mass)[..., None]
    J = R @ parameters.platform_inertia @ transpose(R)
    mr = m[..., None] * skew(r)
    a_hat = cross(omega, cross(omega, r)) - parameters.gravity
    A = np.concatenate(
        [
            np.concatenate([J - mr @ skew(r), mr], axis=-1),
            np.concatenate([-mr, m[..., None] * np.broadcast_to(np.eye(3), mr.shape)], axis=-1),
        ],
        axis=-2,
    )
    external = np.broadcast_to(external_wrench, (*omega.shape[:-1], 6))
    torque = external[..., 3:] - apply(mr, a_hat) - cross(omega, apply(J, omega))
    return A, np.concatenate([torque, external[..., :3] - m * a_hat], axis=-1)


# --- C. constraints --------------------------------------------------------------------------------------------


def constraint_jacobian(parameters: Parameters, configuration: Configuration) -> Array:
    """Φ_q (..., 24, 30) with Φ_q y = 0: per leg three closure rows, then six spin rows; (24), (25), (27), (28).

    Closure v_P,i y_i − v_p,i y_p = 0 with v_P,i = [−(s + q)~ u] (19), v_p,i = [−(0_R_p r_p,i)~ 1] (22);
    spin [u_iᵀ 0] y_i = 0.
    """
    u = _leg_axes(configuration)
    of_leg = partial_velocity(configuration.slide[..., None] * u, u)
    arm = _platform_arms(parameters, configuration)
    identity = np.broadcast_to(np.eye(3), (*arm.shape[:-1], 3, 3))
    of_platform = np.concatenate([-skew(arm), identity], axis=-1)
    return _constraint_rows(of_leg, of_platform, u)


def constraint_jacobian_rate(parameters: Parameters, configuration: Configuration, y: Array) -> Array:
    """Φ̇_q (..., 24, 30), so that Φ_q ẏ = −Φ̇_q y; (29), by (20), (23) and (26).

    v̇_p,i = [(0_R_p r_p,i × ω_p)~ 0] (23); the spin rows' derivative is [(ω_i × u_i)ᵀ 0] (26).
    """
    u, (omega, slide_rate) = _leg_axes(configuration), leg_speeds(y)
    arm = _platform_arms(parameters, configuration)
    omega_p = platform_speeds(y)[0][..., None, :]
    of_leg = partial_velocity_rate(configuration.slide[..., None] * u, omega, u, slide_rate)
    of_platform = np.concatenate([skew(cross(arm, omega_p)), np.zeros((*arm.shape[:-1], 3, 3))], axis=-1)
    return _constraint_rows(of_leg, of_platform, cross(omega, u))


def constraint_residual(parameters: Parameters, configuration: Configuration) -> Array:
    """Φ (..., 24): closure gaps B_i + s_i u_i − (t + 0_R_p r_p,i) [m]; zero for the spin rows.

    The spin rows are nonholonomic in these coordinates: they constrain a velocity and have no position residual.
    """
    on_leg = parameters.base_points + configuration.slide[..., None] * _leg_axes(configuration)
    on_platform = configuration.position[..., None, :] + _platform_arms(parameters, configuration)
    gap = on_leg - on_platform
    gap = gap.reshape(*gap.shape[:-2], 18)
    return np.concatenate([gap, np.zeros((*gap.shape[:-1], 6))], axis=-1)


# --- D. system -------------------------------------------------------------------------------------------------


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

    [[A, Φ_qᵀ], [Φ_q, 0]] [ẏ; λ] = [D; −Φ̇_q y − 2 α Φ_q y − β² Φ].

    Parameters
    ----------
    actuator_force
        (..., 6) [N], positive extends the leg.
    external_wrench
        [force; torque about Op] (..., 6) on the platform in world components [N, N m].
    baumgarte
        (α, β) [1/s]; the paper: "usually equal to one another with values between 1 and 20". (0, 0) is none.
    axial_inertia
        About u of each leg part [kg m²]; has no influence on the motion.
    """
    A_legs, D_legs = leg_equations(parameters, configuration, y, actuator_force, axial_inertia)
    A_p, D_p = platform_equations(parameters, configuration, y, external_wrench)
    Phi_q = constraint_jacobian(parameters, configuration)
    alpha, beta = baumgarte
    gamma = (
        -apply(constraint_jacobian_rate(parameters, configuration, y), y)
        - 2 * alpha * apply(Phi_q, y)
        - beta**2 * constraint_residual(parameters, configuration)
    )
    K = np.zeros((*Phi_q.shape[:-2], 54, 54))
    for i in range(6):
        K[..., 4 * i : 4 * i + 4, 4 * i : 4 * i + 4] = A_legs[..., i, :, :]
    K[..., 24:30, 24:30] = A_p
    K[..., :30, 30:] = transpose(Phi_q)
    K[..., 30:, :30] = Phi_q
    D = np.concatenate([D_legs.reshape(*D_legs.shape[:-2], 24), D_p], axis=-1)
    x = np.linalg.solve(K, np.concatenate([D, gamma], axis=-1)[..., None])[..., 0]
    return KaneSolution(x[..., :30], x[..., 30:48].reshape(*x.shape[:-1], 6, 3))


def _leg_axes(configuration: Configuration) -> Array:
    """u_i (..., 6, 3), the x axes of the leg frames."""
    return configuration.leg_rotation[..., :, 0]


def _platform_arms(parameters: Parameters, configuration: Configuration) -> Array:
    """0_R_p r_p,i (..., 6, 3)."""
    return apply(configuration.rotation[..., None, :, :], parameters.platform_points)


def _constraint_rows(of_leg: Array, of_platform: Array, spin: Array) -> Array:
    """Closure rows [.. of_leg_i .. −of_platform_i] and spin rows [.. spin_iᵀ 0 .. 0] in one (..., 24, 30)."""
    rows = np.zeros((*of_leg.shape[:-3], 24, 30))
    for i in range(6):
        rows[..., 3 * i : 3 * i + 3, 4 * i : 4 * i + 4] = of_leg[..., i, :, :]
        rows[..., 3 * i : 3 * i + 3, 24:30] = -of_platform[..., i, :, :]
        rows[..., 18 + i, 4 * i : 4 * i + 3] = spin[..., i, :]
    return rows


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


# --- E. simulation -----------------------------------------------------------------------------------------------


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
        omega, velocity = platform_speeds(self.speeds)
        return State(self.configuration.position, orientation_from_matrix(self.configuration.rotation), velocity, omega)


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
    R a rotation), six slides, the position of Op, and the 30 generalized speeds y.

    Parameters
    ----------
    time
        Increasing output times (n,) [s], beginning with the start time.
    baumgarte
        (α, β) [1/s]; the paper takes both between 1 and 20.
    rtol
        Relative tolerance, and absolute tolerance in SI units.
    own_steps
        Output at the integrator's own steps between the first and the last time, which shows the drift
        of the constraints without interpolation errors.
    progress
        Called with the simulation time.

    Raises
    ------
    StepError
        The integration failed.
    """
    wrench = np.concatenate([inputs.external_force, inputs.external_torque])
    legs, body = (Rotation.from_matrix(R).as_quat() for R in (configuration.leg_rotation, configuration.rotation))
    start = np.concatenate([legs.reshape(24), configuration.slide, configuration.position, body, speeds])

    def derivative(t: float, x: Array) -> Array:
        if progress is not None:
            progress(t)
        configuration, y = _unpack(x)
        ydot = solve(parameters, configuration, y, inputs.actuator_force, wrench, baumgarte).acceleration
        omega, slide_rate = leg_speeds(y)
        omega_p, velocity = platform_speeds(y)
        turning = quaternion_rate(x[:24].reshape(6, 4), omega).reshape(24)
        return np.concatenate([turning, slide_rate, velocity, quaternion_rate(x[33:37], omega_p), ydot])

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
    configuration, y = _unpack(solution.y.T)
    forces = solve(parameters, configuration, y, inputs.actuator_force, wrench, baumgarte).joint_force
    gap = constraint_residual(parameters, configuration)
    slip = apply(constraint_jacobian(parameters, configuration), y)
    return KaneTrajectory(
        time=solution.t,
        configuration=configuration,
        speeds=y,
        joint_force=forces,
        position_violation=np.abs(gap).max(axis=-1),
        velocity_violation=np.abs(slip).max(axis=-1),
    )


def _unpack(x: Array) -> tuple[Configuration, Array]:
    legs = matrix_from_quaternion(x[..., :24].reshape(*x.shape[:-1], 6, 4))
    configuration = Configuration(legs, x[..., 24:30], x[..., 30:33], matrix_from_quaternion(x[..., 33:37]))
    return configuration, x[..., 37:]
