"""What a motion does not excite gets no number, however precise it looks; logs come from a Lagrangian."""

import json
from dataclasses import replace

import numpy as np
import pytest

from gough_stewart import GoughStewartError, identify
from tests.harness.identify.machine_logs import HEAVE, MACHINE, NAMES, NOMINAL, Course, Swing, machine_log, value_of

INERTIA = tuple(f"platform_inertia[{a},{b}]" for a, b in ((1, 1), (1, 2), (1, 3), (2, 2), (2, 3), (3, 3)))


def test_heave_alone_has_no_number_for_the_height_of_the_centre_of_mass() -> None:
    """Expected: by hand, no rotation, so gravity has no arm that changes and no inertia turns; the rest is right."""
    # noise of the lengths looks like rotation: joints and encoders must not explain it, or its level would be a third
    estimate = identify(machine_log(course=Course(HEAVE, duration=6.0)), NOMINAL, NAMES)
    assert estimate.diagnosis is not None
    assert estimate.alarms == ()
    assert 0.6e-6 < estimate.diagnosis.length_noise < 1.6e-6
    assert estimate.not_excited == ("platform_com[3]", *INERTIA)
    known = np.array([name not in estimate.not_excited for name in estimate.names])
    truth = np.array([value_of(MACHINE, name) for name in estimate.names])
    # four standard errors are one in 15,000 for each of six
    assert (np.abs(estimate.values - truth)[known] < 4 * estimate.standard_errors[known]).all()
    assert not estimate.at_bound
    plain = json.loads(estimate.to_json())
    assert plain["parameters"]["platform_com[3]"]["value"] is None
    assert plain["parameters"]["platform_com[3]"]["interval"] == [None, None]
    assert plain["not_excited"] == list(estimate.not_excited)
    platform = estimate.platform(NOMINAL)
    assert platform.platform_com[2] == NOMINAL.platform_com[2]
    np.testing.assert_array_equal(platform.platform_inertia, NOMINAL.platform_inertia)
    assert platform.platform_mass == estimate.values[0]


@pytest.mark.parametrize(
    ("axis", "size", "unknown"), [(3, 0.06, ()), (4, 0.005, ()), (4, 2e-4, ("leg_armature", "leg_viscous_friction"))]
)
def test_numbers_of_motions_along_one_axis_are_right_or_missing(
    axis: int, size: float, unknown: tuple[str, ...]
) -> None:
    """Expected: the machine's values within five standard errors, one in a million; some without a number."""
    # pitching about Op shows the sum of an inertia and m c_z²; where its sign is smooth, Coulomb friction is viscous
    swing = Swing(axes=tuple(float(k == axis) for k in range(6)), size=size)
    estimate = identify(machine_log(course=Course(swing, duration=6.0)), NOMINAL, NAMES)
    assert estimate.not_excited
    assert set(unknown) <= set(estimate.not_excited)
    known = np.isfinite(estimate.standard_errors)  # not of what is at its bound
    truth = np.array([value_of(MACHINE, name) for name in estimate.names])
    assert (np.abs(estimate.values - truth)[known] < 5 * estimate.standard_errors[known]).all()


def test_too_little_excitation_is_refused_with_the_elements() -> None:
    with pytest.raises(GoughStewartError, match=r"the legs move by .* expected a motion"):
        identify(machine_log(course=Course(Swing(size=0.0))), NOMINAL, NAMES)
    match = r"too little excitation.*none of platform_com\[3\], platform_inertia"
    with pytest.raises(GoughStewartError, match=match) as caught:
        identify(machine_log(course=Course(HEAVE, duration=6.0)), NOMINAL, ("platform_com[3]", "platform_inertia"))
    assert all(name in str(caught.value) for name in ("platform_com[3]", *INERTIA))


def test_a_value_at_its_bound_has_no_interval() -> None:
    """Expected: of a machine without Coulomb friction, half of the logs would give less than none."""
    slick = replace(MACHINE, leg_coulomb_friction=0.0)
    for seed in range(6):
        estimate = identify(machine_log(slick, Course(duration=4.0), seed=seed), NOMINAL, NAMES)
        k = estimate.names.index("leg_coulomb_friction")
        assert (estimate.values[k] < 1e-2) == ("leg_coulomb_friction" in estimate.at_bound)
        if estimate.at_bound:
            break
    assert np.isnan(estimate.interval[k]).all()
    assert json.loads(estimate.to_json())["parameters"]["leg_coulomb_friction"]["standard_error"] is None
    assert np.isfinite(estimate.interval[:k]).all()
