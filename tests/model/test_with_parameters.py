"""A platform with other values of some parameters is the one that `dataclasses.replace` checks as a whole."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gough_stewart as gs
from gough_stewart import leg_geometry
from gough_stewart.model.parameters import PHYSICAL, TABLE
from gough_stewart.model.platform import platforms_with
from tests.support.uneven import UNEVEN


@given(
    names=st.sets(st.sampled_from(sorted(TABLE)), min_size=1, max_size=4),
    factor=st.floats(0.999, 1.001, exclude_min=True),
)
@settings(max_examples=60)
def test_other_values_give_the_platform_that_replace_gives(names: set[str], factor: float) -> None:
    """Expected: all numbers of `replace`; the original stays as it was, and arrays are read-only."""
    before = UNEVEN.as_dict()
    known = {name: getattr(UNEVEN, name) for name in names}
    values: dict[str, Any] = {
        name: None if value is None else np.asarray(value) * factor for name, value in known.items()
    }
    found, expected = UNEVEN.with_parameters(values), replace(UNEVEN, **values)
    assert found == expected
    with pytest.raises(gs.GoughStewartError, match=r"platform_mas: no such parameter.*platform_mass"):
        UNEVEN.with_parameters({"platform_mas": 3.0})
    assert all(np.array_equal(UNEVEN.as_dict()[name], value) for name, value in before.items())
    for name in names:
        value = getattr(found, name)
        assert not isinstance(value, np.ndarray) or not value.flags.writeable


NONE: dict[str, Any] = {"leg_length_min": None, "leg_length_max": None}
# Between the shortest and the longest leg in the home pose.
HOME_LEGS = np.quantile(leg_geometry(UNEVEN, UNEVEN.home_position, UNEVEN.home_orientation).length, [0.3, 0.7]).tolist()
# Values of six members, and which of them are impossible, by the messages of a platform alone.
VARIED: dict[str, list[Any]] = {
    "platform_mass": [3.0, 4.0, 0.0, 5.0, -1.0, 2e30],
    "leg_coulomb_friction_factor": [np.arange(6.0), np.ones(6), -np.eye(6)[4], np.zeros(6), -np.ones(6), np.ones(6)],
    "platform_inertia": [
        np.diag(each) for each in ([2.0, 2, 3], [2.0, 2, 3.9], [2.0, 2, 4.1], [1.0, 0, 1], [3.0, 3, 3], [9.0, 8, 16])
    ],
    "platform_points": [
        UNEVEN.platform_points * scale + shift * np.eye(6, 3)
        for scale, shift in ((1, 0), (1, 1e-3), (1e-9, 0), (0.9, 0), (-1, 0), (1.1, 0))
    ],
    "base_points": [UNEVEN.base_points[[0, 1, 2, 3, 4, k]] for k in (5, 0, 5, 4, 3, 5)],
    "home_position": [UNEVEN.home_position + z * np.eye(3)[2] for z in (0.0, 0.01, -10.0, -2.0, 5.0, 0.1)],
    "home_orientation": [[0.0, pitch, 0.1] for pitch in (0.0, 0.1, 1.6, -1.57, 0.2, 3.0)],
    "leg_lower_com": [0.1, 0.2, 50.0, 3.0, 0.3, -0.1],
    "platform_com": [[0, 0, z] for z in (0.0, 0.5, 1e3, -1e3, 0.2, 9.0)],
    "leg_length_max": [30.0, 40.0, 1e-3, *HOME_LEGS, 31.0],
    "leg_length_min": [0.1, 0.2, 30.0, *HOME_LEGS, 0.3],
    "joint_angle_max": [0.5, 3.1, 3.2, 1.0, 4.0, 2.0],
    # of other kinds than numbers of one shape
    "platform_com ": [[0, 0, 0.1], [0, np.inf, 0], [0, 0, "1 m"], [0, 0], [0, 0, 1e3], [0, 0, 0.2]],
    "leg_length_max ": [30.0, 40.0, None, 1e-3, np.nan, 31.0],
    "leg_viscous_friction": [1.0, [1.0, 2, 3, 4, 5, 6], 2.0, 3.0, -1.0, 4.0],
    "platform_mas": [1.0] * 6,
}


@pytest.mark.parametrize("number", [1, 6, 13])
@pytest.mark.parametrize("fixed", [NONE, {}, {"leg_coulomb_friction": [1.0, 2, 3, 4, 5, 6], "leg_armature": 3.0}])
@pytest.mark.parametrize("name", VARIED)
def test_many_platforms_are_those_that_are_made_alone(name: str, fixed: dict[str, Any], number: int) -> None:
    """Expected: the same numbers, or the same message, as `with_parameters` of each base, one after the other."""
    bases = [UNEVEN, replace(UNEVEN, platform_mass=2.5, **NONE)]
    of = np.arange(number) % 3 // 2
    parameters = [{**fixed, name.strip(): VARIED[name][k % 6]} for k in range(number)]
    found, errors = platforms_with(bases, of, parameters)
    assert len(found) == number
    for k, each in enumerate(parameters):
        if k in errors:
            with pytest.raises(gs.GoughStewartError) as caught:
                bases[of[k]].with_parameters(each)
            assert str(errors[k]) == str(caught.value)
            continue
        alone = bases[of[k]].with_parameters(each)
        assert found[k] == alone
        for row in PHYSICAL:
            assert np.array_equal(getattr(found.parameters, row.name)[k], getattr(alone, row.name)), row.name
            assert np.array_equal(found[np.array([k, 0])].field(row.name)[0], getattr(alone, row.name)), row.name
