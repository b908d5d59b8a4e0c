"""The traced kernel: exact Jacobians, run-time parameters, no allocation."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gough_stewart import Platform, State, load_preset
from gough_stewart.model import dynamics, interface, kinematics, traced
from gough_stewart.model.kernel import Kernel, parameter_vector
from gough_stewart.model.rotations import orientation_rate_from_angular_velocity
from gough_stewart.model.state import Inputs
from tests.support.random_platforms import random_inputs, random_platform, random_state
from tests.support.uneven import INPUTS, STATE, UNEVEN

seeds = st.integers(0, 2**32 - 1)
KERNEL = Kernel()


def derivative_by_numpy(platform: Platform, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """ẋ by the NumPy functions, also for complex arguments."""
    state = State.from_vector(x)
    a = dynamics.forward_dynamics(platform, state, Inputs.from_vector(u))
    rate = orientation_rate_from_angular_velocity(state.orientation, state.angular_velocity)
    return np.concatenate([state.velocity, rate, a.linear, a.angular])


@given(seeds)
def test_state_jacobians_are_exact(seed: int) -> None:
    """Expected: complex-step derivatives of the NumPy functions, which have no rounding of differences."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    x, u = random_state(platform, rng).to_vector(), random_inputs(platform, rng).to_vector()
    J = KERNEL.jacobians(x, u, parameter_vector(platform))
    h = 1e-30
    A = np.stack([derivative_by_numpy(platform, x + 1j * h * e, u).imag / h for e in np.eye(12)], axis=1)
    B = np.stack(
        [derivative_by_numpy(platform, x.astype(complex), u + 1j * h * e).imag / h for e in np.eye(12)], axis=1
    )
    assert np.abs(J.A - A).max() <= 1e-10 * np.abs(A).max()
    assert np.abs(J.B - B).max() <= 1e-10 * np.abs(B).max()


