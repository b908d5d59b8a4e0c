"""Changes of parameters of many platforms: whose they are, and who is refused by which error."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gough_stewart.harness.plants.lanes import changed_parameter, refuse_impossible
from gough_stewart.model import interface
from gough_stewart.model.errors import InterfaceError, PlatformError
from gough_stewart.model.parameters import stack
from gough_stewart.model.vectors import FloatArray
from tests.support.uneven import UNEVEN

PLATFORMS = [
    replace(
        UNEVEN, platform_mass=mass, gravity=np.array([0.1 * mass, 0.0, -9.0]), platform_com=np.array([0.0, 0.01, 0.1])
    )
    for mass in (10.0, 11.0, 12.0)
]
PRESENT = stack(PLATFORMS)
ALL, SOME = np.array([True, True, True]), np.array([True, False, True])
J = UNEVEN.platform_inertia


@pytest.mark.parametrize(
    ("name", "value", "members", "expected"),
    [
        ("platform_mass", 20, ALL, [20.0, 20.0, 20.0]),
        ("platform_mass", [21, 22, 23], ALL, [21.0, 22.0, 23.0]),
        ("platform_mass", [21, np.nan, 23], SOME, [21.0, 11.0, 23.0]),
        ("platform_mass", 20.0, SOME, [20.0, 11.0, 20.0]),
        # three numbers are one value for all, three rows a value for each
        ("gravity", [1, 2, 3], SOME, [[1.0, 2.0, 3.0], [1.1, 0.0, -9.0], [1.0, 2.0, 3.0]]),
        ("gravity", 10 * np.eye(3), SOME, [[10.0, 0, 0], [1.1, 0.0, -9.0], [0.0, 0.0, 10.0]]),
        ("platform_inertia", 2 * J, SOME, np.stack([2 * J, J, 2 * J])),
        ("platform_inertia", np.stack([2 * J, 3 * J, 4 * J]), ALL, np.stack([2 * J, 3 * J, 4 * J])),
        ("leg_viscous_friction_factor", np.arange(6), SOME, None),
    ],
)
def test_a_value_is_of_all_or_of_each_and_goes_to_those_that_are_meant(
    name: str, value: Any, members: Any, expected: Any
) -> None:
    """Expected: by hand; the present values of the others, and of all afterwards, unchanged."""
    before = np.array(getattr(PRESENT, name))
    found = changed_parameter(PRESENT, name, value, members)
    if expected is None:
        expected = np.where(members[:, None], np.arange(6.0), UNEVEN.leg_viscous_friction_factor)
    assert found.tolist() == np.asarray(expected).tolist()
    assert np.array_equal(getattr(PRESENT, name), before)


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        (
            "platform_mass",
            [1.0, 2.0],
            "platform_mass: has shape (2,); expected one number [kg], mass of the platform w",
        ),
        (
            "platform_mass",
            [1.0, 2.0, np.inf],
            "platform_mass: is [1.0, 2.0, inf]; expected finite numbers only [kg], m",
        ),
        ("gravity", np.ones((3, 2)), "gravity: has shape (3, 2); expected numbers of shape (3, 3) [m/s2], accelerat"),
        ("gravity", np.ones((2, 3)), "gravity: has shape (2, 3); expected numbers of shape (3,) [m/s2], acceleration"),
        ("gravity", "down", "gravity: is 'down'; expected numbers of shape (3,) [m/s2], acceleration of gravity"),
        ("leg_lower_mass", 2.0, "leg_lower_mass: cannot be set during a run; expected one of platform_mass, platform"),
        ("position", np.zeros(3), "position: cannot be set during a run; expected one of "),
        ("gravity[3]", -9.0, "gravity[3]: cannot be set during a run; expected one of "),
    ],
)
def test_what_is_no_change_is_told_with_unit_and_meaning(name: str, value: Any, text: str) -> None:
    with pytest.raises(InterfaceError, match=f"^{re.escape(text)}") as caught:
        changed_parameter(PRESENT, name, value, ALL)
    if "expected one of" in text:
        tunable = str(caught.value).split("expected one of ")[1].split(", ")
        assert tunable == [v.name for v in interface.VARIABLES if v.variability == "tunable"]


FLAT = np.diag([2.0, 1.0, 3.0])


def _skewed(row: int, column: int) -> FloatArray:
    """With one product of inertia that the other one has not."""
    J = FLAT.copy()
    J[row, column] = 1e-7
    return J


_BAD: list[tuple[str, Any, str]] = [
    ("platform_mass", 0.0, "is 0 kg; expected > 0"),
    ("leg_viscous_friction", -1e-9, "is -1e-09 N.s/m; expected >= 0"),
    ("leg_friction_velocity", 0.0, "is 0 m/s; expected > 0"),
    ("leg_coulomb_friction_factor", np.array([1, 1, 1, 1, 1, -1.0]), "is -1; expected >= 0"),
    ("gravity", np.array([0.0, 2e30, 0.0]), "expected numbers below 1e+30"),
    ("gravity", np.array([0.0, 0.0, -2e30]), "expected numbers below 1e+30"),
    ("platform_inertia", np.diag([2.0, 1.0, 3.1]), "the largest exceeds the sum"),
    ("platform_inertia", np.diag([2.0, -1.0, 2.5]), "is not positive definite"),
    ("platform_inertia", _skewed(0, 1), "is not symmetric: [1,2]"),
    ("platform_inertia", _skewed(2, 1), "is not symmetric: [2,3]"),
    ("platform_com", np.array([0.0, 0.0, -30.0]), "more than ten times"),
]


@pytest.mark.parametrize("bad", range(3))
@pytest.mark.parametrize(("name", "value", "text"), _BAD)
def test_whoever_has_an_impossible_value_is_refused_by_number(name: str, value: Any, text: str, bad: int) -> None:
    """Expected: the words of a single platform, and the number of the member; not of one that is not meant."""
    fine = np.array(getattr(PRESENT, name))
    values = fine.copy()
    values[bad] = value
    refuse_impossible(PLATFORMS, ALL, {"leg_coulomb_friction": np.ones(3), name: fine})
    with pytest.raises(PlatformError) as caught:
        refuse_impossible(PLATFORMS, ALL, {"leg_coulomb_friction": np.ones(3), name: values})
    assert text in str(caught.value)
    assert str(caught.value).endswith(f" (number {bad} of the platforms)")
    assert caught.value.field.startswith(name)
    refuse_impossible(PLATFORMS, np.arange(3) != bad, {name: values})
    with pytest.raises(PlatformError) as alone:
        replace(PLATFORMS[bad], **{name: value})
    assert str(caught.value) == f"{alone.value} (number {bad} of the platforms)"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("leg_viscous_friction", 0.0),
        ("leg_coulomb_friction_factor", np.zeros(6)),
        ("platform_inertia", FLAT),
        ("gravity", np.array([0.0, -9e29, 0.0])),
        # farther than the farthest joint, but not ten times
        ("platform_com", np.array([0.0, 5.0, 0.0])),
    ],
)
def test_values_at_their_bound_are_possible(name: str, value: Any) -> None:
    values = np.array(getattr(PRESENT, name))
    values[1] = value
    refuse_impossible(PLATFORMS, ALL, {name: values})


def test_values_are_possible_with_the_platform_s_other_parameters() -> None:
    """Expected: of two doubtful members, of different size, only the one whose own joints are too near is refused."""
    small = replace(UNEVEN, platform_points=0.4 * UNEVEN.platform_points)
    com = np.array([[0.0, 0.0, 5.0]] * 3)
    refuse_impossible([UNEVEN] * 3, ALL, {"platform_com": com})
    with pytest.raises(PlatformError, match=r"\(number 2 of the platforms\)$"):
        refuse_impossible([UNEVEN, UNEVEN, small], ALL, {"platform_com": com})
