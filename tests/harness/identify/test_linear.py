"""Linear identification: of logs that another formulation, another friction and other joints have made."""

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import t

from gough_stewart import GoughStewartError, IdentificationWarning, Log, identify
from tests.harness.identify.information import sensitivities
from tests.harness.identify.machine_logs import (
    MACHINE,
    NAMES,
    NOMINAL,
    Course,
    Sensing,
    Swing,
    force_of,
    machine_log,
    perfect_estimate,
    value_of,
)

OTHER = Course(duration=4.0, swing=Swing(seed=9))
NOISY = Sensing(force_noise=0.002, length_noise=4e-6)
NOISELESS = Sensing(force_noise=0.0, length_noise=0.0, encoder=0.0)


def test_a_perfect_log_leaves_its_noise_and_a_noiseless_one_next_to_nothing() -> None:
    """Expected: 1 % noise within the filter's band, 10 to 11 N; without noise and reversals of legs, 1e-6 of forces."""
    assert 9.0 < perfect_estimate().residuals.rms.mean() < 12.0
    sliding = replace(MACHINE, leg_coulomb_friction=0.0)
    names = [name for name in NAMES if name != "leg_coulomb_friction"]
    exact = identify(
        machine_log(sliding, Course(duration=6.0), NOISELESS), replace(NOMINAL, leg_coulomb_friction=0.0), names
    )
    assert exact.residuals.rms.max() < 0.01
    assert exact.freedom == 6 * int(exact.notes[0].split()[0]) - len(exact.names)
    np.testing.assert_allclose(exact["platform_mass"], MACHINE.platform_mass, rtol=1e-6)
    np.testing.assert_allclose(exact["platform_inertia"][[0, 1, 4]], [380.0, 12.0, 8.0], atol=0.02)


def test_intervals_are_those_of_student_s_t_and_the_order_of_logs_does_not_matter() -> None:
    """Expected: the quantile of t of the rows less the parameters; shares of noise are those of both logs."""
    logs = [machine_log(course=Course(duration=4.0), seed=4), machine_log(course=OTHER, sensing=NOISY, seed=5)]
    first, second = (identify(order, MACHINE, "platform_mass,leg_viscous_friction") for order in (logs, logs[::-1]))
    half = (first.interval[:, 1] - first.interval[:, 0]) / 2
    np.testing.assert_allclose(half, t.ppf(0.975, first.freedom) * first.standard_errors, rtol=1e-9)
    assert 300 < first.freedom < 6 * len(first.details["time"])
    np.testing.assert_allclose(first.standard_errors, second.standard_errors, rtol=1e-3)
    few = replace(first, freedom=3)
    np.testing.assert_allclose(few.interval[:, 1] - few.values, 3.182446 * few.standard_errors, rtol=1e-6)


@pytest.mark.parametrize(("offset", "is_judged_bad"), [(0.0, False), (40.0, True)])
def test_a_log_that_validates_is_judged(offset: float, is_judged_bad: bool) -> None:
    """Expected: right logs are off by their noise, below one false alarm in 1000; an offset of 40 N adds its square."""
    legs = tuple(offset * np.array([1, -1, 1, -1, 1, -1]))
    aside = machine_log(course=OTHER, sensing=Sensing(force_offset=legs), seed=2)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        estimate = identify(machine_log(course=Course(duration=6.0), seed=4), NOMINAL, NAMES, validation=aside)
    v: Any = estimate.validation
    warned = [str(c.message) for c in caught if c.category is IdentificationWarning]
    assert v.alarm == is_judged_bad == any("rows kept for validation" in text for text in warned)
    assert v.rms == pytest.approx(np.hypot(v.expected, offset), rel=0.1)
    said = " ".join((*estimate.notes, *estimate.alarms))
    p = "(p < 1e-06)" if is_judged_bad else f"(p = {v.p_value:.2g})"  # 0 is no probability of a continuous statistic
    assert f"off by {v.rms:.3g} N where {v.expected:.3g} N are expected {p}" in said
    assert ("does not predict" in said) == is_judged_bad


