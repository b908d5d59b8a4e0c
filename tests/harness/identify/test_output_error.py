"""Output error: exact gradients, and parameters of a foreign machine."""

from dataclasses import replace

import numpy as np

from gough_stewart.harness.identify.identify import identify
from gough_stewart.harness.identify.names import value_of
from gough_stewart.harness.identify.predictor import predictor_inputs
from gough_stewart.harness.identify.simulation import kernel_parameters, simulated
from tests.harness.identify.machine import NOMINAL, TRUE, machine_log

NAMES = ("platform_mass", "platform_com[3]", "leg_viscous_friction", "leg_friction_velocity", "platform_inertia[1,2]")


def test_gradients_are_those_of_differences() -> None:
    """Expected: central differences of the simulation itself, in each parameter's own step."""
    course, _, _ = predictor_inputs(machine_log(duration=8.0), NOMINAL)
    course = course._replace(length=course.length[:40])
    p, directions = kernel_parameters(NOMINAL, NAMES)
    exact = simulated(course, p, directions).sensitivity
    for k, step in enumerate((1e-1, 1e-4, 1e-1, 1e-6, 1e-1)):
        ends = [simulated(course, p + sign * step * directions[:, k], directions[:, :0]).values for sign in (1, -1)]
        difference = (ends[0] - ends[1]) / (2 * step)
        np.testing.assert_allclose(exact[:, :, k], difference, atol=2e-4 * np.abs(difference).max())


def test_a_foreign_machine_is_found_from_wrong_starts() -> None:
    """Expected: the machine's own; and within six of the standard errors that are given."""
    names = ["platform_mass", "platform_com", "leg_viscous_friction", "leg_coulomb_friction"]
    known = replace(NOMINAL, platform_inertia=TRUE.platform_inertia)
    found = identify(machine_log(duration=6.0), known, names, "output_error", starts=2)
    truth = np.array([value_of(TRUE, name) for name in found.names])
    assert (np.abs(found.values - truth) < 6 * found.standard_errors).all()
    assert abs(found["platform_mass"][0] / TRUE.platform_mass - 1) < 0.005
    assert "2 of 2 starts" in " ".join(found.notes)
