"""What is named as wrong with a log: of logs by a Lagrangian that have one known error."""

from dataclasses import replace

import numpy as np
import pytest

from gough_stewart import Estimate, identify
from gough_stewart.harness.identify.report import estimate_tables
from tests.support.machine_logs import (
    MACHINE,
    NAMES,
    NOMINAL,
    Course,
    Sensing,
    Swing,
    force_of,
    machine_log,
    random_machine,
)
from tests.support.model_errors import FEW, Case, Designed, made


def diagnosed(case: Case) -> tuple[Estimate, str, tuple[str, ...], str]:
    """The estimate; the cause, names of what is found, and the alarm."""
    believed, log, _ = made(case)
    found = identify(log, believed, case.names)
    assert found.diagnosis is not None
    return found, found.diagnosis.cause, tuple(f.name for f in found.diagnosis.findings), " ".join(found.alarms)


@pytest.mark.parametrize(
    ("kind", "seed", "size"),
    [
        ("gain of a leg", 6001, 1.0),
        ("delay of a leg", 6002, 2.0),
        ("encoder's offset", 6004, 1.0),
        ("tilt", 6005, 0.5),
        ("rows lost", 6006, 0.2),
        ("clipping", 6007, 1.0),
        ("clock", 6008, 0.5),
        ("quadratic friction", 6009, 1.0),
        ("coloured noise", 6010, 1.0),
    ],
)
def test_one_error_is_named_and_its_size_found(kind: str, seed: int, size: float) -> None:
    """Expected: as the log was made; the true size within 4.5 standard errors, which one in 100,000 is not."""
    case = Case(kind, seed, size, designed=bool(seed % 2))
    found, cause, names, alarm = diagnosed(case)
    true = made(case)[2]
    assert names[0] in true.names
    assert cause in true.causes
    assert f"Most likely: {cause}" in alarm or names[0] in alarm
    finding = found.diagnosis.findings[0]  # type: ignore[union-attr]
    if names[0] in true.truth:
        error = finding.values - true.truth[names[0]]
        assert (np.abs(error) < 4.5 * finding.standard_errors).all()


def test_a_payload_left_out_is_named_and_never_joints() -> None:
    """Expected: the masses, on the shipped platform along the shipped excitation, with mass and friction estimated."""
    total = NOMINAL.platform_mass + 120.0
    arm = np.array([0.3, -0.2, 0.5]) - NOMINAL.platform_com
    reduced = NOMINAL.platform_mass * 120.0 / total
    inertia = NOMINAL.platform_inertia + reduced * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    com = NOMINAL.platform_com + 120.0 / total * arm
    loaded = replace(NOMINAL, platform_mass=total, platform_com=com, platform_inertia=inertia)
    found = identify(machine_log(loaded, Course(Designed(seed=1))), NOMINAL, FEW)
    assert found.diagnosis is not None
    assert found.diagnosis.cause == "payload, centre of mass or inertia"
    assert "joint" not in " ".join(found.alarms)
    values = dict(zip(found.diagnosis.findings[0].parameters, found.diagnosis.findings[0].values, strict=True))
    assert values["platform_com[3]"] == pytest.approx(com[2], abs=2e-3)


@pytest.mark.parametrize("kind", ["cable", "soft clipping", "all joints"])
def test_what_no_hypothesis_holds_has_no_name(kind: str) -> None:
    """Expected: an alarm; neither a cable's spring, nor 36 wrong joints, nor a sensor that is not linear is listed."""
    _, cause, _, alarm = diagnosed(Case(kind, 6011))
    assert alarm
    assert cause == ""
    assert "something that" in alarm


def test_what_is_estimated_is_no_candidate() -> None:
    """Expected: with each leg's friction estimated, a leg that differs is no error, and no friction is tested."""
    believed, log, _ = made(Case("friction of a leg", 6012))
    each = ("platform_mass", "leg_viscous_friction[1..6]", "leg_coulomb_friction[1..6]")
    found = identify(log, believed, each)
    assert found.diagnosis is not None
    assert found.diagnosis.test is not None
    assert not found.alarms
    assert "friction of each leg" not in found.diagnosis.test.p_values


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
    assert "if all forces read 1 % high" in estimate_tables(high)[-1].rows[0]


def test_bristles_at_a_reversal_are_friction_of_another_law() -> None:
    """Expected: LuGre's bristles build friction up over micrometres; no other family is as likely."""
    slick, course = replace(MACHINE, leg_coulomb_friction=0.0), Course(Swing(seed=3))
    length = machine_log(slick, course, Sensing(length_noise=0.0, encoder=0.0)).leg_length
    z, friction = np.zeros(6), np.zeros_like(length)
    for k, v in enumerate(np.gradient(length, 1e-3, axis=0)):
        decay = np.exp(-2e6 * np.abs(v) * 1e-3 / 130.0)
        z = z * decay + np.sign(v) * 130.0 / 2e6 * (1 - decay)
        friction[k] = 2e6 * z
    log = machine_log(slick, course)
    found = identify(replace(log, actuator_force=force_of(log) + friction), NOMINAL, NAMES)
    assert found.diagnosis is not None
    assert found.diagnosis.alarm
    assert found.diagnosis.cause in ("law of friction", "")