def test_what_validates_is_expected_to_be_off_by_the_errors_of_the_estimate_too() -> None:
    """Expected: of a large motion, by a fit of a small one, noise and ∂F/∂θ C ∂F/∂θᵀ by a Lagrangian's differences."""
    machine = replace(MACHINE, leg_coulomb_friction=0.0)
    names = ("platform_mass", "leg_armature", "leg_viscous_friction")
    small, large = (Course(Swing(seed=9, size=size), duration=4.0) for size in (0.002, 0.06))
    log = machine_log(machine, large, seed=1)
    estimate = identify(machine_log(machine, small), machine, names, validation=log)
    assert estimate.validation is not None
    D = sensitivities(machine, large, np.linspace(0.4, 3.6, 60), names, {})
    of_errors = np.einsum("nip,pq,niq->ni", D, estimate.covariance, D).mean()
    noise = identify(log, machine, names).residuals.rms.mean()
    assert of_errors > 0.5 * noise**2
    assert estimate.validation.expected == pytest.approx(np.sqrt(noise**2 + of_errors), rel=0.1)


def test_an_inertia_that_no_body_has_is_kept_physical() -> None:
    """Expected: a platform that its own checks take, where noise alone would have made an impossible one."""
    thin = replace(MACHINE, platform_inertia=np.diag([380.0, 1.0, 380.9]))
    log = machine_log(thin, Course(duration=8.0), Sensing(force_noise=0.1))
    estimate = identify(log, NOMINAL, NAMES)
    assert estimate.at_bound == tuple(name for name in estimate.names if name.startswith("platform_inertia"))
    assert np.isnan(estimate.interval[[name in estimate.at_bound for name in estimate.names]]).all()
    assert np.isfinite(estimate.interval[0]).all()
    assert estimate.platform(NOMINAL).platform_inertia.shape == (3, 3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda log: replace(log, leg_length=1e3 * log.leg_length), r"They look like mm: .*'name\[1\] \[mm\]'"),
        (lambda log: replace(log, leg_length=100 * log.leg_length), r"They look like cm: "),
        (
            lambda log: replace(log, leg_length=log.leg_length * np.where(np.arange(6) == 2, 0.32, 1.0)),
            "leg 3 has a median length of .* at home; expected",
        ),
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
            r"a step of 0\.0012 s after row 501 \(time 0\.5 s\), where rows are 0\.001 s apart, and 0 more",
        ),
        (
            lambda log: replace(log, time=np.where(np.arange(len(log)) == 40, 0.0, log.time)),
            r"time goes from 0\.039 to 0 s in row 41; expected increasing times",
        ),
        (
            # at 10,000 s such numbers are 1/1024 s apart, which is no time for rows of 1 ms
            lambda log: replace(log, time=(log.time + 1e4).astype(np.float32).astype(float)),
            r"times are numbers of 32 bits, 0\.00098 s apart at 100",
        ),
        (lambda log: log.rows(slice(4000, 4040)), "are shorter than the filter"),
        (lambda log: log.rows(slice(2500, 2800)), r"too short: .* 0\.\d+ s are left to fit, .* record some seconds"),
        (lambda log: replace(log, leg_length=log.leg_length + np.array([1, -1, 1, -1, 1, -1])), "no pose of this"),
        (lambda log: replace(log, actuator_force=-log.actuator_force), "the log contradicts this platform"),
        (lambda log: replace(log, time=_with_nan(log.time)), "machine: time in row 71 is nan; expected a finite numb"),
        (
            lambda log: replace(log, motor_position=_with_nan(log.leg_length)),
            r"machine: motor_position\[1\] in row 71 is nan; expected a finite",
        ),
    ],
)
def test_a_log_that_no_such_machine_has_made_is_refused(change: Any, message: str) -> None:
    with pytest.raises(GoughStewartError, match=message):
        identify(change(machine_log(course=Course(duration=8.0))), NOMINAL, "platform_mass")


def _with_nan(values: Any) -> Any:
    wrong = values.copy()
    wrong[70, ...] = np.nan
    return wrong


