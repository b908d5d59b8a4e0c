"""Stiction and elastic legs: rates of all states by the laws as papers print them, and Jacobians by what steps do."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.documented_loop import accelerations, twist_of_rates
from tests.support.lagrangian import Pose, legs_along
from tests.support.random_platforms import random_inputs, random_state
from tests.support.real_platforms import SIX, SIX_SPRINGS, SPRINGS, VARIANTS, of_leg, printed_law, real_platform
from tests.support.uneven import UNEVEN

# Bristles below the elastic range, in the blend, beyond steady sliding, and unbending, in units of F_c/σ0.
BENT = np.array([0.3, 0.95, 2.2, -0.7, 0.8, -1.4])


def lively(platform: gs.Platform, seed: int, tolerance: float = 1e-13) -> tuple[gs.SteppingModel, FloatArray]:
    """A model whose states are all different, slow enough for Stribeck's effect, and its inputs (12,)."""
    rng = np.random.default_rng(seed)
    model = gs.SteppingModel(platform, tolerance)
    state, u = random_state(platform, rng), random_inputs(platform, rng)
    state = state._replace(velocity=3e-3 * rng.normal(size=3), angular_velocity=4e-3 * rng.normal(size=3))
    model.set_many(state._asdict())
    lengths, rates = (np.asarray(model.get(f"leg_{name}")) for name in ("length", "velocity"))
    if model.variant.bristles:
        coulomb = platform.leg_coulomb_friction * platform.leg_coulomb_friction_factor
        model.set("leg_bristle", BENT * coulomb / 2.9e6)
    if model.variant.springs:
        motors = {"motor_position": lengths + 1e-5 * rng.normal(size=6)}
        model.set_many(motors | {"motor_velocity": rates + 2e-3 * rng.normal(size=6)})
    model.set_inputs(u)
    return model, u


def printed_rates(platform: gs.Platform, x: FloatArray, u: FloatArray) -> FloatArray:
    """Linear acceleration, rates of the bristles, velocities and accelerations of the motors of a state."""
    bristles, springs = platform.leg_friction_model > 0, platform.leg_stiffness > 0
    q, rate = x[:6], np.asarray(np.linalg.solve(twist_of_rates(x[:6]), x[6:12]))
    length, speed = (part[0] for part in legs_along(platform, Pose(q[None], rate[None], rate[None])))
    sliding = x[-6:] if springs else speed
    bent, z = np.zeros(6), x[12:18]
    if bristles:
        friction, bent = np.transpose([printed_law(platform, sliding[k], z[k], k) for k in range(6)])
    else:
        viscous, coulomb = (of_leg(platform, f"leg_{name}_friction") for name in ("viscous", "coulomb"))
        friction = viscous * sliding + coulomb * np.tanh(sliding / platform.leg_friction_velocity)
    force, motor = u[:6] - friction, np.zeros(6)
    free = replace(UNEVEN, leg_viscous_friction=0.0, leg_coulomb_friction=0.0, leg_armature=platform.leg_armature)
    free = replace(free, leg_armature_factor=platform.leg_armature_factor)
    if springs:
        k, c, m_a = (of_leg(platform, f"leg_{name}") for name in ("stiffness", "damping", "armature"))
        spring = k * (x[-12:-6] - length) + c * (sliding - speed)
        motor, force = (force - spring) / m_a, spring
        free = replace(free, leg_armature=0.0)
    linear = accelerations(free, q, rate, force, u[6:])[:3]
    return np.concatenate([linear, *([bent] if bristles else []), *([sliding, motor] if springs else [])])


@pytest.mark.parametrize(("friction", "springs"), VARIANTS)
@pytest.mark.parametrize("differ", [False, True])
def test_rates_are_those_of_a_lagrangian_with_printed_laws(friction: str, springs: bool, differ: bool) -> None:
    """Expected: (4 x(h) − x(2h) − 3 x(0))/2h of short steps; of legs that are alike and of six that differ."""
    platform, h = real_platform(friction, springs), 1e-6
    if differ:
        platform = platform.with_parameters(SIX | (SIX_SPRINGS if springs else {}))
    model, u = lively(platform, 1 + differ)
    begin = model.save_state()
    ends = [model.state]
    for step in (h, 2 * h):
        model.restore_state(begin)
        model.do_step(0.0, step)
        ends.append(model.state)
    found = (4 * ends[1] - ends[2] - 3 * ends[0]) / (2 * h)
    expected = printed_rates(platform, ends[0], u)
    scale = np.concatenate([np.full(3, np.abs(expected[:3]).max()), np.abs(expected[3:]) + 1e-2])
    np.testing.assert_allclose(found[[6, 7, 8, *range(12, len(found))]] / scale, expected / scale, atol=1e-4)


