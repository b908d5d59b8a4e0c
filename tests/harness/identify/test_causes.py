"""What is named as wrong with a log: of logs by a Lagrangian that have one known error."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.stats import multivariate_normal

from gough_stewart import Estimate, Log, identify
from gough_stewart.harness.identify.causes import Hypothesis, _refit
from tests.harness.identify.machine_logs import (
    NAMES,
    NOMINAL,
    Course,
    Sensing,
    Swing,
    force_of,
    machine_log,
    random_machine,
)
from tests.harness.identify.model_errors import FEW, Case, Designed, made

DURATION = 7.0  # of logs [s]


@pytest.mark.parametrize(
    ("kind", "seed", "size", "duration"),
    [
        ("gain of a leg", 6001, 1.0, DURATION),
        ("delay of a leg", 6002, 2.0, DURATION),
        ("tilt", 6005, 0.5, DURATION),
        ("stribeck", 6004, 1.0, DURATION),
        ("rows lost", 6006, 0.2, 10.0),
        ("clipping", 6007, 1.0, DURATION),
        ("quadratic friction", 6009, 1.0, DURATION),
        ("coloured noise", 6010, 1.0, DURATION),
    ],
)
def test_one_error_is_named_and_its_size_found(kind: str, seed: int, size: float, duration: float) -> None:
    """Expected: as the log was made; the true size within 4.5 standard errors, which one in 100,000 is not."""
    case = Case(kind, seed, size, designed=bool(seed % 2), duration=duration)
    believed, log, true = made(case)
    estimate = identify(log, believed, case.names)
    assert estimate.diagnosis is not None
    cause, first = estimate.diagnosis.cause, estimate.diagnosis.findings[0]
    assert first.name in true.names
    assert cause in true.causes
    [alarm] = estimate.alarms
    assert f"Most likely: {cause}" in alarm or first.name in alarm
    if first.name in true.truth:
        error = first.values - true.truth[first.name]
        assert (np.abs(error) < 4.5 * first.standard_errors).all()
        # what is said of the first of them, in its unit
        assert kind != "stribeck" or (first.standard_errors < 0.3 * first.values).all()
        said = re.search(r"([+−][\d.]+) ± ([\d.]+) (%|ms|°|N)", first.text)
        assert said is not None, first.text
        of_perfect, factor = {"%": (1.0, 100.0), "ms": (0.0, 1e3), "°": (0.0, 180 / np.pi), "N": (0.0, 1.0)}[said[3]]
        shown = factor * np.array([first.values[0] - of_perfect, 1.96 * first.standard_errors[0]])
        assert [float(text.replace("−", "-")) for text in said.groups()[:2]] == pytest.approx(shown, rel=0.06)


def test_one_leg_is_named_whose_force_is_clipped_below_those_of_others() -> None:
    """Expected: leg 2 and its level, a tenth below its largest force, known to 0.1 %; legs 1 and 5 go beyond it."""
    log = machine_log(course=Course(duration=6.0), seed=1)
    force = force_of(log)
    level = 0.9 * np.abs(force[:, 1]).max()
    clipped = np.clip(force[:, 1], -level, level) + np.random.default_rng(3).normal(
        scale=0.003 * level, size=len(force)
    )
    estimate = identify(replace(log, actuator_force=np.insert(np.delete(force, 1, 1), 1, clipped, 1)), NOMINAL, NAMES)
    assert (np.abs(force[:, [0, 4]]).max(axis=0) > 1.1 * level).all()
    assert estimate.diagnosis is not None
    [finding] = estimate.diagnosis.findings
    assert finding.name == "force of leg 2 clipped"
    assert finding.standard_errors < 1e-3 * level
    assert np.abs(finding.values - level) < 4.5 * finding.standard_errors


def test_a_payload_left_out_is_named_and_never_joints() -> None:
    """Expected: the masses, on the shipped platform along the shipped excitation, with mass and friction estimated."""
    total = NOMINAL.platform_mass + 120.0
    arm = np.array([0.3, -0.2, 0.5]) - NOMINAL.platform_com
    reduced = NOMINAL.platform_mass * 120.0 / total
    inertia = NOMINAL.platform_inertia + reduced * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    com = NOMINAL.platform_com + 120.0 / total * arm
    loaded = replace(NOMINAL, platform_mass=total, platform_com=com, platform_inertia=inertia)
    estimate = identify(machine_log(loaded, Course(Designed(seed=1), DURATION)), NOMINAL, FEW)
    assert estimate.diagnosis is not None
    assert estimate.diagnosis.cause == "payload, centre of mass or inertia"
    assert "joint" not in " ".join(estimate.alarms)
    first = estimate.diagnosis.findings[0]
    values = dict(zip(first.parameters, first.values, strict=True))
    assert values["platform_com[3]"] == pytest.approx(com[2], abs=2e-3)


@pytest.mark.parametrize("kind", ["cable", "all joints"])
def test_what_no_hypothesis_holds_has_no_name(kind: str) -> None:
    """Expected: an alarm; neither a cable's spring nor 36 wrong joints are listed."""
    case = Case(kind, 6011, duration=DURATION)
    believed, log, _ = made(case)
    estimate = identify(log, believed, case.names)
    assert estimate.diagnosis is not None
    assert estimate.diagnosis.cause == ""
    assert "something that" in estimate.alarms[0]


