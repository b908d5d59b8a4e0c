"""Linear identification: of logs that another formulation, another friction and other joints have made."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import t

from gough_stewart import Acceleration, GoughStewartError, IdentificationWarning, identify, inverse_dynamics
from gough_stewart.harness.errors import IdentificationError
from gough_stewart.harness.identify.fit import scales
from gough_stewart.harness.identify.names import expanded
from gough_stewart.harness.identify.regressor import elements_of, gradient, linear_parameters, regressor
from gough_stewart.harness.identify.report import estimate_verdict
from gough_stewart.model.formulations import newton_euler
from gough_stewart.model.rotations import matrix_from_orientation
from tests.support.machine_logs import MACHINE, NAMES, NOMINAL, Course, Sensing, Swing, machine_log
from tests.support.uneven import INPUTS, STATE, UNEVEN


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


def test_payload_com_and_friction_are_found_to_half_a_percent_a_millimetre_and_three_percent() -> None:
    """Expected: the machine's own: mass to 0.5 %, centre of mass to 1 mm, friction to 3 %; joints 50 µm off."""
    log = machine_log(course=Course(joints=5e-5))
    found = identify(log, NOMINAL, NAMES)
    assert abs(found["platform_mass"][0] / MACHINE.platform_mass - 1) < 0.005
    np.testing.assert_allclose(found["platform_com"], MACHINE.platform_com, atol=1e-3)
    assert abs(found["leg_viscous_friction"][0] / 560.0 - 1) < 0.03
    assert abs(found["leg_coulomb_friction"][0] / 130.0 - 1) < 0.03
    assert found.residuals.validation_rms is not None
    assert (found.residuals.validation_rms < 0.02 * found.residuals.signal_rms).all()


def test_intervals_are_those_of_student_s_t_and_the_order_of_logs_does_not_matter() -> None:
    """Expected: the quantile of t of the rows less the parameters; shares of noise are those of both logs."""
    logs = [machine_log(course=Course(duration=6.0), seed=4), machine_log(course=OTHER, sensing=NOISY, seed=5)]
    first, second = (identify(order, NOMINAL, "platform_mass,leg_viscous_friction") for order in (logs, logs[::-1]))
    half = (first.interval[:, 1] - first.interval[:, 0]) / 2
    np.testing.assert_allclose(half, t.ppf(0.975, first.freedom) * first.standard_errors, rtol=1e-9)
    assert 500 < first.freedom < 6 * len(first.details["time"])
    np.testing.assert_allclose(first.standard_errors, second.standard_errors, rtol=1e-3)
    few = replace(first, freedom=3)
    np.testing.assert_allclose(few.interval[:, 1] - few.values, 3.182446 * few.standard_errors, rtol=1e-6)


OTHER = Course(duration=4.0, swing=Swing(seed=9))
NOISY = Sensing(force_noise=0.002, length_noise=4e-6)


@pytest.mark.parametrize(("offset", "is_judged_bad"), [(0.0, False), (40.0, True)])
def test_a_log_that_validates_is_judged(offset: float, is_judged_bad: bool) -> None:
    """Expected: right logs are off by their noise, below one false alarm in 1000; an offset of 40 N adds its square."""
    legs = tuple(offset * np.array([1, -1, 1, -1, 1, -1]))
    aside = machine_log(course=OTHER, sensing=Sensing(force_offset=legs), seed=2)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = identify(machine_log(course=Course(duration=6.0), seed=4), NOMINAL, NAMES, validation=aside)
    v = found.validation
    assert v is not None
    assert (
        v.alarm
        == is_judged_bad
        == any("rows kept for validation" in str(c.message) for c in caught if c.category is IdentificationWarning)
    )
    assert v.rms == pytest.approx(np.hypot(v.expected, offset), rel=0.1)
    said = estimate_verdict(found).text
    assert f"off by {v.rms:.3g} N" in said
    assert ("does not predict" in said) == is_judged_bad


@pytest.mark.parametrize("name", ["time", "leg_length", "actuator_force", "motor_position"])
def test_what_is_no_number_is_refused_with_its_row(name: str) -> None:
    log = machine_log(course=Course(duration=2.0))
    log = replace(log, motor_position=log.leg_length)
    values = getattr(log, name).copy()
    values[70, ...] = np.nan
    index = r"" if name == "time" else r"\[1\]"
    with pytest.raises(GoughStewartError, match=rf"machine: {name}{index} in row 71 is nan; expected a finite number"):
        identify(replace(log, **{name: values}), NOMINAL, "platform_mass")


def test_what_acts_as_another_parameter_does_is_refused() -> None:
    """Expected: of both inertias of a leg the equations hold the sum only."""
    with pytest.raises(GoughStewartError, match=r"leg_\w+_inertia has the same effect as a combination of leg_"):
        identify(machine_log(course=Course(duration=8.0)), NOMINAL, ["leg_lower_inertia", "leg_upper_inertia"])