@pytest.mark.parametrize(("friction", "springs"), [("smooth", False), *VARIANTS])
def test_the_linearisation_is_what_small_changes_do(friction: str, springs: bool) -> None:
    """Expected: expm of [A B; 0 0] h by differences of steps, C and D by those of results; copies that stay."""
    model, u = lively(real_platform(friction, springs), 4)
    h, begin = 1e-6, model.save_state()
    A, B, C, D = blocks = model.linearise()
    copies = [block.copy() for block in blocks]
    n = len(A)
    assert (B.shape, C.shape, D.shape) == ((n, 12), (len(model.result_vector()), n), (len(C), 12))
    sizes = np.full(n, 1e-4)
    sizes[6:12] = 5e-6
    if model.variant.bristles:
        sizes[12:18] = 4e-9
    if springs:
        sizes[-6:] = 5e-6

    def after(x: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        model.restore_state(replace(begin, x=tuple(x), u=tuple(u)))
        results = model.result_vector()
        model.do_step(0.0, h)
        return results, model.state

    x = np.array(begin.x)
    moves = [(size * np.eye(n)[k], np.zeros(12)) for k, size in enumerate(sizes)]
    moves += [(np.zeros(n), unit) for unit in np.eye(12)]
    results, states = [], []
    for dx, du in moves:
        size = np.abs(np.concatenate([dx, du])).max()
        ahead, further, behind, before = (after(x + s * dx, u + s * du) for s in (1, 2, -1, -2))
        pairs = zip(ahead, further, behind, before, strict=True)
        y_change, x_change = ((8 * (a - b) - (f - e)) / (12 * size) for a, f, b, e in pairs)
        results.append(y_change)
        states.append(x_change)
    exact = np.hstack([C, D])
    assert (np.abs(np.transpose(results) - exact).max(axis=1) < 1e-6 * (1e-3 + np.abs(exact).max(axis=1))).all()
    exact, stays = expm(np.block([[A, B], [np.zeros((12, n + 12))]]) * h)[:n], np.eye(n, n + 12)
    columns = np.concatenate([sizes, np.ones(12)])
    gap, change = (np.abs(part * columns).max(axis=1) for part in (np.transpose(states) - exact, exact - stays))
    assert (gap / change).max() < 2e-2
    assert all(np.array_equal(block, copied) for block, copied in zip(blocks, copies, strict=True))


def test_what_is_0_is_derived_as_documented() -> None:
    """Expected: by hand; F_s = F_c, 10 µm of presliding, half of critical damping, a share of 0.8, 2 % of critical."""
    names = ("static_friction", "bristle_stiffness", "bristle_damping", "breakaway_share")
    pairs = []
    for springs in (False, True):
        zero = real_platform(
            "elasto_plastic", springs, **{f"leg_{name}": 0.0 for name in names}, leg_coulomb_friction=20.0
        )
        mass = SPRINGS["leg_armature"] if springs else zero.leg_upper_mass + zero.leg_armature + zero.platform_mass / 6
        stiffness = 20.0 / 1e-5
        derived = {
            "leg_static_friction": 20.0,
            "leg_bristle_stiffness": stiffness,
            "leg_bristle_damping": float(np.sqrt(stiffness * mass)),
            "leg_breakaway_share": 0.8,
        }
        pairs.append((zero, zero.with_parameters(derived)))
    motor, own = SPRINGS["leg_armature"], UNEVEN.leg_upper_mass + UNEVEN.platform_mass / 6
    damping = 2 * 0.02 * np.sqrt(SPRINGS["leg_stiffness"] * motor * own / (motor + own))
    pairs.append(
        (real_platform(springs=True, leg_damping=0.0), real_platform(springs=True, leg_damping=float(damping)))
    )
    for zero, stated in pairs:
        models = [lively(platform, 5)[0] for platform in (zero, stated)]
        start = models[0].state
        for model in models:
            model.do_step(0.0, 1e-3)
        ours, theirs = (model.state - start for model in models)
        assert ours == pytest.approx(theirs, rel=1e-9, abs=1e-13)
