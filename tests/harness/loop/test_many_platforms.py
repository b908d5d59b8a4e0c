"""Many platforms in one loop: against single runs of the stepping model, and against the linear theory of noise."""

from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest
from numpy.random import SeedSequence
from scipy.linalg import solve_discrete_lyapunov

from gough_stewart.harness.control.gains import gains_from_bandwidth
from gough_stewart.harness.control.laws import LinearController
from gough_stewart.harness.control.laws_of_members import law_of, laws_of
from gough_stewart.harness.control.linear import linearise
from gough_stewart.harness.control.pid import pid_matrices
from gough_stewart.harness.control.state_space import discretised
from gough_stewart.harness.loop.loop import Actuators, Change, Loop, Sensors
from gough_stewart.harness.loop.rows import Observer, Rows
from gough_stewart.harness.loop.run import Run, observe, simulate
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.motion.limits.reach import legs_of
from gough_stewart.harness.motion.motion import Motion
from gough_stewart.harness.plants.lanes import LanesPlant
from gough_stewart.harness.plants.model import ModelPlant
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.kinematics import leg_jacobian
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray
from tests.support.members import loop_of_members
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


def motion_of(k: int, time: FloatArray) -> Motion:
    """From rest at home, along and about all axes, another amplitude for each member."""
    rng = np.random.default_rng([4, k])
    t, w = time[:, None], 2 * np.pi * np.array([1.5, 2.0, 1.0])
    parts = []
    for start, amplitude in (
        (UNEVEN.home_position, 0.02 * rng.normal(size=3)),
        (UNEVEN.home_orientation, 0.02 * rng.normal(size=3)),
    ):
        s, c = np.sin(w * t), np.cos(w * t)
        parts.append((start + amplitude * (1 - c), amplitude * w * s, amplitude * w**2 * c))
    (p, v, a), (o, omega, alpha) = parts
    return Motion(p, o, v, omega, a, alpha)


def start_of(k: int) -> State:
    return State(UNEVEN.home_position, UNEVEN.home_orientation + 0.01 * k, REST, REST)


def loop_of_member(k: int) -> tuple[Loop, FloatArray]:
    """Its loop, plant step ≠ sample time, and the leg Jacobians of its reference."""
    timing = Timing(0.2, T, 0.001)
    platform, motion = platform_of(k), motion_of(k, timing.times)
    wanted = np.concatenate([*motion[:4], *legs_of(platform, motion), *motion[4:]], axis=-1)
    force = static_leg_forces(platform, UNEVEN.home_position, UNEVEN.home_orientation)
    loop = Loop(
        timing,
        wanted,
        feedforward=np.tile(force, (len(timing.samples), 1)),
        start_force=force,
        sensors=Sensors({"leg_length": 1e-5}, seed=SeedSequence(8, spawn_key=(k,))),
        actuators=Actuators(400.0 + 10 * k, 2e4 + 1e3 * k, 0.002, k % 3),
        changes=(
            Change(0.05 + 0.01 * (k % 2), {"platform_mass": 14.0 + k}),
            Change(0.1, external_wrench=np.arange(6.0)),
        ),
    )
    return loop, leg_jacobian(platform, motion.position[:-1:2], motion.orientation[:-1:2])


def controller_of_member(k: int, space: Any) -> LinearController:
    gains = gains_from_bandwidth(platform_of(k), 4.0 + 0.2 * k, 0.7, space, integral_time=0.5)
    return LinearController(discretised(pid_matrices(gains), T), space=space)


def slowed(controller: LinearController) -> LinearController:
    """The same with a low-pass of 5 Hz after it: its integrators feed other states."""
    pole = np.exp(-2 * np.pi * 5 * T)
    filters = control.ss(pole * np.eye(6), (1 - pole) * np.eye(6), np.eye(6), np.zeros((6, 6)), T)
    system = controller.system
    before = control.ss(system.A, system.B, system.C, system.D, T)
    return LinearController(control.series(before, filters), space=controller.space)


def test_each_controller_starts_at_rest_under_its_own_error() -> None:
    """Expected: the bits of each member alone, where integrators feed filters and each member starts off its path."""
    numbers = [4, 0, 7]
    loops, jacobians = zip(*(loop_of_member(k) for k in numbers), strict=True)
    rows = [np.stack([each.reference[0] for each in loops]), np.stack([each.reference[0] + 0.01 for each in loops])]
    rows[1] += 1e-3 * np.arange(3)[:, None]
    controllers = [slowed(controller_of_member(k, "leg")) for k in numbers]
    many = laws_of(controllers, T, np.stack(jacobians, axis=1))(*rows)
    for at, controller in enumerate(controllers):
        alone = laws_of([controller], T, jacobians[at][:, None])(*(row[at : at + 1] for row in rows))
        assert alone.state.any()
        assert alone.state[0].tobytes() == np.ascontiguousarray(many.state[at]).tobytes()


def run_of(numbers: list[int], space: Any) -> Run:
    loops, jacobians = zip(*(loop_of_member(k) for k in numbers), strict=True)
    plant = LanesPlant([platform_of(k) for k in numbers], [start_of(k) for k in numbers], substeps=8)
    law_from = laws_of([controller_of_member(k, space) for k in numbers], T, np.stack(jacobians, axis=1))
    return simulate(plant, law_from, loop_of_members(loops))


@pytest.mark.parametrize("space", ["leg", "task"])
def test_platforms_side_by_side_are_single_runs_of_theirs(space: Any) -> None:
    """Expected: the bits of each member alone; and the stepping model in a single loop, to 1e-8 m and rad."""
    numbers = [4, 0, 7, 2, 1, 3, 6, 5, 8]
    many = run_of(numbers, space)
    for at, k in list(enumerate(numbers))[::4]:
        alone = run_of([k], space)
        assert alone.results[:, 0].tobytes() == many.results[:, at].tobytes()
        assert alone.command[:, 0].tobytes() == many.command[:, at].tobytes()
        loop, jacobians = loop_of_member(k)
        controller = controller_of_member(k, space)

        def law_from(wanted: FloatArray, measured: FloatArray, made: Any = controller, J: Any = jacobians) -> Any:
            return law_of(made, T, J)(wanted, measured)

        single = simulate(ModelPlant(platform_of(k), start_of(k), 1e-11, integrator="scipy"), law_from, loop)
        assert np.abs(many.results[:, at, :6] - single.results[:, :6]).max() < 1e-8
        assert np.ptp(single.results[:, :6], axis=0).min() > 1e-3
        np.testing.assert_array_equal(many.force_limited[:, at], single.force_limited)
        assert many.outcomes[at] == single.outcome


class Last(Observer):
    """Keeps the signals of the last row."""

    def block(self, rows: Rows) -> None:
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
    K = discretised(pid_matrices(gains), T)
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
