"""Linear controllers of many platforms in one loop: their starts, and the linear theory of noise."""

from dataclasses import replace

import control
import numpy as np
from numpy.random import SeedSequence
from scipy.linalg import solve_discrete_lyapunov

from gough_stewart.harness.control.laws import LinearController
from gough_stewart.harness.control.laws_of_members import laws_of
from gough_stewart.harness.control.linear import linearise
from gough_stewart.harness.control.pid import channel_matrices, channels_of, gains_from_bandwidth
from gough_stewart.harness.control.state_space import discretised
from gough_stewart.harness.loop.loop import Actuators, Loop, Sensors
from gough_stewart.harness.loop.rows import Observer, RowBlock
from gough_stewart.harness.loop.run import observe
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.motion.limits.reach import legs_of
from gough_stewart.harness.motion.motion import Motion
from gough_stewart.harness.plants.lanes import LanesPlant
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import State
from tests.support.uneven import UNEVEN

T = 0.002
REST = np.zeros(3)


def platform_of(k: int) -> Platform:
    """Member k: another payload, friction and geometry."""
    rng = np.random.default_rng([3, k])
    return replace(
        UNEVEN,
        platform_mass=UNEVEN.platform_mass * (1 + 0.05 * k),
        platform_com=UNEVEN.platform_com + 0.01 * rng.normal(size=3),
        leg_viscous_friction=7.0 + k,
        base_points=UNEVEN.base_points + 1e-3 * rng.normal(size=(6, 3)),
    )


def slowed(k: int) -> LinearController:
    """Of member k, with a low-pass of 5 Hz after it: its integrators feed other states."""
    gains = gains_from_bandwidth(platform_of(k), 4.0 + 0.2 * k, 0.7, "leg", integral_time=0.5)
    system = discretised(channel_matrices(channels_of(gains), "error"), T)
    pole = np.exp(-2 * np.pi * 5 * T)
    filters = control.ss(pole * np.eye(6), (1 - pole) * np.eye(6), np.eye(6), np.zeros((6, 6)), T)
    return LinearController(control.series(control.ss(system.A, system.B, system.C, system.D, T), filters))


def test_each_controller_starts_at_rest_under_its_own_error() -> None:
    """Expected: the bits of each member alone, where integrators feed filters and each member starts off its path."""
    controllers, nowhere = [slowed(k) for k in (4, 0, 7)], np.zeros((0, 6, 6))
    reference, measured = np.random.default_rng(5).normal(1.0, 0.01, (2, 3, 30))
    many = laws_of(controllers, T, nowhere)(reference, measured[:, :24])
    for k, controller in enumerate(controllers):
        alone = laws_of([controller], T, nowhere)(reference[k : k + 1], measured[k : k + 1, :24])
        assert alone.state.any()
        assert alone.state[0].tobytes() == np.ascontiguousarray(many.state[k]).tobytes()


class Last(Observer):
    """Keeps the signals of the last row."""

    def block(self, rows: RowBlock) -> None:
        self.signals = rows.signals[rows.count].T.copy()


def test_the_response_to_white_noise_has_the_covariance_of_the_lyapunov_equation() -> None:
    """Expected: P = Φ P Φᵀ + σ² Γ Γᵀ of the linear loop, plant, controller and a delay of one sample.

    Of N independent Gaussian members the covariance S has the standard error √((P_ij² + P_ii P_jj)/N), the mean
    √(P_ii/N). Of 78 and 12 numbers none is farther off than 4.5 of them, which chance passes once in 2,000 seeds; and
    S is whitened by P, where all errors together, of 12 independent directions, tell a few percent of P.
    """
    N, sigma, m = 512, 1e-6, 500
    platform = replace(UNEVEN, leg_coulomb_friction=0.0)
    gains = gains_from_bandwidth(platform, 2.0, 0.8)
    K = discretised(channel_matrices(channels_of(gains), "error"), T)
    force = static_leg_forces(platform, platform.home_position, platform.home_orientation)
    home = State(platform.home_position, platform.home_orientation, REST, REST)
    wanted = np.concatenate([platform.home_position, platform.home_orientation, np.zeros(6)])
    motion = Motion(home.position[None], home.orientation[None], *(REST[None],) * 4)
    row = np.concatenate([wanted, *(each[0] for each in legs_of(platform, motion)), np.zeros(6)])
    loop = Loop(
        Timing(m * T, T, T),
        np.tile(row, (m + 1, 1)),
        np.tile(force, (m, 1)),
        force,
        Sensors({"leg_length": sigma}, seed=tuple(SeedSequence(20).spawn(N))),
        Actuators(delay=1),
        shape=(N,),
    )
    plant = LanesPlant([platform] * N, [home] * N, substeps=1)
    last = Last()
    outcomes = observe(plant, laws_of([LinearController(K)] * N, T, np.zeros((0, 6, 6))), loop, last)
    assert {(outcome.status, outcome.cause) for outcome in outcomes} == {("completed", None)}

    linear = linearise(platform, outputs=("leg_length",))
    held = control.sample_system(control.ss(linear.A, linear.B[:, :6], linear.C, linear.D[:, :6]), T)
    A, B, C = held.A, held.B, held.C
    By, Dy = K.B[:, 6:12], K.D[:, 6:12]
    # states: of the plant, of the controller, and the command that is on its way
    Phi = np.block([[A, np.zeros((12, 6)), B], [By @ C, K.A, np.zeros((6, 6))], [Dy @ C, K.C, np.zeros((6, 6))]])
    Gamma = np.vstack([np.zeros((12, 6)), By, Dy])
    whole = solve_discrete_lyapunov(Phi, sigma**2 * Gamma @ Gamma.T)
    P = whole[:12, :12]
    left = np.linalg.matrix_power(Phi, m)
    assert (np.diag(left @ whole @ left.T) < 1e-3 * np.diag(whole)).all()  # the beginning is forgotten

    x = last.signals[:, :12] - wanted
    S, variance = x.T @ x / N, np.diag(P)
    assert (np.abs(S - P) < 4.5 * np.sqrt((P**2 + np.outer(variance, variance)) / N)).all()
    assert (np.abs(x.mean(axis=0)) < 4.5 * np.sqrt(variance / N)).all()
    L_inverse = np.linalg.inv(np.linalg.cholesky(P))
    white = L_inverse @ S @ L_inverse.T
    assert abs(np.trace(white) / 12 - 1) < 4.5 * np.sqrt(2 / (12 * N))
