"""Task-space dynamics and energies: a Lagrangian by automatic differentiation, sums over bodies, invariants."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from tests.support.documented_loop import friction_of, twist_of_rates
from tests.support.lagrangian import FloatArray, Pose, forces_along, legs_along
from tests.support.random_platforms import random_platform, random_state
from tests.support.uneven import MOVING, STATE, UNEVEN

HOME = UNEVEN.home_position, UNEVEN.home_orientation


def twists_of(q: FloatArray, rate: FloatArray, acceleration: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Twist and its rate of coordinates; the rate of the matrix between them by differences of order 4."""
    h = 1e-3
    ahead, further, behind, before = (twist_of_rates(q + k * h * rate) for k in (1, 2, -1, -2))
    turning = (8 * (ahead - behind) - (further - before)) / (12 * h)
    return twist_of_rates(q) @ rate, twist_of_rates(q) @ acceleration + turning @ rate


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_forces_of_any_motion_are_those_of_a_lagrangian_and_of_friction(seed: int, is_at_rest: bool) -> None:
    """Expected: Lagrange's equations from the places of thirteen bodies and their energies; friction as documented."""
    rng = np.random.default_rng(seed)
    platform = UNEVEN if seed % 4 == 0 else random_platform(rng)
    start = random_state(platform, rng)
    q = np.concatenate(start[:2])
    rate, acceleration = rng.normal(size=(2, 6)) * np.repeat([platform.characteristic_length, 1], 3) * (not is_at_rest)
    pose = Pose(q[None], rate[None], acceleration[None])
    expected = forces_along(platform, pose)[0] + friction_of(platform, legs_along(platform, pose)[1][0])
    twist, change = twists_of(q, rate, acceleration)
    state = gs.State(*start[:2], twist[:3], twist[3:])
    found = gs.inverse_dynamics(platform, state, gs.Acceleration(change[:3], change[3:]))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    wrench = 10 * platform.platform_mass * rng.normal(size=6)
    J = gs.leg_jacobian(platform, *start[:2])
    pushed = gs.inverse_dynamics(platform, state, gs.Acceleration(change[:3], change[3:]), wrench)
    np.testing.assert_allclose(J.T @ (found - pushed), wrench, rtol=0, atol=1e-9 * np.abs(J.T @ pushed).max())
    if is_at_rest:
        assert np.array_equal(gs.static_leg_forces(platform, *start[:2]), found)
        assert np.array_equal(gs.static_leg_forces(platform, *start[:2], wrench), pushed)
    # a unit of acceleration in each direction
    M = gs.mass_matrix(platform, *start[:2])
    at_rest, none = gs.State(*start[:2], np.zeros(3), np.zeros(3)), gs.static_leg_forces(platform, *start[:2])
    columns = [gs.inverse_dynamics(platform, at_rest, gs.Acceleration(e[:3], e[3:])) - none for e in np.eye(6)]
    np.testing.assert_allclose(J.T @ np.transpose(columns), M, rtol=0, atol=1e-9 * np.abs(J.T @ none).max())
    assert np.linalg.eigvalsh(M).min() > 0


def test_energies_of_an_uneven_platform_are_sums_over_its_bodies() -> None:
    """Expected: −m g·r of thirteen bodies; ½ [v; ω]ᵀ M [v; ω], whose M the forces of unit accelerations judge."""
    R = Rotation.from_euler("xyz", STATE.orientation)
    joints = STATE.position + R.apply(UNEVEN.platform_points.copy())
    l = joints - UNEVEN.base_points
    u = l / np.linalg.norm(l, axis=1, keepdims=True)
    # centres of mass 0.47 m from the base joint, 0.58 m before the platform joint
    of_legs = 2.3 * (UNEVEN.base_points + 0.47 * u) + 1.2 * (joints - 0.58 * u)
    moment = 11.5 * (STATE.position + R.apply(UNEVEN.platform_com.copy())) + of_legs.sum(axis=0)
    twist = np.concatenate(STATE[2:])
    kinetic = 0.5 * twist @ gs.mass_matrix(UNEVEN, *STATE[:2]) @ twist
    model = gs.SteppingModel(UNEVEN)
    model.set_many(MOVING)
    assert model.get("kinetic_energy") == pytest.approx(kinetic, rel=1e-12)
    assert model.get("potential_energy") == pytest.approx(-UNEVEN.gravity @ moment, rel=1e-12)


