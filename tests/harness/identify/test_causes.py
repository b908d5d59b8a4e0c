"""What is named as wrong with a log: of logs by a Lagrangian that have one known error."""

from dataclasses import replace

import numpy as np
import pytest

from gough_stewart import identify
from tests.support.machine_logs import NAMES, NOMINAL, Course, Sensing, Swing, machine_log, random_machine
from tests.support.model_errors import FEW, Case, Designed, made


@pytest.mark.parametrize(
    ("kind", "seed", "size"),
    [
        ("gain of a leg", 6001, 1.0),
        ("delay of a leg", 6002, 2.0),
        ("tilt", 6005, 0.5),
        ("rows lost", 6006, 0.2),
        ("clipping", 6007, 1.0),
        ("quadratic friction", 6009, 1.0),
        ("coloured noise", 6010, 1.0),
    ],
)
def test_one_error_is_named_and_its_size_found(kind: str, seed: int, size: float) -> None:
    """Expected: as the log was made; the true size within 4.5 standard errors, which one in 100,000 is not."""
    case = Case(kind, seed, size, designed=bool(seed % 2))
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


def test_a_payload_left_out_is_named_and_never_joints() -> None:
    """Expected: the masses, on the shipped platform along the shipped excitation, with mass and friction estimated."""
    total = NOMINAL.platform_mass + 120.0
    arm = np.array([0.3, -0.2, 0.5]) - NOMINAL.platform_com
    reduced = NOMINAL.platform_mass * 120.0 / total
    inertia = NOMINAL.platform_inertia + reduced * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    com = NOMINAL.platform_com + 120.0 / total * arm
    loaded = replace(NOMINAL, platform_mass=total, platform_com=com, platform_inertia=inertia)
    estimate = identify(machine_log(loaded, Course(Designed(seed=1))), NOMINAL, FEW)
    assert estimate.diagnosis is not None
    assert estimate.diagnosis.cause == "payload, centre of mass or inertia"
    assert "joint" not in " ".join(estimate.alarms)
    first = estimate.diagnosis.findings[0]
    values = dict(zip(first.parameters, first.values, strict=True))
    assert values["platform_com[3]"] == pytest.approx(com[2], abs=2e-3)


@pytest.mark.parametrize("kind", ["cable", "all joints"])
def test_what_no_hypothesis_holds_has_no_name(kind: str) -> None:
    """Expected: an alarm; neither a cable's spring nor 36 wrong joints are listed."""
    case = Case(kind, 6011)
    believed, log, _ = made(case)
    estimate = identify(log, believed, case.names)
    assert estimate.diagnosis is not None
    assert estimate.diagnosis.cause == ""
    assert "something that" in estimate.alarms[0]


def test_what_is_estimated_is_no_candidate() -> None:
    """Expected: with each leg's friction estimated, a leg that differs is no error, and no friction is tested."""
    believed, log, _ = made(Case("friction of a leg", 6012))
    names = ("platform_mass", "leg_viscous_friction[1..6]", "leg_coulomb_friction[1..6]")
    estimate = identify(log, believed, names)
    assert estimate.diagnosis is not None
    assert estimate.diagnosis.test is not None
    assert not estimate.alarms
    assert "friction of each leg" not in estimate.diagnosis.test.p_values


def test_what_no_residual_shows_is_told_with_its_size() -> None:
    """Expected: a log whose forces read 1 % high, less what the table says of 1 %, gives the estimates without that."""
    machine, believed = random_machine(3)
    right, high = (
        identify(
            machine_log(machine, Course(Swing(seed=3)), Sensing(force_gain=gain, force_noise=1e-3), seed=5),
            believed,
            NAMES,
        )
        for gain in (1.0, 1.01)
    )
    assert high.diagnosis is not None
    [unseen] = [row for row in high.diagnosis.unseen if row.name == "if all forces read 1 % high"]
    shift = high.values - right.values
    assert abs(shift[0]) > 50 * high.standard_errors[0]
    assert (np.abs(unseen.shifts - shift) < 0.02 * np.abs(shift) + 0.3 * high.standard_errors).all()
