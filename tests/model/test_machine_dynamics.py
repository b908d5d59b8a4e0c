"""Stiction and elastic legs. Expected: Newton and Euler, and the laws as papers print them."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gough_stewart import GoughStewartError, Platform, State, leg_geometry
from gough_stewart.model.dynamics import plant_equations
from gough_stewart.model.formulations import newton_euler
from gough_stewart.model.interface import Variant
from gough_stewart.model.kernel import Kernel, parameter_vector
from gough_stewart.model.kinematics import leg_rates
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.state import Inputs
from tests.support.lagrangian import FloatArray
from tests.support.random_platforms import random_inputs, random_state
from tests.support.real_platforms import SIX, SIX_SPRINGS, SPRINGS, VARIANTS, of_leg, printed_law, real_platform
from tests.support.uneven import UNEVEN

# Bristles below the elastic range, in the blend, beyond steady sliding, and unbending, in units of F_c/σ0.
BENT = np.array([0.3, 0.95, 2.2, -0.7, 0.8, -1.4])


def lively(platform: Platform, seed: int) -> tuple[State, Inputs, FloatArray]:
    """A state, inputs, and the states of the parts, all of their elements different."""
    rng = np.random.default_rng(seed)
    state, inputs = random_state(platform, rng), random_inputs(platform, rng)
    # slow enough for Stribeck's effect
    state = state._replace(velocity=3e-3 * rng.normal(size=3), angular_velocity=4e-3 * rng.normal(size=3))
    length, rate = leg_geometry(platform, *state[:2]).length, leg_rates(platform, state).length_rate
    bristle = BENT * platform.leg_coulomb_friction * platform.leg_coulomb_friction_factor / 2.9e6
    motors = length + 1e-5 * rng.normal(size=6), rate + 2e-3 * rng.normal(size=6)
    return state, inputs, np.array([bristle, *motors])


def expected_rates(platform: Platform, state: State, inputs: Inputs, parts: FloatArray) -> FloatArray:
    """Platform's accelerations, rates of bristles, accelerations of motors, each as if the plant had it."""
    z, s, ds = parts
    springs = platform.leg_stiffness > 0
    length, rate = leg_geometry(platform, *state[:2]).length, leg_rates(platform, state).length_rate
    sliding = ds if springs else rate
    if platform.leg_friction_model:
        friction, bent = np.transpose([printed_law(platform, sliding[k], z[k], k) for k in range(6)])
    else:
        viscous = platform.leg_viscous_friction * platform.leg_viscous_friction_factor
        coulomb = platform.leg_coulomb_friction * platform.leg_coulomb_friction_factor
        friction, bent = viscous * sliding + coulomb * np.tanh(sliding / platform.leg_friction_velocity), np.zeros(6)
    force = inputs.actuator_force - friction
    motor = np.zeros(6)
    bare = replace(UNEVEN, leg_viscous_friction=0.0, leg_coulomb_friction=0.0, leg_armature=platform.leg_armature)
    if springs:
        k, c, m_a = (of_leg(platform, f"leg_{name}") for name in ("stiffness", "damping", "armature"))
        spring = k * (s - length) + c * (ds - rate)
        motor, force = (force - spring) / m_a, spring
        bare = replace(bare, leg_armature=0.0)
    R = matrix_from_orientation(state.orientation)
    pushed = inputs._replace(actuator_force=force)
    found = newton_euler.solve(bare, state.position, R, state.velocity, state.angular_velocity, *pushed)
    return np.concatenate([found.linear, found.angular, bent, ds, motor])


def vector_of(variant: Variant, state: State, parts: FloatArray) -> FloatArray:
    chosen = [*([parts[0]] if variant.bristles else []), *(parts[1:] if variant.springs else [])]
    return np.concatenate([*state, *chosen])


@pytest.mark.parametrize(("friction", "springs"), VARIANTS)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_accelerations_bristles_and_motors_are_those_of_the_printed_laws(
    friction: str, springs: bool, seed: int
) -> None:
    platform = real_platform(friction, springs)
    if seed == 3:  # legs that differ
        platform = platform.with_parameters(SIX | (SIX_SPRINGS if springs else {}))
    variant = Variant.of(platform)
    state, inputs, parts = lively(platform, seed)
    x, p = vector_of(variant, state, parts), parameter_vector(platform, variant)
    found = Kernel(variant).derivatives(x, inputs.to_vector(), p)[6:]
    expected = expected_rates(platform, state, inputs, parts)
    chosen = [range(6), range(6, 12) if variant.bristles else [], range(12, 24) if springs else []]
    expected = expected[[k for part in chosen for k in part]]
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected[:6]).max())
    by_numpy, _ = plant_equations(variant, platform, x, inputs)
    assert by_numpy[6:] == pytest.approx(expected, rel=1e-9, abs=1e-8)


