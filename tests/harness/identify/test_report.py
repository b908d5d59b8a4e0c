"""The report of an identification as plain data: how well parameters are known, and what the log does not tell."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gough_stewart.harness.identify.causes import Diagnosis
from gough_stewart.harness.identify.estimate import Estimate, Residuals
from gough_stewart.harness.identify.lack_of_fit import LackOfFit
from gough_stewart.harness.identify.report import estimate_report, estimate_verdict

NAMES = ("platform_mass", "leg_viscous_friction", "platform_com[2]", "leg_coulomb_friction")
VALUES, NOMINAL = np.array([1216.93, 512.0, 0.0123, 80.0]), np.array([1200.0, 500.0, 0.0, 100.0])
SIGMA, SCALE = np.array([0.25, 4.0, 0.002, 20.0]), np.array([1200.0, 500.0, 0.5, 100.0])


def made(n: int = 4, **more: Any) -> Estimate:
    rms = Residuals("force of leg", "N", np.ones(6), None, np.ones(6), None)
    whole = Estimate(
        "linear", NAMES[:n], VALUES[:n], NOMINAL[:n], np.diag(SIGMA[:n] ** 2), np.ones(n), np.eye(n), SCALE[:n], n, rms
    )
    return replace(whole, **more)


def test_few_parameters_are_told_with_their_intervals() -> None:
    """Expected: 1.96 standard errors, in two digits, and values to the same decimals."""
    verdict = estimate_verdict(made(2))
    assert verdict.text == (
        "Platform_mass 1216.93 ± 0.49 kg and leg_viscous_friction 512.0 ± 7.8 N·s/m; "
        "whether the model fits the log is not tested"
    )
    assert verdict.status == "marginal"
    mass = verdict.numbers[0]
    assert (mass.path, mass.value) == ("parameters.platform_mass", 1216.93)
    assert (mass.low, mass.high) == pytest.approx((1216.93 - 1.959964 * 0.25, 1216.93 + 1.959964 * 0.25))


def test_of_many_the_well_known_are_counted_and_the_least_known_is_named() -> None:
    """Expected: 0.04, 1.5, 0.8 and 39 % of the larger of value and scale: three of four within 5 %."""
    text = estimate_verdict(made()).text
    assert text.startswith("3 of 4 parameters are known to 5 % or better; least known: leg_coulomb_friction 80 ± 39 N")


def test_what_the_log_does_not_tell_is_said() -> None:
    """Expected: elements without a number, and those at a bound, by name; nothing known at all."""
    values, covariance = VALUES.copy(), np.diag(SIGMA**2)
    values[2] = covariance[2, 2] = np.nan
    found = made(values=values, covariance=covariance, not_excited=(NAMES[2],), at_bound=(NAMES[3],))
    text = estimate_verdict(found).text
    assert "not excited by this motion: platform_com[2]" in text
    assert "at the bound of what is possible: leg_coulomb_friction" in text
    nothing = made(values=np.full(4, np.nan), covariance=np.full((4, 4), np.nan), not_excited=NAMES)
    assert estimate_verdict(nothing).text.startswith("None of the 4 parameters is known")


def test_an_alarm_comes_before_everything() -> None:
    report = estimate_report(made(alarms=("the log contradicts the model",)), "stand")
    assert report.verdict.text == "The log contradicts the model"
    assert report.verdict.status == "bad"
    assert [note.kind for note in report.notes] == ["warning"]
    assert report.title == "Parameters of stand"


def test_a_model_that_fits_makes_known_values_good() -> None:
    test = LackOfFit({"of phase": 0.4}, 0.4)
    diagnosis = Diagnosis(test, "", (), 1.0, (), NAMES[:2], np.ones(2), np.ones(6), 1e-6, np.ones(6))
    verdict = estimate_verdict(made(2, diagnosis=diagnosis))
    assert verdict.text.endswith("the residuals are those of noise")
    assert verdict.status == "good"