def test_an_inertia_that_no_body_has_is_kept_physical() -> None:
    """Expected: a platform that its own checks take, where noise alone would have made an impossible one."""
    thin = replace(MACHINE, platform_inertia=np.diag([380.0, 1.0, 380.9]))
    log = machine_log(thin, Course(duration=8.0), Sensing(force_noise=0.1))
    found = identify(log, NOMINAL, NAMES)
    assert found.at_bound == tuple(name for name in found.names if name.startswith("platform_inertia"))
    assert np.isnan(found.interval[[name in found.at_bound for name in found.names]]).all()
    assert np.isfinite(found.interval[0]).all()
    assert found.platform(NOMINAL).platform_inertia.shape == (3, 3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda log: replace(log, leg_length=1e3 * log.leg_length), r"They look like mm: .*'name\[1\] \[mm\]'"),
        (lambda log: replace(log, leg_length=100 * log.leg_length), r"They look like cm: "),
        (lambda log: replace(log, leg_length=1e6 * log.leg_length), r"They look like um: "),
        (lambda log: replace(log, actuator_force=1e3 * log.actuator_force), r"norm of .* N; .* They look like mN: "),
        (lambda log: replace(log, actuator_force=log.actuator_force / 1e3), r"They look like kN"),
        (lambda log: replace(log, actuator_force=20 * log.actuator_force), r"exceeds actuator_force_max, 20000 N"),
        (lambda log: replace(log, actuator_force=None), r"no forces; expected columns actuator_force"),
        (lambda log: replace(log, time=1e3 * log.time), "If time is in ms, name the column"),
        (lambda log: replace(log, time=None), r"machine: no column time; expected one"),
        (lambda log: replace(log, time=0.11 * np.arange(len(log))), r"rows are 0\.11 s apart; expected at most 0\.1"),
        (lambda log: log.rows(slice(0, 5)), "5 rows; expected a log of some seconds"),
        (
            lambda log: replace(log, actuator_force=np.where(np.arange(6) == 2, 3e3, log.actuator_force)),
            r"actuator_force\[3\] is 3000 in all rows; expected readings of a sensor",
        ),
        (
            lambda log: replace(log, time=np.where(np.arange(len(log)) > 500, log.time + 2e-4, log.time)),
            r"a step of 0\.0012 s after row 501",
        ),
        (
            lambda log: replace(log, time=np.where(np.arange(len(log)) == 40, 0.0, log.time)),
            "expected increasing times",
        ),
        (lambda log: log.rows(slice(4000, 4040)), "are shorter than the filter"),
        (lambda log: replace(log, leg_length=log.leg_length + np.array([1, -1, 1, -1, 1, -1])), "no pose of this"),
        (lambda log: replace(log, actuator_force=-log.actuator_force), "the log contradicts this platform"),
    ],
)
def test_a_log_that_no_such_machine_has_made_is_refused(change, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(GoughStewartError, match=message):
        identify(change(machine_log(course=Course(duration=8.0))), NOMINAL, "platform_mass")


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
    with pytest.raises(GoughStewartError, match=message):
        identify(machine_log(course=Course(duration=8.0)), NOMINAL, names)


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
        ("platform_mass,leg_static_friction", r"leg_static_friction: friction of this platform does not stick; set"),
        ("leg_bristle_damping", r"presliding is set in the platform"),
        ("leg_breakaway_share", r"presliding is set in the platform"),
    ],
)
def test_what_forces_do_not_tell_is_refused_with_what_serves_instead(estimate: str | list[str], message: str) -> None:
    """Expected: one error, before the log is read."""
    with pytest.raises(GoughStewartError, match=message):
        identify("there is no such log", NOMINAL, estimate)


def test_an_option_of_the_other_method_and_a_method_that_there_is_not_are_refused() -> None:
    with pytest.raises(
        IdentificationError, match=r"'output_error'; expected linear, for masses, .* or geometry, for jo"
    ):
        identify("no log", NOMINAL, "platform_mass", "output_error")  # type: ignore[arg-type]
    with pytest.raises(GoughStewartError, match="accuracy is an option of method geometry only; this one is linear"):
        identify("no log", NOMINAL, "platform_mass", accuracy=(1e-5, 1e-4, None))
    with pytest.raises(GoughStewartError, match="pose_frame is an option of method geometry only"):
        identify("no log", NOMINAL, "platform_mass", pose_frame="own")
    with pytest.raises(GoughStewartError, match="cutoff is an option of method linear only; this one is geometry"):
        identify("no log", NOMINAL, "base_points", cutoff=20.0)


def test_names_mean_all_of_their_elements_in_order() -> None:
    assert expanded([" platform_inertia ", "base_tilt", "platform_com[2]"], UNEVEN) == (
        *(f"platform_inertia[{k}]" for k in ("1,1", "1,2", "1,3", "2,2", "2,3", "3,3")),
        *("base_tilt[1]", "base_tilt[2]", "platform_com[2]"),
    )
    assert expanded(["leg_coulomb_friction[1..6]"], UNEVEN) == tuple(f"leg_coulomb_friction[{k}]" for k in range(1, 7))
    assert expanded(["leg_coulomb_friction", "leg_viscous_friction[3]"], UNEVEN)[0] == "leg_coulomb_friction"
    assert len(expanded(["force_gain", "base_points"], UNEVEN)) == 6 + 18
    with pytest.raises(GoughStewartError, match="no names; expected parameters"):
        expanded([], UNEVEN)


def test_sizes_of_changes_are_those_of_the_platform_and_of_the_log() -> None:
    """Expected: written out for 40 N of changes and 0.25 m/s, from the platform's own numbers."""
    size = UNEVEN.characteristic_length
    expected = {
        "platform_mass": 11.5,
        "platform_com[2]": size,
        "platform_inertia[1,3]": 11.5 * size**2,
        "leg_armature": 11.5 / 6 + 1.2,
        "leg_viscous_friction": 160.0,
        "leg_viscous_friction[4]": 160.0,
        "leg_coulomb_friction[6]": 40.0,
        "force_gain[2]": 1.0,
        "force_offset[3]": 40.0,
        "delay": 0.01,
        "base_tilt[2]": 0.1,
        "leg_upper_com": 0.58,
        "leg_lower_mass": 2.3,
    }
    assert_allclose(scales(UNEVEN, list(expected), 40.0, 0.25), list(expected.values()), rtol=1e-12)
