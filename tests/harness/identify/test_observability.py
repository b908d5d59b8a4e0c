"""What a motion does not excite gets no number, however precise it looks; logs come from a Lagrangian."""

import json
from dataclasses import replace

import numpy as np
import pytest

from gough_stewart import identify
from gough_stewart.harness.errors import IdentificationError, LogError
from gough_stewart.harness.identify.names import value_of
from tests.support.machine_logs import (
    HEAVE,
    MACHINE,
    NAMES,
    NOMINAL,
    Course,
    Sensing,
    Swing,
    force_of,
    machine_log,
)

INERTIA = tuple(f"platform_inertia[{a},{b}]" for a, b in ((1, 1), (1, 2), (1, 3), (2, 2), (2, 3), (3, 3)))


def test_heave_alone_has_no_number_for_the_height_of_the_centre_of_mass() -> None:
    """Expected: by hand, no rotation, so gravity has no arm that changes and no inertia turns; the rest is right.

    Before, noise of the lengths looked like rotation and gave a centre of mass of 0.45 ± 0.08 m where it is 0.19 m.
    """
    found = identify(machine_log(course=Course(HEAVE)), NOMINAL, NAMES)
    assert found.not_excited == ("platform_com[3]", *INERTIA)
    known = np.array([name not in found.not_excited for name in found.names])
    truth = np.array([value_of(MACHINE, name) for name in found.names])
    # four standard errors are one in 15,000 for each of six
    assert (np.abs(found.values - truth)[known] < 4 * found.standard_errors[known]).all()
    assert not found.at_bound
    plain = json.loads(found.to_json())
    assert plain["parameters"]["platform_com[3]"]["value"] is None
    assert plain["parameters"]["platform_com[3]"]["interval"] == [None, None]
    assert plain["not_excited"] == list(found.not_excited)
    platform = found.platform(NOMINAL)
    assert platform.platform_com[2] == NOMINAL.platform_com[2]
    np.testing.assert_array_equal(platform.platform_inertia, NOMINAL.platform_inertia)
    assert platform.platform_mass == found.values[0]


@pytest.mark.parametrize(
    ("axis", "size", "unknown"),
    [(3, 0.06, ()), (4, 0.005, ()), (4, 2e-4, ("platform_com[3]", "platform_inertia[2,2]", "leg_armature"))],
)
def test_numbers_of_motions_along_one_axis_are_right_or_missing(
    axis: int, size: float, unknown: tuple[str, ...]
) -> None:
    """Expected: the machine's values within five standard errors, one in a million; some without a number.

    Pitching about Op, the log knows the sum of an inertia and m c_z² only if c_z is known; with hardly any, neither.
    """
    swing = Swing(axes=tuple(float(k == axis) for k in range(6)), size=size)
    found = identify(machine_log(course=Course(swing)), NOMINAL, NAMES)
    assert found.not_excited
    assert not unknown or set(unknown) & set(found.not_excited)
    known = np.isfinite(found.standard_errors)  # not of what is at its bound
    truth = np.array([value_of(MACHINE, name) for name in found.names])
    assert (np.abs(found.values - truth)[known] < 5 * found.standard_errors[known]).all()


def test_without_noise_heave_has_no_number_either() -> None:
    """Expected: the same as with noise, since it is the motion that lacks."""
    quiet = Sensing(force_noise=0.0, length_noise=0.0, encoder=0.0)
    found = identify(machine_log(course=Course(HEAVE), sensing=quiet), NOMINAL, NAMES)
    assert found.not_excited == ("platform_com[3]", *INERTIA)


def test_a_machine_at_rest_is_refused() -> None:
    with pytest.raises(LogError, match=r"the legs move by .* expected a motion"):
        identify(machine_log(course=Course(Swing(size=0.0))), NOMINAL, NAMES)


def test_if_nothing_is_excited_the_log_is_refused() -> None:
    match = r"too little excitation.*none of platform_com\[3\], platform_inertia"
    with pytest.raises(IdentificationError, match=match) as caught:
        identify(machine_log(course=Course(HEAVE)), NOMINAL, ("platform_com[3]", "platform_inertia"))
    assert tuple(caught.value.names) == ("platform_com[3]", *INERTIA)


def test_a_value_at_its_bound_has_no_interval() -> None:
    """Expected: of a machine without Coulomb friction, half of the logs would give less than none."""
    slick = replace(MACHINE, leg_coulomb_friction=0.0)
    for seed in range(6):
        found = identify(machine_log(slick, Course(duration=4.0), seed=seed), NOMINAL, NAMES)
        k = found.names.index("leg_coulomb_friction")
        assert (found.values[k] < 1e-2) == ("leg_coulomb_friction" in found.at_bound)
        if found.at_bound:
            break
    assert np.isnan(found.interval[k]).all()
    assert json.loads(found.to_json())["parameters"]["leg_coulomb_friction"]["standard_error"] is None
    assert np.isfinite(found.interval[:k]).all()


def test_sizes_of_friction_are_those_of_changes_of_each_leg() -> None:
    """Expected: deviations of each leg's force about its own mean, and RMS velocities by differences; means of logs."""
    swings = Swing(seed=3, fade=0.5, frequency=0.5), Swing(seed=5, fade=0.5, frequency=0.8)
    logs = [machine_log(course=Course(swing, duration=3.0, rate=500.0)) for swing in swings]
    found = identify(logs, replace(NOMINAL, actuator_force_max=None), NAMES, validation=0.0)
    force = np.mean([force_of(log).std(axis=0).mean() for log in logs])
    velocity = np.mean([np.sqrt((np.diff(log.leg_length, axis=0) ** 2).mean()) * 500.0 for log in logs])
    sizes = dict(zip(found.names, found.scale, strict=True))
    assert sizes["leg_coulomb_friction"] == pytest.approx(force)
    # the filter takes the first and the last of a log, which are slow
    assert sizes["leg_viscous_friction"] == pytest.approx(force / velocity, rel=0.15)
