"""Slow evidence: how often intervals cover the truth."""

import numpy as np
import pytest

from gough_stewart.harness.identify.identify import identify
from gough_stewart.harness.identify.names import value_of
from tests.harness.identify.machine import NOMINAL, TRUE, machine_log

pytestmark = pytest.mark.evidence
LOGS = 500
NAMES = ["platform_mass", "platform_com", "platform_inertia", "leg_viscous_friction", "leg_coulomb_friction"]


def test_95_percent_intervals_cover_the_truth_in_92_to_98_percent_of_500_logs() -> None:
    """Expected: the machine's parameters inside; its forces are those of Newton and Euler."""
    inside = []
    for seed in range(LOGS):
        found = identify(machine_log(seed=1000 + seed), NOMINAL, NAMES)
        truth = np.array([value_of(TRUE, name) for name in found.names])
        inside.append((found.interval[:, 0] < truth) & (truth < found.interval[:, 1]))
    share = np.mean(inside)
    print(f"{100 * share:.1f} % of intervals cover the truth; by parameter {np.mean(inside, axis=0).round(3).tolist()}")
    assert 0.92 <= share <= 0.98
