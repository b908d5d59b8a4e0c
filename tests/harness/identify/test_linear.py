"""Linear identification: of logs that another formulation, another friction and other joints have made."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from gough_stewart.harness.errors import IdentificationError, LogError
from gough_stewart.harness.identify.identify import identify
from gough_stewart.harness.identify.log import Log
from gough_stewart.harness.identify.names import value_of
from gough_stewart.harness.identify.regressor import (
    elements_of,
    gradient,
    linear_parameters,
    regressor,
)
from gough_stewart.harness.motion.references import Circle
from gough_stewart.model.dynamics import Acceleration, inverse_dynamics
from gough_stewart.model.formulations import newton_euler
from gough_stewart.model.platform import platform_from_toml, platform_to_toml
from gough_stewart.model.rotations import matrix_from_orientation
from tests.harness.identify.machine import NOMINAL, RATE, TRUE, frictionless_forces, legs, lugre, machine_log
from tests.support.uneven import INPUTS, STATE, UNEVEN

NAMES = ["platform_mass", "platform_com", "platform_inertia", "leg_viscous_friction", "leg_coulomb_friction"]


def test_regressor_times_parameters_are_the_forces_of_newton_and_euler() -> None:
    """Expected: the forces under which thirteen free bodies have this acceleration."""
    F = INPUTS.actuator_force
    none = np.zeros(3)
    R = matrix_from_orientation(STATE.orientation)
    found = newton_euler.solve(UNEVEN, STATE.position, R, STATE.velocity, STATE.angular_velocity, F, none, none)
    state = type(STATE)(*(part[None] for part in STATE))
    W = regressor(UNEVEN, state, Acceleration(found.linear[None], found.angular[None]))
    np.testing.assert_allclose((W @ linear_parameters(elements_of(UNEVEN)))[0], F, rtol=1e-9)


def test_gradient_of_the_linear_parameters_is_that_of_differences() -> None:
    """Expected: forces of platforms that differ in one element, by the physics, over the difference."""
    state = type(STATE)(*(part[None] for part in STATE))
    acceleration = Acceleration(np.array([[0.7, -0.4, 1.1]]), np.array([[0.5, 0.9, -0.6]]))
    names = ["platform_mass", "platform_com[2]", "leg_upper_com", "leg_lower_com", "leg_coulomb_friction"]
    found = regressor(UNEVEN, state, acceleration)[0] @ gradient(elements_of(UNEVEN), names)
    for k, name in enumerate(names):
        h = 1e-5
        stem = name.partition("[")[0]
        step = h * np.array([0.0, 1.0, 0.0]) if name != stem else h
        ends = [replace(UNEVEN, **{stem: getattr(UNEVEN, stem) + sign * step}) for sign in (1, -1)]
        after, before = (np.asarray(inverse_dynamics(end, state, acceleration))[0] for end in ends)
        np.testing.assert_allclose(found[:, k], (after - before) / (2 * h), rtol=1e-6, atol=1e-6)


def test_payload_com_and_friction_of_a_foreign_machine_are_found_to_half_a_percent_a_millimetre_and_three_percent() -> (
    None
):
    """Expected: the machine's own: mass to 0.5 %, centre of mass to 1 mm, friction to 3 %; joints 50 µm off."""
    rng = np.random.default_rng(7)
    machine = replace(
        TRUE,
        base_points=TRUE.base_points + 5e-5 * rng.standard_normal((6, 3)),
        platform_points=TRUE.platform_points + 5e-5 * rng.standard_normal((6, 3)),
    )
    found = identify(machine_log(machine, friction=lugre(560.0, 130.0)), NOMINAL, NAMES)
    assert abs(found["platform_mass"][0] / TRUE.platform_mass - 1) < 0.005
    np.testing.assert_allclose(found["platform_com"], TRUE.platform_com, atol=1e-3)
    assert abs(found["leg_viscous_friction"][0] / 560.0 - 1) < 0.03
    assert abs(found["leg_coulomb_friction"][0] / 130.0 - 1) < 0.03
    assert found.residuals.validation_rms is not None
    assert (found.residuals.validation_rms < 0.02 * found.residuals.signal_rms).all()


