"""Stiction from logs: forces of a Lagrangian, bristles of the published law, legs that differ."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from gough_stewart import Estimate, Log, identify
from gough_stewart.harness.errors import IdentificationError
from gough_stewart.harness.identify.identify import not_shown
from gough_stewart.harness.identify.lowpass import cutoff_of, smoothed
from gough_stewart.harness.identify.screen import cutoff_within_noise
from tests.support.machine_logs import MACHINE, Swing
from tests.support.sticking_logs import LEGS, RATE, Law, sticking_log

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
    found = identify(sticking_log(), known, list(TRUE))
    assert found.alarms == ()
    truth = np.array(list(TRUE.values()))
    assert (np.abs(found.values - truth) < 4 * found.standard_errors).all()
    shares = found.standard_errors / truth
    assert shares[2] < 0.01
    assert shares[3] < 0.01
    assert shares[4] < 0.05
    assert found.platform(known).leg_static_friction == found["leg_static_friction"][0]
    quiet, usual = cutoff_within_noise(sticking_log(), MACHINE), cutoff_of(sticking_log().leg_length, 1 / RATE)
    assert quiet < 0.9 * usual
    assert any(f"rows of {quiet:.3g} Hz fitted" in note for note in found.notes)


@pytest.mark.parametrize("sigma", [2e-6, 1e-5])
def test_noise_of_the_lengths_makes_a_force_of_three_thousandths_of_the_forces_changes(sigma: float) -> None:
    """Expected: the noise through the filter, differentiated twice, times the mass that a leg moves."""
    time = np.arange(6000) / 1000
    motion = np.sin(2 * np.pi * 0.4 * time)[:, None] * np.ones(6)
    noise = sigma * np.random.default_rng(3).standard_normal(motion.shape)
    cutoff = cutoff_within_noise(Log(3 + 0.02 * motion + noise, time, 4000 + 300 * motion), MACHINE)
    moved = MACHINE.platform_mass / 6 + MACHINE.leg_upper_mass + MACHINE.leg_armature
    force = moved * smoothed(noise, 1e-3, cutoff, 1, 2).std()
    assert force == pytest.approx(0.003 * 300 * motion.std(), rel=0.2)
    # without noise the motion decides
    still = Log(3 + 0.02 * motion, time, 4000 + 300 * motion)
    assert cutoff_within_noise(still, MACHINE) == cutoff_of(still.leg_length, 1e-3)


def test_a_fast_log_shows_no_number_that_it_does_not_support() -> None:
    """Expected: reversals in milliseconds do not show static friction; Coulomb friction is right."""
    fast = Swing(seed=5, frequency=0.4, size=0.03)
    log = sticking_log(Law(stribeck_velocity=3e-4, stiffness=np.inf), fast, 4.0, noise=0.02)
    found = identify(log, NOMINAL, list(TRUE))
    assert set(found.not_excited) == {"leg_static_friction", "leg_stribeck_velocity"}
    assert np.isnan(found["leg_static_friction"]).all()
    coulomb = found.names.index("leg_coulomb_friction")
    assert abs(found.values[coulomb] - Law().coulomb) < 4 * found.standard_errors[coulomb]
    assert any("not shown by this log" in note for note in found.notes)
    # what has no number stays as it was
    assert found.platform(NOMINAL).leg_static_friction == 0.0
    with pytest.raises(IdentificationError, match=r"not shown by this log.*Slow motions") as caught:
        identify(log, NOMINAL, ["leg_static_friction"])
    assert "leg_static_friction" in caught.value.names


@pytest.mark.evidence
def test_each_leg_has_its_own_coulomb_friction() -> None:
    """Expected: that of each leg, from a platform that believes them equal; reversals take no part."""
    equal = NOMINAL.with_parameters({"leg_coulomb_friction": 120.0})
    law = Law(static=100.0)
    found = identify(sticking_log(law, duration=6.0), equal, ["leg_viscous_friction", "leg_coulomb_friction[1..6]"])
    error = found["leg_coulomb_friction"] - law.coulomb * LEGS
    assert (np.abs(error) < 4 * found.standard_errors[1:]).all()
    assert np.abs(error).max() < 2.0
    np.testing.assert_allclose(
        found.platform(equal).leg_coulomb_friction_factor,
        found["leg_coulomb_friction"] / found["leg_coulomb_friction"].mean(),
    )


@pytest.mark.parametrize(("static", "is_shown"), [(103.9, False), (104.1, True)])
@pytest.mark.parametrize("spread", [1.0, 0.1])
def test_static_friction_shows_from_four_standard_errors_above_coulomb_friction(
    static: float, is_shown: bool, spread: float
) -> None:
    """Expected: 4 standard errors of the difference, whose two halves are not correlated; without it no velocity."""
    names = ("leg_coulomb_friction", "leg_static_friction", "leg_stribeck_velocity")
    values = np.array([100.0, 100.0 + (static - 100.0) * spread, 2e-3])
    errors = np.array([0.6 * spread, 0.8 * spread, 1e-5])
    fit = SimpleNamespace(names=names, values=values, standard_errors=errors, covariance=np.diag(errors**2))
    assert not_shown(cast(Estimate, fit)) == (() if is_shown else names[1:])
