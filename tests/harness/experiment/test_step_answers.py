"""Answers of a closed loop to a step: as long as something is to be seen."""

import math
from typing import Any

import control
import numpy as np
import pytest

from gough_stewart.harness.experiment.margins_report import step_answers


def diagonal(one: Any) -> Any:
    return control.append(*[control.ss(one)] * 6)


def last_time(L: Any) -> float:
    return float(step_answers(L)[0][-1])


def test_a_mode_of_years_does_not_stretch_the_step() -> None:
    """Expected: 10/(s + 1) closed has settled at 6/11 s, and the picture ends when nothing is to be seen any more."""
    slow = control.sample_system(control.ss(control.tf([1e-4], [1, 1e-9]) + control.tf([10], [1, 1])), 1e-3)
    assert 0.3 < last_time(diagonal(slow)) < 3


@pytest.mark.parametrize("sign", [1, -1])
def test_a_step_that_settles_slowly_is_shown_to_its_end_from_above_and_below(sign: int) -> None:
    """Expected: its slow exponential falls below 0.01 after ln(100 |c|)/p, by residues; half as long again is shown."""
    # L = k (s + z)/(s (s + q)), so T = k (s + z)/(s² + (q + k) s + k z): fast at first, then slowly to 1
    k, z, q = 2.0, (0.05 if sign > 0 else 0.4), (0.01 if sign > 0 else 1.0)
    L = control.sample_system(control.ss(control.tf([k, k * z], [1, q, 0])), 1e-2)
    slow, fast = sorted(np.roots([1, q + k, k * z]).real, key=abs)
    residue = k * (slow + z) / (slow * (slow - fast))
    assert np.sign(residue) == sign
    settled = math.log(abs(residue) / 0.01) / -slow
    end = last_time(diagonal(L))
    assert 0.8 * 1.5 * settled < end < 1.05 * 1.5 * settled