@pytest.mark.evidence
def test_errors_of_estimates_are_as_large_as_their_covariance_says() -> None:
    """Expected: of six logs the sum of (θ̂ − θ)ᵀ C⁻¹ (θ̂ − θ) is χ² of 72 degrees, within its quantiles 5e-4, 1 − 5e-4.

    One right program in 1000 fails; intervals that are 30 % too narrow or too wide do.
    """
    distance = 0.0
    for seed in range(6):
        found = identify(machine_log(duration=8.0, seed=seed), NOMINAL, NAMES)
        error = found.values - np.array([value_of(TRUE, name) for name in found.names])
        distance += float(error @ np.linalg.solve(found.covariance, error))
    assert chi2.ppf(5e-4, 72) < distance < chi2.isf(5e-4, 72)


def test_friction_of_each_leg_is_found_apart() -> None:
    """Expected: the six of the machine, to 3 %; the platform that results has them, read back from its file."""
    six = np.array([430.0, 520.0, 610.0, 480.0, 700.0, 560.0])
    log = machine_log(duration=8.0, friction=lambda v, _step: six * v)
    found = identify(log, replace(NOMINAL, leg_coulomb_friction=0.0), ["leg_viscous_friction[1..6]", *NAMES[:3]])
    np.testing.assert_allclose(found["leg_viscous_friction"], six, rtol=0.03)
    platform = platform_from_toml(platform_to_toml(found.platform(NOMINAL)))
    own = platform.leg_viscous_friction * platform.leg_viscous_friction_factor
    np.testing.assert_allclose(own, found["leg_viscous_friction"], rtol=1e-12)


def circle_log() -> Log:
    """A machine on a circle, which never turns."""
    circle = Circle(radius=0.15, frequency=0.4, fade_in=1.0).about(NOMINAL)
    time = np.arange(0.0, 6.0, 1 / RATE)
    coarse = time[::40]
    force = frictionless_forces(TRUE, circle(coarse))
    rows = np.stack([np.interp(time, coarse, f) for f in force.T], axis=1)
    noise = np.random.default_rng(1).standard_normal(rows.shape)
    return Log(legs(TRUE, circle, time)[0], time, rows + 40.0 * noise)


def test_what_a_motion_that_does_not_turn_cannot_tell_has_no_number() -> None:
    """Expected: no products and moments of inertia, which act on rotations only; the others within their intervals."""
    found = identify(circle_log(), NOMINAL, NAMES)
    assert found.not_excited == tuple(name for name in found.names if name.startswith("platform_inertia"))
    assert np.isnan(found["platform_inertia"]).all()
    assert abs(found["platform_mass"][0] - TRUE.platform_mass) < 4 * found.standard_errors[0]
    np.testing.assert_array_equal(found.platform(NOMINAL).platform_inertia, NOMINAL.platform_inertia)
    with pytest.raises(IdentificationError, match=r"too little excitation.*none of platform_inertia") as caught:
        identify(circle_log(), NOMINAL, "platform_inertia")
    assert all("platform_inertia" in name for name in caught.value.names)


def test_what_acts_as_another_parameter_does_is_refused() -> None:
    """Expected: of both inertias of a leg the equations hold the sum only."""
    with pytest.raises(IdentificationError, match=r"leg_\w+_inertia has the same effect as a combination of leg_"):
        identify(machine_log(duration=8.0), NOMINAL, ["leg_lower_inertia", "leg_upper_inertia"])


