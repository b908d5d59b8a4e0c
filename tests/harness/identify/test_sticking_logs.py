"""Stiction from logs: forces of a Lagrangian, bristles of the published law, legs that differ."""

from dataclasses import replace

import numpy as np
import pytest

from gough_stewart import GoughStewartError, identify
from gough_stewart.harness.identify.screen import cutoff_within_noise
from tests.harness.identify.machine_logs import MACHINE, Swing
from tests.harness.identify.sticking_logs import LEGS, Law, sticking_log

# What is known: the machine but for its friction, of which the legs' proportions are.
NOMINAL = replace(MACHINE, leg_coulomb_friction=0.0).with_parameters(
    {"leg_friction_model": "elasto_plastic", "leg_coulomb_friction": (120 * LEGS).tolist()}
)
TRUE = {
    "platform_mass": MACHINE.platform_mass,
    "leg_viscous_friction": MACHINE.leg_viscous_friction,
    "leg_coulomb_friction": Law().coulomb,
    "leg_static_friction": Law().static,
    "leg_stribeck_velocity": Law().stribeck_velocity,
}


def test_a_slow_log_shows_how_legs_stick() -> None:
    """Expected: the machine's parameters, within their intervals but for a chance of 1 in 1000; no alarm."""
    known = NOMINAL.with_parameters({"leg_bristle_stiffness": Law().stiffness, "leg_bristle_damping": Law().damping})
    log = sticking_log(duration=6.0)
    estimate = identify(log, known, list(TRUE))
    assert estimate.alarms == ()
    truth = np.array(list(TRUE.values()))
    assert (np.abs(estimate.values - truth) < 4 * estimate.standard_errors).all()
    assert (estimate.standard_errors[2:] < np.array([0.01, 0.01, 0.05]) * truth[2:]).all()
    assert estimate.platform(known).leg_static_friction == estimate["leg_static_friction"][0]
    # noise of the lengths through the filter makes a force of 3/1000 of the forces' changes, on what a leg moves
    size = 2e-6
    noisy = log.leg_length + size * np.random.default_rng(1).standard_normal(log.leg_length.shape)
    cutoff = cutoff_within_noise(replace(log, leg_length=noisy), MACHINE)
    moved = MACHINE.platform_mass / 6 + MACHINE.leg_upper_mass + MACHINE.leg_armature
    noise = moved * (2 * np.pi * cutoff) ** 2 * size * np.sqrt(2 * cutoff / 500 / 5)
    change = np.asarray(log.actuator_force).std(axis=0).mean()
    assert noise == pytest.approx(0.003 * change, rel=0.1)


@pytest.mark.evidence
def test_a_fast_log_shows_no_number_that_it_does_not_support() -> None:
    """Expected: reversals in milliseconds do not show static friction; Coulomb friction is right."""
    fast = Swing(seed=5, frequency=0.4, size=0.03)
    log = sticking_log(Law(stribeck_velocity=3e-4, stiffness=np.inf), fast, 4.0, noise=0.02)
    estimate = identify(log, NOMINAL, list(TRUE))
    assert set(estimate.not_excited) == {"leg_static_friction", "leg_stribeck_velocity"}
    assert np.isnan(estimate["leg_static_friction"]).all()
    coulomb = estimate.names.index("leg_coulomb_friction")
    assert abs(estimate.values[coulomb] - Law().coulomb) < 4 * estimate.standard_errors[coulomb]
    assert any("not shown by this log" in note for note in estimate.notes)
    # what has no number stays as it was
    assert estimate.platform(NOMINAL).leg_static_friction == 0.0
    with pytest.raises(GoughStewartError, match=r"not shown by this log.*leg_static_friction.*Slow motions"):
        identify(log, NOMINAL, ["leg_static_friction"])


@pytest.mark.evidence
def test_each_leg_has_its_own_coulomb_friction() -> None:
    """Expected: that of each leg, from a platform that believes them equal; reversals take no part."""
    equal = NOMINAL.with_parameters({"leg_coulomb_friction": 120.0})
    law = Law(static=100.0)
    estimate = identify(sticking_log(law, duration=6.0), equal, ["leg_viscous_friction", "leg_coulomb_friction[1..6]"])
    error = estimate["leg_coulomb_friction"] - law.coulomb * LEGS
    assert (np.abs(error) < 4 * estimate.standard_errors[1:]).all()
    assert np.abs(error).max() < 2.0
    mean = estimate["leg_coulomb_friction"].mean()
    np.testing.assert_allclose(
        estimate.platform(equal).leg_coulomb_friction_factor, estimate["leg_coulomb_friction"] / mean
    )
