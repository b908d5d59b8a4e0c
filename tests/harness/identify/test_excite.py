"""Excitation: from rest to rest, exact derivatives, within limits, better conditioned than a circle."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from gough_stewart import Circle, GoughStewartError, Log, excite, identify, load_preset
from gough_stewart.harness.identify.excite import criteria, within_limits
from gough_stewart.harness.identify.names import expanded
from tests.support.lagrangian import Pose, forces_along, legs_along
from tests.support.machine_logs import Course, friction
from tests.support.uneven import UNEVEN


def test_the_best_motion_keeps_all_limits_and_tells_ten_times_more_than_a_circle() -> None:
    """Expected: limits looked at ten times as finely as the search did; condition numbers of one measure."""
    platform = replace(load_preset("motion_base"), actuator_force_max=9000.0)
    everything = "platform_mass,platform_com,platform_inertia"
    design = excite(platform, everything, duration=5.0, frequency=0.2, harmonics=3, trials=1, seed=2)
    found = design.reference.about(platform)
    time = np.linspace(0, 5, 1500)
    assert within_limits(platform, time, found(time))
    circle = Circle(radius=0.2, frequency=0.4, fade_in=1.0).about(platform)
    names = expanded(everything.split(","), platform)
    of_circle, of_found = (criteria(platform, names, motion(time))[0] for motion in (circle, found))
    assert of_circle > 10 * of_found


def test_the_same_seed_gives_the_same_motion_and_another_another() -> None:
    platform = load_preset("liu2000")
    first, second, other = (
        excite(platform, "platform_mass", duration=3.0, frequency=0.4, harmonics=2, trials=1, seed=s) for s in (4, 4, 5)
    )
    np.testing.assert_array_equal(first.reference.coefficients, second.reference.coefficients)
    assert np.abs(np.subtract(first.reference.coefficients, other.reference.coefficients)).max() > 1e-3


def test_a_platform_that_cannot_hold_itself_has_no_motion() -> None:
    """Expected: a refusal with the platform and the parameters; no actuator carries the platform with 1 N."""
    weak = replace(UNEVEN, actuator_force_max=1.0)
    with pytest.raises(GoughStewartError, match="no motion was found within the limits of uneven that excites plat"):
        excite(weak, "platform_mass", duration=3.0, trials=2)


def test_promised_errors_are_those_of_a_log() -> None:
    """Expected: standard errors of a log of the motion, by a Lagrangian, with the noise that the promise states."""
    platform = load_preset("motion_base")
    names = "platform_mass,platform_com,platform_inertia,leg_viscous_friction,leg_coulomb_friction"
    found = excite(platform, names, duration=5.0, frequency=0.4, harmonics=2, trials=1, seed=1)
    time, reference, h = np.arange(5000) / 1000, found.reference.about(platform), 1e-4

    def pose(at: np.ndarray) -> np.ndarray:
        motion = reference(at)
        return np.concatenate([motion.position, motion.orientation], axis=1)

    coarse = np.arange(-0.05, 5.06, 0.01)
    q, after, before = pose(coarse), pose(coarse + h), pose(coarse - h)
    smooth = replace(platform, leg_viscous_friction=0.0, leg_coulomb_friction=0.0)
    along = Pose(q, (after - before) / (2 * h), (after - 2 * q + before) / h**2)
    force = make_interp_spline(coarse, forces_along(smooth, along), k=3)(time)
    length, velocity = legs_along(
        platform, Pose(pose(time), (pose(time + h) - pose(time - h)) / (2 * h), 0 * pose(time))
    )
    force = force + friction(platform, Course(), velocity)
    rng = np.random.default_rng(3)
    force = force + 0.01 * np.sqrt((force**2).mean(axis=0)) * rng.standard_normal(force.shape)
    log = Log(1e-6 * np.rint(length / 1e-6), time, force)
    errors = identify(log, platform, names, validation=0.0).standard_errors
    np.testing.assert_allclose(found.standard_errors, errors, rtol=0.1)