def test_an_inertia_that_no_body_has_is_kept_physical() -> None:
    """Expected: a platform that its own checks take, where noise alone would have made an impossible one."""
    thin = replace(TRUE, platform_inertia=np.diag([380.0, 1.0, 380.9]))
    log = machine_log(thin, duration=8.0, force_noise=0.1)
    found = identify(log, NOMINAL, NAMES)
    assert found.at_bound == tuple(name for name in found.names if name.startswith("platform_inertia"))
    assert np.isnan(found.interval[[name in found.at_bound for name in found.names]]).all()
    assert np.isfinite(found.interval[0]).all()
    assert found.platform(NOMINAL).platform_inertia.shape == (3, 3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda log: replace(log, leg_length=1e3 * log.leg_length), r"They look like mm: write the unit"),
        (lambda log: replace(log, actuator_force=log.actuator_force / 1e3), r"They look like kN"),
        (lambda log: replace(log, actuator_force=20 * log.actuator_force), r"exceeds actuator_force_max, 20000 N"),
        (lambda log: replace(log, actuator_force=None), r"no forces; expected columns actuator_force"),
        (lambda log: replace(log, time=1e3 * log.time), "If time is in ms, name the column"),
        (lambda log: replace(log, time=None), "no column time"),
        (
            lambda log: replace(log, time=np.where(np.arange(len(log)) > 500, log.time + 2e-4, log.time)),
            r"a step of 0\.0012 s after row 501",
        ),
        (
            lambda log: replace(log, time=np.where(np.arange(len(log)) == 40, 0.0, log.time)),
            "expected increasing times",
        ),
        (lambda log: log.rows(slice(0, 40)), "are shorter than the filter"),
        (lambda log: replace(log, leg_length=log.leg_length + np.array([1, -1, 1, -1, 1, -1])), "no pose of this"),
        (
            lambda log: replace(log, leg_length=log.leg_length[:, [1, 0, 3, 2, 5, 4]]),
            "the log contradicts this platform",
        ),
    ],
)
def test_a_log_that_no_such_machine_has_made_is_refused(change, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(LogError, match=message):
        identify(change(machine_log(duration=8.0)), NOMINAL, "platform_mass")


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ("platform_mas", "did you mean 'platform_mass'"),
        ("platform_mass,platform_mass", "platform_mass is repeated"),
        ("platform_com[4]", r"no element 'platform_com\[4\]'"),
        ("leg_viscous_friction,leg_viscous_friction[2]", "is repeated"),
    ],
)
def test_names_that_cannot_be_estimated_are_refused(names: str, message: str) -> None:
    with pytest.raises(IdentificationError, match=message):
        identify(machine_log(duration=8.0), NOMINAL, names)


@pytest.mark.parametrize(
    ("estimate", "message"),
    [
        (
            "platform_mass,leg_friction_velocity",
            r"leg_friction_velocity is .* a constant that smooths .* set it in the",
        ),
        ("gravity", r"gravity\[1\] is not estimated from forces: it is set in the platform; .* estimate base_tilt"),
        (["platform_mass", "base_points[2,3]"], r"base_points\[2,3\] is .* need measured poses: estimate them alone"),
        ("platform_mass,leg_length_offset", r"leg_length_offset\[1\] is .* need measured poses: estimate them alone"),
        (
            "leg_bristle_stiffness",
            r"leg_bristle_stiffness is .* presliding is set in the platform; .*leg_static_friction",
        ),
        ("leg_bristle_damping", r"presliding is set in the platform"),
        ("leg_breakaway_share", r"presliding is set in the platform"),
    ],
)
def test_what_forces_do_not_tell_is_refused_with_what_serves_instead(estimate: str | list[str], message: str) -> None:
    """Expected: one error, before the log is read."""
    with pytest.raises(IdentificationError, match=message):
        identify("there is no such log", NOMINAL, estimate)


def test_an_option_of_the_other_method_and_a_method_that_there_is_not_are_refused() -> None:
    with pytest.raises(
        IdentificationError, match=r"'output_error'; expected linear, for masses, .* or geometry, for jo"
    ):
        identify("no log", NOMINAL, "platform_mass", "output_error")  # type: ignore[arg-type]
    with pytest.raises(IdentificationError, match="accuracy is an option of method geometry only; this one is linear"):
        identify("no log", NOMINAL, "platform_mass", accuracy=(1e-5, 1e-4, None))
    with pytest.raises(IdentificationError, match="cutoff is an option of method linear only; this one is geometry"):
        identify("no log", NOMINAL, "base_points", cutoff=20.0)
