"""The covariance of rows, against noise sent through the filters, and dense matrices."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gough_stewart import Acceleration, Platform, inverse_dynamics, leg_geometry
from gough_stewart.harness.identify.lowpass import kernel_correlations, kernel_of
from gough_stewart.harness.identify.noise import fitted_noise, part_noise, whitened_by
from gough_stewart.harness.identify.regressor import force_derivatives, motion_of_lengths, parameter_columns, states_of
from gough_stewart.harness.identify.row_model import RawNoise
from gough_stewart.model.kernel import parameter_vector
from gough_stewart.model.kinematics import leg_accelerations, rates_of_legs
from tests.support.arrays import FloatArray
from tests.support.uneven import STATE, UNEVEN

RNG = np.random.default_rng(24)
SPACING = 20
LEGS = np.array([1.0, 0.3, 2.0, 0.7, 5.0, 1.4])  # noise of each encoder, relative


def correlations() -> tuple[FloatArray, FloatArray]:
    kernels = np.stack([kernel_of(1e-3, 40.0, d) for d in range(3)])
    return kernel_correlations(kernel_of(1e-3, 20.0), kernels * np.array([1e3, 1.0, 1e-2])[:, None], SPACING)


def dense(n: int, by_legs: np.ndarray, force: np.ndarray, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Both covariances from the correlations, element by element."""
    of_force, of_length = correlations()
    V = np.zeros((2, n, 6, n, 6))
    for k in range(n):
        for l in range(n):
            m = abs(k - l)
            if m >= len(of_force):
                continue
            c = of_length[m] if l >= k else of_length[m].T
            V[0, k, :, l, :] = np.diag(force**2) * of_force[m]
            V[1, k, :, l, :] = length**2 * sum(
                c[d, e] * by_legs[k, :, d] @ by_legs[l, :, e].T for d in range(3) for e in range(3)
            )
    return V[0].reshape(6 * n, 6 * n), V[1].reshape(6 * n, 6 * n)


def test_correlations_are_those_of_the_kernels() -> None:
    """Expected: Σ_t g(t) g(t + m) in full, at every twentieth lag; of value, rate and acceleration each with each."""
    of_force, of_length = correlations()
    g, c = kernel_of(1e-3, 20.0), [kernel_of(1e-3, 40.0, d) * size for d, size in enumerate((1e3, 1.0, 1e-2))]
    full = np.correlate(g, g, "full")[len(g) - 1 :: SPACING]
    assert_allclose(of_force, full[: len(of_force)], rtol=1e-12)
    for d, e in np.ndindex(3, 3):
        whole = np.correlate(c[d], c[e], "full")[len(c[0]) - 1 :: -SPACING]
        n = min(len(whole), len(of_length))
        assert_allclose(of_length[:n, d, e], whole[:n], atol=1e-12 * abs(c[d]).sum() * abs(c[e]).sum())


def test_whitening_by_bands_is_that_of_the_whole_matrix_with_unused_rows_left_out() -> None:
    """Expected: r' V⁻¹ r and log|V| of the dense matrix of the rows that are used."""
    n = 40
    by_legs, force = RNG.standard_normal((n, 6, 3, 6)), RNG.uniform(1, 3, 6)
    used = (RNG.uniform(size=(n, 6)) > 0.2).astype(float)
    noises = part_noise(0, RawNoise(force, 0.4 * LEGS, *correlations()), by_legs, used)
    V_force, V_length = dense(n, by_legs * LEGS, force, 0.4)
    kept = used.ravel() > 0
    V = 0.7 * V_force + 1.9 * V_length
    # a little on the diagonal keeps what was cut off from making it indefinite
    V = V + 3e-5 * np.diag(np.diag(V))
    L = noises.factor(0.7, 1.9)
    r = (used * RNG.standard_normal((n, 6))).ravel()
    white = whitened_by([L], r[:, None])[:, 0]
    assert white @ white == pytest.approx(r[kept] @ np.linalg.solve(V[np.ix_(kept, kept)], r[kept]), rel=1e-8)
    assert 2 * np.log(L[0]).sum() == pytest.approx(np.linalg.slogdet(V[np.ix_(kept, kept)])[1], rel=1e-8)
    assert (white.reshape(n, 6)[used == 0] == 0).all()