@given(seeds)
def test_output_jacobians_match_central_differences(seed: int) -> None:
    """Expected: extrapolated central differences of the outputs, ≤ 1e-6 of the largest entry of the block."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    x, u = random_state(platform, rng).to_vector(), random_inputs(platform, rng).to_vector()
    p = parameter_vector(platform)
    J = KERNEL.jacobians(x, u, p)

    def differences(at: np.ndarray, of_state: bool) -> np.ndarray:
        columns = []
        for k in range(12):
            # outputs are affine in the inputs: a long step has no error of its own, and far less rounding
            h = (1e-5 if of_state else 1.0) * max(1.0, abs(at[k]))
            quotients = []
            for size in (h, 2 * h):
                step = np.zeros(12)
                step[k] = size
                moves = [(at + s * step, u) if of_state else (x, at + s * step) for s in (1, -1)]
                ends = [KERNEL.outputs(x_s, u_s, p).copy() for x_s, u_s in moves]
                quotients.append((ends[0] - ends[1]) / (2 * size))
            # Richardson: the error in h² cancels
            columns.append((4 * quotients[0] - quotients[1]) / 3)
        return np.stack(columns, axis=1)

    for block, expected in ((J.C, differences(x, True)), (J.D, differences(u, False))):
        sizes = np.abs(expected).max()
        assert np.abs(block - expected).max() <= 1e-6 * sizes


def test_forward_and_reverse_derivatives_are_products_with_the_jacobians() -> None:
    """Expected: J v and Jᵀ w of the whole Jacobian; by parameters, central differences of the traced functions."""
    rng = np.random.default_rng(12)
    x, u, p = STATE.to_vector(), INPUTS.to_vector(), parameter_vector(UNEVEN)
    A, B, C, D = KERNEL.jacobians(x, u, p)
    J = np.block([[A, B], [C, D]])
    v, w = rng.normal(size=24), rng.normal(size=len(J))
    none = np.zeros(len(p))
    along = [np.array(part).ravel() for part in traced.forward_function()(x, u, p, v[:12], v[12:], none)]
    assert np.concatenate(along) == pytest.approx(J @ v, rel=1e-10, abs=1e-9)
    gx, gu, gp = (np.array(part).ravel() for part in traced.reverse_function()(x, u, p, w[:12], w[12:]))
    assert np.concatenate([gx, gu]) == pytest.approx(J.T @ w, rel=1e-10, abs=1e-8)
    assert len(gp) == len(p)
    for k in range(len(p)):
        h = 1e-6 * np.eye(len(p))[k]
        ends = [np.concatenate([KERNEL.derivatives(x, u, q), KERNEL.outputs(x, u, q)]) for q in (p + h, p - h)]
        assert gp[k] == pytest.approx(w @ (ends[0] - ends[1]) / 2e-6, rel=1e-5, abs=1e-4)


def test_parameters_are_run_time_inputs() -> None:
    """Expected: the NumPy functions on three quite different platforms, by one and the same Function."""
    for name in ("liu2000", "desktop_hexapod", "motion_base"):
        platform = load_preset(name)
        x = np.concatenate([platform.home_position, [0.02, 0.03, -0.1], 0.1 * platform.home_position, [0.1, 0.2, 0.3]])
        u = np.linspace(10, 20, 12)
        expected = derivative_by_numpy(platform, x, u)
        assert np.allclose(KERNEL.derivatives(x, u, parameter_vector(platform)), expected, rtol=1e-11)


def test_calls_allocate_nothing() -> None:
    kernel_, p = Kernel(), parameter_vector(UNEVEN)
    x, u = np.concatenate([[0, 0, 3.0], np.zeros(9)]), np.ones(12)
    for call in (kernel_.derivatives, kernel_.outputs, kernel_.jacobians):
        call(x, u, p)
        tracemalloc.start()
        for _ in range(100):
            call(x, u, p)
        kept, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        # a few hundred bytes of Python's own frames and slices, far below one 12-vector a call
        assert peak < 2000, call
        assert kept < 1000, call


def test_results_are_views_of_the_same_buffer() -> None:
    kernel_, p = Kernel(), parameter_vector(UNEVEN)
    x = np.concatenate([[0, 0, 3.0], np.zeros(9)])
    assert kernel_.derivatives(x, np.zeros(12), p) is kernel_.derivatives(x, np.ones(12), p)


def test_two_kernels_do_not_disturb_each_other() -> None:
    one, other, p = Kernel(), Kernel(), parameter_vector(UNEVEN)
    x = np.concatenate([[0, 0, 3.0], np.zeros(9)])
    first = one.derivatives(x, np.zeros(12), p)
    before = first.copy()
    other.derivatives(x, np.full(12, 50.0), p)
    assert np.array_equal(first, before)


def test_jacobians_know_what_depends_on_what() -> None:
    """Expected: position's rate is velocity alone, leg lengths depend on the pose alone.

    Inputs act at once on accelerations and joint forces only.
    """
    rng = np.random.default_rng(8)
    platform = random_platform(rng)
    state, inputs = random_state(platform, rng), random_inputs(platform, rng)
    A, B, C, D = KERNEL.jacobians(state.to_vector(), inputs.to_vector(), parameter_vector(platform))
    assert np.array_equal(A[:3], np.hstack([np.zeros((3, 6)), np.eye(3), np.zeros((3, 3))]))
    assert not B[:6].any()
    rows = interface.RESULT_COLUMNS
    lengths = [k for k, name in enumerate(rows) if name.startswith("leg_length")]
    assert C[np.ix_(lengths, range(6))].all()
    assert not C[np.ix_(lengths, range(6, 12))].any()
    direct = {name.split("[")[0] for k, name in enumerate(rows) if D[k].any()}
    assert direct == {"acceleration", "angular_acceleration", "joint_force"}


def test_leg_velocity_row_of_the_jacobian_is_the_leg_jacobian() -> None:
    """Expected: ∂L̇/∂[v; ω] = J, from `kinematics`."""
    x = np.concatenate([[0.1, 0.2, 3.0], [0.1, -0.2, 0.3], np.zeros(6)])
    C = KERNEL.jacobians(x, np.zeros(12), parameter_vector(UNEVEN)).C
    rows = [k for k, name in enumerate(interface.RESULT_COLUMNS) if name.startswith("leg_velocity")]
    J = kinematics.leg_jacobian(UNEVEN, x[:3], x[3:6])
    assert np.allclose(C[rows][:, 6:], J, atol=1e-14)


NAMES = {
    "derivatives": (["x", "u", "p"], ["xdot"]),
    "outputs": (["x", "u", "p"], ["y"]),
    "jacobians": (["x", "u", "p"], ["A", "B", "C", "D"]),
    "forward": (["x", "u", "p", "dx", "du", "dp"], ["dxdot", "dy"]),
    "reverse": (["x", "u", "p", "wxdot", "wy"], ["gx", "gu", "gp"]),
    "legs": (["x", "p"], ["length", "length_rate", "jacobian", "rho"]),
    "signals": (["x", "p"], ["y"]),
    "margins": (["x", "p"], ["square", "determinant", "size"]),
    "posed": (["x", "p"], ["y", "square", "determinant", "size", "s"]),
    "motion": (["s", "x", "u"], ["xdot"]),
}


@pytest.mark.parametrize("name", NAMES)
def test_functions_carry_names_for_whoever_generates_code(name: str) -> None:
    """Expected: those of the module's equations, in the order in which C gets its arguments."""
    f = getattr(traced, f"{name}_function")()
    assert f.name() == name
    assert (f.name_in(), f.name_out()) == NAMES[name]