@pytest.mark.parametrize(("friction", "springs"), [("smooth", False), *VARIANTS])
def test_jacobians_are_those_of_differences(friction: str, springs: bool) -> None:
    platform = real_platform(friction, springs)
    variant = Variant.of(platform)
    kernel, p = Kernel(variant), parameter_vector(platform, variant)
    state, inputs, parts = lively(platform, 4)
    x, u = vector_of(variant, state, parts), inputs.to_vector()
    A, B, C, D = (block.copy() for block in kernel.jacobians(x, u, p))

    def both(x: FloatArray, u: FloatArray) -> FloatArray:
        return np.concatenate([kernel.derivatives(x, u, p), kernel.outputs(x, u, p)])

    def differences(at: FloatArray, of: Any, sizes: FloatArray) -> FloatArray:
        columns = []
        for k, h in enumerate(sizes):
            # order 4: the blend of α is short
            steps = [of(at + j * h * np.eye(len(at))[k]) for j in (-2, -1, 1, 2)]
            columns.append((steps[0] - 8 * steps[1] + 8 * steps[2] - steps[3]) / (12 * h))
        return np.transpose(columns)

    sizes = np.full(len(x), 1e-4)
    sizes[6:12] = 5e-6
    if variant.bristles:
        sizes[12:18] = 4e-9
    if springs:
        sizes[-6:] = 5e-6
    for exact, found in (
        (np.vstack([A, C]), differences(x, lambda x: both(x, u), sizes)),
        (np.vstack([B, D]), differences(u, lambda u: both(x, u), np.full(12, 1.0))),
    ):
        scale = np.abs(exact).max(axis=1, keepdims=True) + 1e-3
        assert np.abs((found - exact) / scale).max() < 1e-7


def test_what_is_0_is_derived_as_documented() -> None:
    """Expected: by hand; F_s = F_c, 10 µm of presliding, half of critical damping, a share of 0.8."""
    names = ("static_friction", "bristle_stiffness", "bristle_damping", "breakaway_share")
    for springs in (False, True):
        zero = real_platform(
            "elasto_plastic", springs, **{f"leg_{name}": 0.0 for name in names}, leg_coulomb_friction=20.0
        )
        mass = SPRINGS["leg_armature"] if springs else zero.leg_upper_mass + zero.leg_armature + zero.platform_mass / 6
        stiffness = 20.0 / 1e-5
        stated = replace(
            zero,
            leg_static_friction=20.0,
            leg_bristle_stiffness=stiffness,
            leg_bristle_damping=float(np.sqrt(stiffness * mass)),
            leg_breakaway_share=0.8,
        )
        variant = Variant.of(zero)
        state, inputs, parts = lively(zero, 5)
        x, u, kernel = vector_of(variant, state, parts), inputs.to_vector(), Kernel(variant)
        derived = kernel.derivatives(x, u, parameter_vector(zero, variant)).copy()
        assert derived == pytest.approx(kernel.derivatives(x, u, parameter_vector(stated, variant)), rel=1e-12)
    motor, own = SPRINGS["leg_armature"], UNEVEN.leg_upper_mass + UNEVEN.platform_mass / 6
    damping = 2 * 0.02 * np.sqrt(SPRINGS["leg_stiffness"] * motor * own / (motor + own))
    soft, stated = real_platform(springs=True, leg_damping=0.0), real_platform(springs=True, leg_damping=float(damping))
    variant = Variant.of(soft)
    state, inputs, parts = lively(soft, 6)
    x, u, kernel = vector_of(variant, state, parts), inputs.to_vector(), Kernel(variant)
    derived = kernel.derivatives(x, u, parameter_vector(soft, variant)).copy()
    assert derived == pytest.approx(kernel.derivatives(x, u, parameter_vector(stated, variant)), rel=1e-12)


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"leg_friction_model": "stick"}, "is 'stick'; expected smooth, elasto_plastic, lugre"),
        ({"leg_friction_model": 1.5}, "is 1.5; expected smooth, elasto_plastic, lugre"),
        ({"leg_breakaway_share": 1.0}, "is 1; expected at most 0.99"),
        ({"leg_stiffness": 1.0}, "is 1 N/m: the platform would bounce at about 0.09 Hz; expected"),
        ({"leg_stiffness": [1e6, 1e6, 1e6, 0, 1e6, 1e6]}, "is 0 N/m in leg 4: the platform would bounce at about 0 Hz"),
        ({"leg_static_friction": [9, 9, 0, 9, 9, 9]}, "expected six values > 0, or 0 for all legs"),
        ({"leg_static_friction": [9, 9, 2, 9, 9, 9]}, "is 2 N, below leg_coulomb_friction = 2.85 N in leg 3"),
        (
            {"leg_upper_com": [0.5, 0.5, 0.5, 0.5, 9, 0.5]},
            "is 9 m from the platform joint; expected between 0 and leg 5",
        ),
        ({"leg_lower_mass": [1, 2, 3]}, "leg_lower_mass: has shape (3,); expected one number, or six, one per leg"),
        ({"leg_length_max": [4, [4]]}, "leg_length_max: is [4, [4]]; expected one number, or six, one per leg"),
        ({"leg_length_max": [3.9, 3.9, 3.9, 3.9, 3.9, 2.5]}, "leg_length_max: is 2.5 m, but a home leg is 3"),
        ({"leg_length_max": [3.9, 3.9, 3.9, 3.9, -1, 3.9]}, r"leg_length_max[5]: is -1 m; expected > 0"),
    ],
)
def test_impossible_legs_are_refused_with_the_remedy(changed: dict[str, Any], text: str) -> None:
    with pytest.raises(GoughStewartError, match=re.escape(text)):
        replace(UNEVEN, **changed)