def test_shares_of_both_noises_are_found_log_by_log() -> None:
    """Expected: the shares that made the noise of each log, within 4 standard errors of about 7 %."""
    n, shares = 150, np.array([[2.0, 0.5], [0.5, 1.5]])
    by_legs, force = np.tile(RNG.standard_normal((6, 3, 6)), (n, 1, 1, 1)), np.ones(6)
    V_force, V_length = dense(n, by_legs, force, 1.0)
    # as large as the noise of forces
    length = float(np.sqrt(np.trace(V_force) / np.trace(V_length)))
    small = 1e-9 * np.eye(6 * n) * length**2 * V_length.max()
    raw, noise = RawNoise(force, np.full(6, length), *correlations()), []
    for of_force, of_length in shares:
        L = np.linalg.cholesky(of_force * V_force + of_length * length**2 * V_length + small)
        noise.append((L @ RNG.standard_normal(6 * n)).reshape(n, 6))
    rows = [n, n, 2]
    parts = [part_noise(k, raw, by_legs[:m], np.ones((m, 6))) for k, m in enumerate(rows)]
    residual = np.concatenate([*noise, np.zeros((2, 6))])
    columns = RNG.standard_normal((2 * n + 2, 6, 120))
    found = fitted_noise(parts, columns[..., :3], columns[..., 3:], residual, np.ones((2 * n + 2, 6)))
    assert_allclose([found.shares[0], found.shares[1]], shares, rtol=0.3)
    assert_allclose(found.shares[2], np.sqrt(np.prod([found.shares[0], found.shares[1]], axis=0)))


def test_derivatives_of_forces_by_the_motion_of_legs_and_by_parameters_are_those_of_differences() -> None:
    """Expected: central differences of poses from lengths and inverse dynamics, one motion of legs."""
    state = type(STATE)(*(part[None] for part in STATE))
    acceleration = Acceleration(np.array([[0.7, -0.4, 1.1]]), np.array([[0.5, 0.9, -0.6]]))
    legs = leg_geometry(UNEVEN, state.position, state.orientation)
    of_legs = [legs.length, rates_of_legs(legs, state).length_rate, leg_accelerations(legs, state, *acceleration)]
    home = replace(UNEVEN, home_position=STATE.position, home_orientation=STATE.orientation)

    def forces(lengths: list[FloatArray], platform: Platform) -> FloatArray:
        found: FloatArray = np.asarray(
            inverse_dynamics(platform, *states_of(motion_of_lengths(platform, *lengths))), dtype=float
        )
        return np.asarray(found[0])

    motion = np.concatenate([state.to_vector(), *acceleration], axis=1)
    F = np.asarray(inverse_dynamics(UNEVEN, state, acceleration))
    found = force_derivatives(motion, parameter_vector(UNEVEN), F)
    h = 1e-6
    for order in range(3):
        step = np.zeros(6)
        step[2] = h
        ends = [forces([x + sign * step if d == order else x for d, x in enumerate(of_legs)], home) for sign in (1, -1)]
        assert_allclose(found.by_legs[0, :, order, 2], (ends[0] - ends[1]) / (2 * h), rtol=2e-5, atol=1e-4)
    for name, where in (("base_points", (3, 1)), ("platform_points", (0, 2)), ("gravity", (1,))):
        step = np.zeros_like(getattr(UNEVEN, name))
        step[where] = h
        ends = [forces(of_legs, replace(home, **{name: getattr(UNEVEN, name) + sign * step})) for sign in (1, -1)]
        element = f"{name}[{','.join(str(k + 1) for k in where)}]"
        column = (found.by_parameters @ parameter_columns([element]))[0, :, 0]
        assert_allclose(column, (ends[0] - ends[1]) / (2 * h), rtol=2e-5, atol=1e-4)