def results(platform: gs.Platform, state: gs.State, linear: FloatArray, angular: FloatArray) -> list[FloatArray]:
    return [
        gs.inverse_dynamics(platform, state, gs.Acceleration(linear, angular)),
        gs.static_leg_forces(platform, *state[:2]),
        gs.mass_matrix(platform, *state[:2]),
        gs.leg_jacobian(platform, *state[:2]),
        *gs.leg_geometry(platform, *state[:2]),
    ]


def test_any_argument_and_platforms_may_be_batches() -> None:
    """Expected: one at a time; leading axes broadcast, so a batch of one argument is a batch of the whole."""
    rng = np.random.default_rng(3)
    platforms = [UNEVEN, *(random_platform(rng) for _ in range(3))]
    parts = [np.array([*random_state(platform, rng), *rng.normal(size=(2, 3))]) for platform in platforms]
    for batched in range(6):
        many = [np.stack([part] * 5) if k == batched else part for k, part in enumerate(parts[0])]
        one = results(UNEVEN, gs.State(*parts[0][:4]), *parts[0][4:])
        for alone, batch in zip(one, results(UNEVEN, gs.State(*many[:4]), *many[4:]), strict=True):
            assert batch.shape in (alone.shape, (5, *alone.shape))
            np.testing.assert_allclose(batch, np.broadcast_to(alone, batch.shape), rtol=1e-11, atol=1e-11)
    stacked = np.swapaxes(parts, 0, 1)
    all_of_them = results(gs.stack(platforms), gs.State(*stacked[:4]), *stacked[4:])  # type: ignore[arg-type]
    for k, platform in enumerate(platforms):
        one = results(platform, gs.State(*parts[k][:4]), *parts[k][4:])
        for alone, batch in zip(one, all_of_them, strict=True):
            np.testing.assert_allclose(batch[k], alone, rtol=1e-9, atol=1e-9 * float(np.abs(alone).max()))


def test_leg_forces_that_would_have_no_digits_are_refused_with_the_condition_number() -> None:
    """Expected: NumPy's condition number of the worst pose, from 1e12 on."""

    def jacobian(yaw: float) -> FloatArray:
        return np.asarray(gs.leg_jacobian(UNEVEN, HOME[0], np.array([0.0, 0.0, yaw])))

    singular = brentq(lambda yaw: np.linalg.det(jacobian(yaw)), 1.0, 2.5, xtol=1e-15)
    beside = np.zeros((1000, 3))
    beside[:, 2] = singular + np.geomspace(1e-13, 1e-9, 1000)
    numbers = np.linalg.cond(gs.leg_jacobian(UNEVEN, HOME[0], beside))
    fine, bad = (beside[np.abs(np.log(numbers / number)).argmin()] for number in (6e11, 2e12))
    gs.static_leg_forces(UNEVEN, HOME[0], np.stack([HOME[1], fine]))
    for orientation in (bad, np.stack([HOME[1], bad, fine])):
        with pytest.raises(gs.GoughStewartError, match="expected below 1e\\+12: the leg forces cannot hold") as caught:
            gs.static_leg_forces(UNEVEN, HOME[0], orientation)
        worst = float(np.linalg.cond(gs.leg_jacobian(UNEVEN, HOME[0], bad)))
        assert vars(caught.value)["condition_number"] == pytest.approx(worst, rel=0.05)