@given(seeds)
def test_functions_of_the_legs_alone_are_those_of_geometry(seed: int) -> None:
    """Expected: NumPy's norms, cross products and determinants of vectors from SciPy's rotation."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    state = random_state(platform, rng)
    x, p = state.to_vector(), parameter_vector(platform)
    arm = Rotation.from_euler("xyz", state.orientation).apply(platform.platform_points.copy())
    l = state.position + arm - platform.base_points
    L = np.linalg.norm(l, axis=1)
    u, rho = l / L[:, None], np.sqrt((arm**2).sum() / 6)
    rates = (u * (state.velocity + np.cross(state.angular_velocity, arm))).sum(axis=1)
    scaled = np.hstack([u, np.cross(arm, u) / rho])

    found = dict(zip(NAMES["legs"][1], map(np.array, traced.legs_function()(x, p)), strict=True))
    assert found["length"].ravel() == pytest.approx(L, rel=1e-12)
    assert found["length_rate"].ravel() == pytest.approx(rates, rel=1e-9, abs=1e-12)
    assert found["jacobian"].reshape(6, 6) == pytest.approx(scaled, rel=1e-9, abs=1e-12)
    assert found["rho"].ravel() == pytest.approx([rho], rel=1e-12)

    square, determinant, size = map(np.array, traced.margins_function()(x, p))
    assert square.ravel() == pytest.approx(L**2, rel=1e-12)
    expected = np.linalg.det(np.hstack([l, np.cross(arm, l)]))
    assert determinant.ravel() == pytest.approx([expected], rel=1e-8)
    assert size.ravel() == pytest.approx([rho**2], rel=1e-12)

    signals = np.array(traced.signals_function()(x, p)).ravel()
    assert signals.shape == (24,)
    assert signals == pytest.approx(np.concatenate([x, L, rates]), rel=1e-9, abs=1e-12)


@given(seeds)
def test_what_depends_on_a_state_alone_serves_any_inputs(seed: int) -> None:
    """Expected: NumPy's derivatives for two inputs, forces and wrench; signals and margins of their own functions."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    x, p = random_state(platform, rng).to_vector(), parameter_vector(platform)
    y, square, determinant, size, s = map(np.array, traced.posed_function()(x, p))
    for _ in range(2):
        u = random_inputs(platform, rng).to_vector()
        xdot = np.array(traced.motion_function()(s, x, u)).ravel()
        expected = derivative_by_numpy(platform, x, u)
        assert np.abs(xdot - expected).max() <= 1e-9 * np.abs(expected).max()
    assert np.array_equal(y, np.array(traced.signals_function()(x, p)))
    for found, alone in zip((square, determinant, size), traced.margins_function()(x, p), strict=True):
        assert found == pytest.approx(np.array(alone), rel=1e-12)


def test_the_parameter_vector_has_each_number_once_in_the_order_of_the_table() -> None:
    """Expected: the numbers of the uneven platform by hand, row by row; the FMU's value references follow it."""
    p = parameter_vector(UNEVEN).tolist()
    assert p[:4] == [0.52, 1.93, 0.04, -0.61]
    assert p[18:21] == [0.74, 0.66, -0.06]
    assert p[36:49] == [11.5, 0.06, -0.11, 0.17, 4.6, 0.35, -0.28, 0.35, 5.7, 0.41, -0.28, 0.41, 8.1]
    assert p[49:55] == [2.3, 1.2, 0.47, 0.58, 0.13, 0.061]
    assert p[55:62] == [7.0, 1.9, 0.06, 0.9, -1.3, -9.4, 1.7]
    assert p[62:] == [0.7, 1.4, 0.9, 1.6, 0.5, 1.1, 1.3, 0.6, 1.5, 0.8, 1.2, 0.4]
