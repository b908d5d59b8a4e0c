"""Bristles along a log: against small steps of the published law, differences, and distances in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from gough_stewart import Platform, load_preset
from gough_stewart.harness.identify.log import Part
from gough_stewart.harness.identify.row_model import segment_of
from gough_stewart.harness.identify.sticking_friction import StickingFriction, sliding_rows
from tests.harness.identify.machine_logs import MACHINE, Course, force_of, machine_log
from tests.harness.identify.sticking_logs import LEGS, Law
from tests.support.arrays import FloatArray
from tests.support.lagrangian import legs_along

H = 1e-3
NAMES = ("leg_coulomb_friction", "leg_static_friction", "leg_stribeck_velocity")
LAW = Law()
VALUES = np.array([LAW.coulomb, LAW.static, LAW.stribeck_velocity])
DERIVED = load_preset("motion_base").with_parameters(
    {"leg_friction_model": "elasto_plastic", "leg_coulomb_friction": (80 * LEGS).tolist()}
)
PLATFORM = DERIVED.with_parameters({"leg_bristle_stiffness": LAW.stiffness, "leg_bristle_damping": LAW.damping})


def velocities(n: int = 400) -> FloatArray:
    """Legs that reverse at different times, slowly and fast (n, 6)."""
    t = H * np.arange(n)
    size = np.array([0.02, 0.004, 0.001, 0.05, 0.01, 0.002])
    fast = size * np.sin(2 * np.pi * np.outer(t, [2, 3, 1, 1, 3, 2]))
    return np.asarray(fast + 3e-4 * np.cos(2 * np.pi * 7 * t)[:, None])


@pytest.mark.parametrize("law", [LAW, Law(is_lugre=True)])
def test_bristles_are_those_of_small_steps_of_the_published_law(law: Law) -> None:
    """Expected: the test's own integration of the papers' equations, to 2 % of a leg's presliding, 0.1 % RMS."""
    platform = replace(PLATFORM, leg_friction_model=2.0) if law.is_lugre else PLATFORM
    z = StickingFriction(platform, NAMES).bent(VALUES, velocities(), H)[:, :, 0]
    expected = law.bent(velocities(), H)
    assert np.abs(z - expected).max() < 0.02 * law.coulomb / law.stiffness
    assert np.sqrt(((z - expected) ** 2).mean()) < 1e-3 * law.coulomb / law.stiffness


@pytest.mark.parametrize("platform", [PLATFORM, DERIVED])
def test_friction_is_differentiated_by_its_parameters(platform: Platform) -> None:
    """Expected: central differences of the force; presliding of the platform's, or that follows from the friction."""
    friction, v = StickingFriction(platform, NAMES), velocities()
    force = friction.force(VALUES, v, H)
    for k, value in enumerate(VALUES):
        step = 1e-4 * value * np.eye(3)[k]
        ends = [friction.force(VALUES + s * step, v, H)[:, :, 0] for s in (1, -1)]
        expected = (ends[0] - ends[1]) / (2e-4 * value)
        assert np.abs(force[:, :, 1 + k] - expected).max() < 1e-5 * np.abs(expected).max()


def test_slopes_by_length_and_rows_that_slide_are_those_of_closed_forms() -> None:
    """Expected: σ0 and σ1 within the elastic range; −2 v/v_s² (F_s − F_c) e^(−(v/v_s)²) in steady sliding."""
    # A leg slides four presliding distances of 10 µm after a reversal, 4 rows at 10 mm/s; leg 2 reverses once more.
    friction = StickingFriction(PLATFORM, NAMES)
    stuck = friction.by_lengths(VALUES, np.full((3, 6), 1e-4), H)
    np.testing.assert_allclose(stuck[-1], np.tile([LAW.stiffness, LAW.damping], (6, 1)))
    v = 3e-3
    slid = friction.by_lengths(VALUES, np.full((200, 6), v), H)[-1]
    r = v / LAW.stribeck_velocity
    slope = -2 * r / LAW.stribeck_velocity * (LAW.static - LAW.coulomb) * LEGS * np.exp(-(r**2))
    np.testing.assert_allclose(slid[:, 1], slope, rtol=1e-6)
    np.testing.assert_allclose(slid[:, 0], 0.0, atol=1e-4 * LAW.stiffness)
    turning = np.full((12, 6), 0.01)
    turning[6:, 1] *= -1
    slides = sliding_rows(DERIVED, turning, H)
    np.testing.assert_array_equal(slides[:, 0], [0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1])
    np.testing.assert_array_equal(slides[:, 1], [0, 0, 0, 0, 1, 1, 0, 0, 0, 0, 1, 1])
    # 150 N at 1e7 N/m are 15 µm, of which four are 60 µm, after six rows of 11 µm
    stronger = PLATFORM.with_parameters({"leg_static_friction": 150.0})
    np.testing.assert_array_equal(sliding_rows(stronger, np.full((9, 6), 0.011), H)[:, 0], [0] * 5 + [1] * 4)


@pytest.mark.parametrize("smoothing", [1e-4, 1e3])
def test_a_leg_slides_above_the_smaller_of_two_velocities(smoothing: float) -> None:
    """Expected: ten smoothing velocities or a tenth of the RMS velocity, by a fifth, for the filter's lobe of 32 ms."""
    course = Course(duration=4.0)
    log, time = machine_log(course=course), np.linspace(0.0, 3.999, 4000)
    speed = np.abs(legs_along(MACHINE, course.swing.along(MACHINE, time, 4.0))[1])
    part = Part(time, log.leg_length, force_of(log))
    rows = segment_of(part, replace(MACHINE, leg_friction_velocity=smoothing), 20.0)
    at, limit = np.rint(rows.time / H).astype(int), np.minimum(10 * smoothing, 0.1 * np.sqrt((speed**2).mean(axis=0)))
    slowest = np.stack([speed[k - 32 : k + 33].min(axis=0) for k in at])
    assert set(rows.sliding[slowest > 1.2 * limit]) == {1.0}
    assert not rows.sliding[speed[at] < 0.8 * limit].any()
