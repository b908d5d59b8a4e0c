"""The paper's simulation: Kane's equations as an index-1 DAE with 67 states, integrated by SciPy's RK45.

States: six leg orientations and the platform's as quaternions (so that the paper's d(R)/dt = ω~ R, eq. (3), keeps
R a rotation), six slides, the position of Op, and the 30 generalized speeds y. RK45 is the Dormand–Prince pair
of MATLAB's ode45, which the paper used.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from gough_stewart.model.errors import StepError
from gough_stewart.model.formulations import kane
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.process.progress import TimeProgress
from gough_stewart.model.rotations import (
    matrix_from_orientation,
    matrix_from_quaternion,
    orientation_from_matrix,
    quaternion_rate,
)
from gough_stewart.model.state import Inputs, State
from gough_stewart.model.vectors import Array, apply

N_STATES = 67


@dataclass(frozen=True)
class KaneTrajectory:
    """Motion of all substructures at the output times; the leading axis is time."""

    time: Array  # (n,) [s]
    configuration: kane.Configuration
    speeds: Array  # y (n, 30)
    joint_force: Array  # λ of the closures (n, 6, 3) [N]
    position_violation: Array  # largest closure gap |Φ| (n,) [m]
    velocity_violation: Array  # largest |Φ_q y| (n,) [m/s, rad/s]
    evaluations: int

    @property
    def platform(self) -> State:
        """Pose and twist of the platform, each (n, 3)."""
        omega, velocity = kane.platform_speeds(self.speeds)
        return State(self.configuration.position, orientation_from_matrix(self.configuration.rotation), velocity, omega)


def simulate(
    parameters: Parameters,
    start: State,
    inputs: Inputs,
    time: Array,
    baumgarte: tuple[float, float] = (10.0, 10.0),
    rtol: float = 1e-10,
    own_steps: bool = False,
    progress: TimeProgress | None = None,
) -> KaneTrajectory:
    """Integrate eq. (31) from the pose and twist of the platform, (3,) arrays; see `integrate`."""
    R = matrix_from_orientation(start.orientation)
    consistent = kane.consistent_start(parameters, start.position, R, start.velocity, start.angular_velocity)
    return integrate(parameters, *consistent, inputs, time, baumgarte, rtol, own_steps, progress)


def integrate(
    parameters: Parameters,
    configuration: kane.Configuration,
    speeds: Array,
    inputs: Inputs,
    time: Array,
    baumgarte: tuple[float, float] = (10.0, 10.0),
    rtol: float = 1e-10,
    own_steps: bool = False,
    progress: TimeProgress | None = None,
) -> KaneTrajectory:
    """Integrate eq. (31) under constant inputs from a configuration and speeds y (30,), consistent or not.

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

    def derivative(t: float, x: Array) -> Array:
        if progress is not None:
            progress(t)
        configuration, y = _unpack(x)
        ydot = kane.solve(parameters, configuration, y, inputs.actuator_force, wrench, baumgarte).acceleration
        omega, slide_rate = kane.leg_speeds(y)
        omega_p, velocity = kane.platform_speeds(y)
        turning = quaternion_rate(x[:24].reshape(6, 4), omega).reshape(24)
        return np.concatenate([turning, slide_rate, velocity, quaternion_rate(x[33:37], omega_p), ydot])

    solution = solve_ivp(
        derivative,
        (time[0], time[-1]),
        _pack(configuration, speeds),
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
    forces = kane.solve(parameters, configuration, y, inputs.actuator_force, wrench, baumgarte).joint_force
    gap = kane.constraint_residual(parameters, configuration)
    slip = apply(kane.constraint_jacobian(parameters, configuration), y)
    return KaneTrajectory(
        time=solution.t,
        configuration=configuration,
        speeds=y,
        joint_force=forces,
        position_violation=np.abs(gap).max(axis=-1),
        velocity_violation=np.abs(slip).max(axis=-1),
        evaluations=int(solution.nfev),
    )


def _pack(configuration: kane.Configuration, y: Array) -> Array:
    legs = Rotation.from_matrix(configuration.leg_rotation).as_quat().reshape(24)
    platform = Rotation.from_matrix(configuration.rotation).as_quat()
    return np.concatenate([legs, configuration.slide, configuration.position, platform, y])


def _unpack(x: Array) -> tuple[kane.Configuration, Array]:
    legs = matrix_from_quaternion(x[..., :24].reshape(*x.shape[:-1], 6, 4))
    configuration = kane.Configuration(legs, x[..., 24:30], x[..., 30:33], matrix_from_quaternion(x[..., 33:37]))
    return configuration, x[..., 37:]