def test_what_is_estimated_is_no_candidate() -> None:
    """Expected: with each leg's friction estimated, a leg that differs is no error, and no friction is tested."""
    believed, log, _ = made(Case("friction of a leg", 6012, duration=DURATION))
    names = ("platform_mass", "leg_viscous_friction[1..6]", "leg_coulomb_friction[1..6]")
    estimate = identify(log, believed, names)
    assert estimate.diagnosis is not None
    assert estimate.diagnosis.test is not None
    assert not estimate.alarms
    assert "friction of each leg" not in estimate.diagnosis.test.p_values


def test_evidence_is_that_of_a_normal_distribution_and_members_share_it() -> None:
    """Expected: densities of residuals beside the fit's columns, of covariance 1 and 1 + X σ² Xᵀ; of seven members."""
    # η and its covariance are those of the posterior, times the variance that is left
    rng = np.random.default_rng(4)
    r, D, X, sizes = rng.normal(size=(20, 6)), rng.normal(size=(20, 6, 2)), rng.normal(size=(20, 6, 3)), np.ones(3) / 5
    r += X @ [0.3, -0.4, 0.1]
    model: Any = SimpleNamespace(residual=lambda theta: r - D @ theta, columns=lambda _: D)
    model.regression = SimpleNamespace(force=r)
    fit = SimpleNamespace(values=np.zeros(2), used=np.ones((20, 6)), is_fitted=np.ones(20, dtype=bool), model=model)
    rows: Any = SimpleNamespace(fit=fit, of=lambda values: values.reshape(120, *values.shape[2:]))
    found = _refit(rows, Hypothesis("", "", (), (), "", X, sizes, 7.0), 100.0)
    N = null_space(D.reshape(120, 2).T)
    left, columns = N.T @ r.ravel(), N.T @ X.reshape(120, 3)
    covariance = np.eye(118) + columns @ np.diag(sizes**2) @ columns.T
    density, alone = (multivariate_normal(cov=V).logpdf(left) for V in (covariance, np.eye(118)))
    expected = 2 * (density - alone - np.log(7.0)) + 100.0 - left @ left
    assert found.evidence == pytest.approx(expected, rel=1e-9)
    posterior = np.linalg.inv(columns.T @ columns + np.diag(sizes**-2))
    np.testing.assert_allclose(found.eta, posterior @ columns.T @ left, rtol=1e-9)
    variance = ((left - columns @ found.eta) ** 2).sum() / (120 - 5)
    np.testing.assert_allclose(found.covariance, variance * posterior, rtol=1e-9)


QUIET = Sensing(force_noise=1e-3)
SHORT, THIRD = Course(Swing(seed=3), 4.0), random_machine(3)[0]
# Errors of which no residual tells: what they change of the log, of its readings, and of what the fit believes.
UNSEEN: dict[str, tuple[dict[str, Any], Callable[[Log], Log], tuple[str, ...]]] = {
    "if all forces read 1 % high": ({"force_gain": 1.01}, lambda log: log, ()),
    "if all encoders read 1 mm too much": ({"length_offset": 1e-3}, lambda log: log, ()),
    "if all encoders read 0.1 % too much": ({}, lambda log: replace(log, leg_length=1.001 * log.leg_length), ()),
    "if the legs were 1 % heavier": ({}, lambda log: log, ("leg_lower_mass", "leg_upper_mass")),
    "if the legs' centres of mass were 1 % further": ({}, lambda log: log, ("leg_lower_com", "leg_upper_com")),
    "if gravity were 1 % higher": ({}, lambda log: log, ("gravity",)),
    "if the clock were 1 % fast": ({}, lambda log: replace(log, time=1.01 * np.asarray(log.time)), ()),
}


@cache
def without_error() -> Estimate:
    return identify(machine_log(THIRD, SHORT, QUIET, seed=5), random_machine(3)[1], NAMES)


@pytest.mark.parametrize(
    "error",
    [
        pytest.param(error, marks=[pytest.mark.evidence] if "legs" in error or "0.1 %" in error else [])
        for error in UNSEEN
    ],
)
def test_what_no_residual_shows_is_told_with_its_size(error: str) -> None:
    """Expected: what the estimates of logs with and without the error differ by."""
    sensing, change, smaller = UNSEEN[error]
    believed = random_machine(3)[1]
    believed = believed.with_parameters({name: getattr(believed, name) / 1.01 for name in smaller})
    right = without_error()
    log = change(machine_log(THIRD, SHORT, replace(QUIET, **sensing), seed=5))
    shift = identify(log, believed, NAMES).values - right.values
    assert right.diagnosis is not None
    [unseen] = [row for row in right.diagnosis.unseen if row.name == error]
    assert np.abs(shift / right.standard_errors).max() > 1.5
    off = np.abs(unseen.shifts - shift) / (0.1 * np.abs(shift) + 0.5 * right.standard_errors)
    assert (off < 1).all(), off