@pytest.mark.parametrize(
    ("swing", "sensing", "rows"),
    [
        # cut out of a motion: the ends move, and differ by far more than noise, which leaks through a window
        (Swing(frequency=0.05), Sensing(), slice(3500, 6500)),
        # whole periods and an encoder without noise, whose rounding then has lines instead of being white
        (Swing(frequency=1.0, harmonics=3, size=0.01), Sensing(length_noise=0.0), slice(1000, 9000)),
    ],
)
def test_the_cut_off_is_that_of_the_motion_alone(swing: Swing, sensing: Sensing, rows: slice) -> None:
    """Expected: the machine's values within four standard errors, that of the mass below 1 kg; no alarm."""
    estimate = identify(machine_log(course=Course(swing), sensing=sensing).rows(rows), NOMINAL, NAMES)
    assert not estimate.alarms
    true = [value_of(MACHINE, name) for name in estimate.names]
    assert (np.abs(estimate.values - true) < 4 * estimate.standard_errors)[np.isfinite(estimate.standard_errors)].all()
    assert estimate.standard_errors[0] < 1.0


def test_units_are_not_doubted_between_a_third_and_three_times_and_times_may_be_coarse() -> None:
    """Expected: docs: lengths within a factor of 3 of home, forces within 50; no such log is refused for its units."""
    log = machine_log(course=Course(duration=4.0))
    coarse: Any = np.asarray(log.time).astype(np.float32).astype(float)
    assert identify(replace(log, time=coarse), MACHINE, "platform_mass").names == ("platform_mass",)
    free = replace(NOMINAL, actuator_force_max=None)
    for length, force in ((0.35, 1 / 40), (2.9, 30.0)):
        legs = log.leg_length * np.where(np.arange(6) == 2, length, 1.0)
        with pytest.raises(GoughStewartError) as caught:
            identify(Log(legs, log.time, force * force_of(log)), free, "platform_mass")
        assert "similar" not in str(caught.value)


@pytest.mark.parametrize(
    ("estimate", "options", "message"),
    [
        ("platform_mas", {}, "did you mean 'platform_mass'"),
        ("platform_mass,platform_mass", {}, "platform_mass is repeated"),
        ("platform_com[4]", {}, r"no element 'platform_com\[4\]'"),
        ("leg_viscous_friction,leg_viscous_friction[2]", {}, "is repeated"),
        (
            "platform_mass,leg_friction_velocity",
            {},
            r"leg_friction_velocity is .* a constant that smooths .* set it in the",
        ),
        ("gravity", {}, r"gravity\[1\] is not estimated from forces: it is set in the .* estimate base_tilt"),
        (["platform_mass", "base_points[2,3]"], {}, r"base_points\[2,3\] is .* need measured poses: estimate them al"),
        ("platform_mass,leg_length_offset", {}, r"leg_length_offset\[1\] is .* need measured poses: estimate them al"),
        ("leg_bristle_stiffness", {}, r"leg_bristle_stiffness is .* presliding is set in the platform; .*leg_static_"),
        ("platform_mass,leg_static_friction", {}, r"leg_static_friction: friction of this .* does not stick; set"),
        ("leg_breakaway_share", {}, r"presliding is set in the platform"),
        ("leg_stiffness", {"armature": 0.0}, r"leg_stiffness: leg_armature is 0.*set it, or estimate it, too"),
        ("platform_mass", {"method": "output_error"}, "'output_error'; expected linear, for masses, .* or geometry, f"),
        ("platform_mass", {"accuracy": (1e-5, 1e-4, None)}, "accuracy is an option of method geometry only; this one"),
        ("platform_mass", {"pose_frame": "own"}, "pose_frame is an option of method geometry only"),
        ("base_points", {"cutoff": 20.0}, "cutoff is an option of method linear only; this one is geometry"),
    ],
)
def test_what_forces_do_not_tell_is_refused_with_what_serves_instead(
    estimate: str | list[str], options: dict[str, Any], message: str
) -> None:
    """Expected: one error, before the log is read."""
    platform = replace(NOMINAL, leg_armature=options.pop("armature", NOMINAL.leg_armature))
    with pytest.raises(GoughStewartError, match=message):
        identify("there is no such log" if not options else [], platform, estimate, **options)


def test_what_acts_as_another_parameter_does_is_refused() -> None:
    """Expected: of both inertias of a leg the equations hold the sum only."""
    with pytest.raises(GoughStewartError, match=r"leg_\w+_inertia has the same effect as a combination of leg_"):
        identify(machine_log(course=Course(duration=4.0)), NOMINAL, ["leg_lower_inertia", "leg_upper_inertia"])


def test_names_mean_all_of_their_elements_in_order() -> None:
    log = machine_log(course=Course(Swing(frequency=0.4), duration=2.5, rate=500.0))
    inertia = tuple(f"platform_inertia[{k}]" for k in ("1,1", "1,2", "1,3", "2,2", "2,3", "3,3"))
    com = tuple(f"platform_com[{k}]" for k in (1, 2, 3))
    assert identify(log, MACHINE, [" platform_inertia ", "platform_com"]).names == (*inertia, *com)
    legs = tuple(f"leg_coulomb_friction[{k}]" for k in range(1, 7))
    estimate = identify(log, MACHINE, "leg_coulomb_friction[1..6], base_tilt ,leg_viscous_friction[3]")
    assert estimate.names == (*legs, "base_tilt[1]", "base_tilt[2]", "leg_viscous_friction[3]")
    assert estimate["leg_coulomb_friction"].tolist() == estimate.values[:6].tolist()
    assert estimate["leg_viscous_friction[3]"].tolist() == [estimate.values[8]]
    assert estimate["platform_inertia"].size == 0


def test_sizes_of_changes_are_those_of_the_platform_and_of_each_leg() -> None:
    """Expected: the platform's mass and size; deviations of each leg's force about its own mean, and RMS velocities."""
    swings = (Swing(seed=seed, fade=0.5, frequency=f, harmonics=3) for seed, f in ((3, 0.4), (5, 0.6)))
    logs = [machine_log(course=Course(swing, duration=3.0, rate=500.0)) for swing in swings]
    names = [
        *("platform_mass", "platform_com[2]", "platform_inertia[1,3]", "leg_armature", "leg_viscous_friction"),
        *("leg_coulomb_friction", "force_offset[3]", "delay", "base_tilt[2]"),
    ]
    estimate = identify(logs, replace(MACHINE, actuator_force_max=None), names, validation=0.0)
    force = np.mean([force_of(log).std(axis=0).mean() for log in logs])
    velocity = np.mean([np.sqrt((np.diff(log.leg_length, axis=0) ** 2).mean()) * 500.0 for log in logs])
    size, mass = MACHINE.characteristic_length, MACHINE.platform_mass
    sizes = dict(zip(estimate.names, estimate.scale, strict=True))
    for name, expected in (
        ("platform_mass", mass),
        ("platform_com[2]", size),
        ("platform_inertia[1,3]", mass * size**2),
        ("leg_armature", mass / 6 + MACHINE.leg_upper_mass),
        ("leg_coulomb_friction", force),
        ("force_offset[3]", force),
        ("delay", 0.01),
        ("base_tilt[2]", 0.1),
    ):
        assert sizes[name] == pytest.approx(expected), name
    # the filter takes the first and the last of a log, which are slow
    assert sizes["leg_viscous_friction"] == pytest.approx(force / velocity, rel=0.15)


@pytest.mark.parametrize("late", [-0.03, 0.03])
def test_a_delay_is_at_most_what_the_filters_reach(late: float) -> None:
    """Expected: 20 ms to either side, which is said, and the log contradicts it."""
    log = machine_log(course=Course(duration=4.0), sensing=Sensing(delay=late))
    with pytest.warns(IdentificationWarning, match="contradicts"):
        estimate = identify(log, MACHINE, "platform_mass,delay")
    assert estimate["delay"].item() == pytest.approx(np.copysign(0.02, late), rel=1e-6)
    assert "at the bound of what is physical: delay" in " ".join(estimate.notes)


def test_payload_com_and_friction_are_found_to_half_a_percent_a_millimetre_and_three_percent() -> None:
    """Expected: the machine's own: mass to 0.5 %, centre of mass to 1 mm, friction to 3 %; joints 50 µm off."""
    estimate = identify(machine_log(course=Course(joints=5e-5)), NOMINAL, NAMES)
    assert abs(estimate["platform_mass"][0] / MACHINE.platform_mass - 1) < 0.005
    np.testing.assert_allclose(estimate["platform_com"], MACHINE.platform_com, atol=1e-3)
    assert abs(estimate["leg_viscous_friction"][0] / 560.0 - 1) < 0.03
    assert abs(estimate["leg_coulomb_friction"][0] / 130.0 - 1) < 0.03
    assert estimate.residuals.validation_rms is not None
    assert (estimate.residuals.validation_rms < 0.02 * estimate.residuals.signal_rms).all()
