"""Platform files as data sheets state them: units, cylindrical coordinates, joints that legs share."""

import re
from typing import Any

import numpy as np
import pytest
import tomlkit

import gough_stewart as gs
from tests.support.platform_files import loaded, written
from tests.support.shared_joints import SHARED, THREE_THREE
from tests.support.uneven import UNEVEN

_JOINTS = ("base_points", "platform_points")


def file_with(changes: dict[str, Any], platform: gs.Platform = UNEVEN) -> str:
    """The text of a platform's file with other values, of which those that are None are left out."""
    values = tomlkit.parse(written(platform)).unwrap() | changes
    return tomlkit.dumps({name: value for name, value in values.items() if value is not None})


# A parameter of the uneven platform, as a data sheet writes it; the value in SI units is by hand.
UNITS: list[tuple[str, Any, Any]] = [
    ("platform_mass", "11500 g", 11.5),
    ("leg_lower_mass", "0.0023 t", 2.3),
    ("leg_upper_com", "58 cm", 0.58),
    ("leg_lower_com", "470mm", 0.47),
    ("home_position", ["80 mm", "-5 cm", 2.9], [0.08, -0.05, 2.9]),
    ("home_orientation", ["2 deg", 0, "-90 mrad"], [np.pi / 90, 0, -0.09]),
    ("platform_inertia", [["4.6e6 kg mm2", 0, 0], [0, "5.7e9 g·mm²", 0], [0, 0, 8.1]], np.diag([4.6, 5.7, 8.1])),
    ("leg_lower_inertia", "0.13 kg m²", 0.13),
    ("leg_viscous_friction", ["7 N.s/m", 8, 9, 10, 11, "0.012 kN.s/m"], [7, 8, 9, 10, 11, 12]),
    ("leg_coulomb_friction", "0.0019 kN", 1.9),
    ("leg_friction_velocity", "60 mm/s", 0.06),
    ("gravity", [0, 0, "-9.81 m/s2"], [0, 0, -9.81]),
    ("joint_angle_max", "40 deg", np.radians(40)),
    ("actuator_power_max", "1.2 kW", 1200),
]


def test_values_may_have_units_alone_or_in_lists() -> None:
    """Expected: the platform with the same values in SI units."""
    texts = {name: text for name, text, _ in UNITS}
    found = loaded(file_with({"leg_viscous_friction_factor": None, **texts}))
    expected = UNEVEN.with_parameters({name: value for name, _, value in UNITS})
    for name, value in expected.as_dict().items():
        if not isinstance(value, str):
            assert getattr(found, name) == pytest.approx(value, rel=1e-14), name
    assert loaded(written(found)) == found


@pytest.mark.parametrize("name", _JOINTS)
def test_joints_may_have_cylindrical_coordinates(name: str) -> None:
    """Expected: r and the angle from X towards Y, by NumPy's complex numbers; with units or in SI."""
    points = getattr(UNEVEN, name)
    on_plane = points[:, 0] + 1j * points[:, 1]
    rows: list[list[Any]] = np.stack([np.abs(on_plane), np.angle(on_plane), points[:, 2]], axis=-1).tolist()
    rows[2] = [f"{1e3 * rows[2][0]} mm", f"{np.degrees(rows[2][1])} deg", f"{100 * rows[2][2]} cm"]
    found = loaded(file_with({name: None, f"{name}_cylindrical": rows}))
    assert getattr(found, name) == pytest.approx(points, abs=1e-14)
    assert found.platform_mass == UNEVEN.platform_mass


def test_legs_join_joints_that_are_listed_in_any_order() -> None:
    """Expected: the platform whose joints are listed by leg; lists of six, and of three that legs share."""
    rng = np.random.default_rng(5)
    orders = [rng.permutation(6) for _ in _JOINTS]
    lists = {n: getattr(UNEVEN, n)[order].tolist() for n, order in zip(_JOINTS, orders, strict=True)}
    legs = np.stack([np.argsort(order) + 1 for order in orders], axis=-1).tolist()
    assert loaded(file_with({**lists, "legs": legs})) == UNEVEN
    three = {
        "base_points": THREE_THREE.base_points[::2].tolist(),
        "platform_points": THREE_THREE.platform_points[:3].tolist(),
    }
    shared = [[1, 1], [1, 2], [2, 3], [2, 1], [3, 2], [3, 3]]
    assert loaded(file_with({**three, "legs": shared}, THREE_THREE)) == THREE_THREE


ROWS = [[1.0, 0.3 * k, 0.0] for k in range(6)]
ONE_TO_ONE = [[k, k] for k in range(1, 7)]
TURN = "expected a full turn at most"
# Changes of the file, and the text of the error.
WRONG: list[tuple[dict[str, Any], str]] = [
    ({"platform_mass": "12 m"}, "platform_mass is '12 m'; expected a number of kg, or a string with one of the units"),
    ({"base_points_cylindrical": ROWS}, "base_points: is also determined by base_points_cylindrical; expected only"),
    (
        {"base_radius": 1, "platform_radius": 1, "base_angle": 1, "platform_angle": 1, "home_leg_length": 3}
        | dict.fromkeys((*_JOINTS, "home_position", "home_orientation"))
        | {"platform_points_cylindrical": ROWS},
        "platform_points_cylindrical: is also determined by base_radius",
    ),
    *(
        ({"base_points": None, "base_points_cylindrical": rows}, f"base_points{says}")
        for rows, says in (
            (ROWS[:5], ": has shape (5, 3); expected"),
            ([*ROWS[:4], [1, 0], [1, 0, 0]], "_cylindrical[5]: is [1, 0]; expected a row [radius, angle, z]"),
            ([[-1, 0, 0], *ROWS[1:]], "_cylindrical[1]: has the radius -1 m; expected 0 or more"),
            ([ROWS[0], [1, 30, 0], *ROWS[2:]], f"_cylindrical[2]: has the angle 30 rad; {TURN}, or a text, '30 deg'"),
        )
    ),
    ({"legs": ONE_TO_ONE[:5]}, "legs: has 5 rows; expected six"),
    ({"legs": [*ONE_TO_ONE[:5], [6, 0]]}, "legs[6]: is [6, 0]; expected two numbers of joints, from 1"),
    ({"legs": [[7, 1], *ONE_TO_ONE[1:]]}, "legs[1]: names joint 7; base_points has 6, numbered from 1"),
    ({"legs": [[1, 1], [2, 1], *ONE_TO_ONE[2:]]}, "legs: leaves out joint 2 of platform_points; expected a leg at"),
    ({"legs": ONE_TO_ONE, "base_points": 3}, "base_points: is 3; expected a list of joints"),
    ({"base_point_cylindrical": ROWS}, "unknown key 'base_point_cylindrical'; did you mean 'base_points_cylindrical'?"),
]


@pytest.mark.parametrize(("changes", "says"), WRONG, ids=lambda value: value[:40] if isinstance(value, str) else "")
def test_what_is_no_list_of_joints_says_what_is_one(changes: dict[str, Any], says: str) -> None:
    with pytest.raises(gs.GoughStewartError, match=f"^.*mine.toml: {re.escape(says)}"):
        loaded(file_with(changes))


def test_files_and_circles_have_shared_joints() -> None:
    """Expected: the same platform; circles with an angle of 0 have a joint for each pair, the distances by hand."""
    for platform in SHARED:
        assert loaded(written(platform)) == platform
    left_out = (*_JOINTS, "home_position", "home_orientation", "leg_length_max")
    rest = {name: value for name, value in UNEVEN.as_dict().items() if name not in left_out}
    octahedron = gs.Platform.from_radii(2.0, 1.2, 0.0, 0.0, home_leg_length=2.8, **rest)
    assert octahedron.base_points[[0, 1, 3]] == pytest.approx(octahedron.base_points[[5, 2, 4]], abs=1e-15)
    assert octahedron.platform_points[::2] == pytest.approx(octahedron.platform_points[1::2], abs=1e-15)
    # corners 60° apart: R² + r² − R r in the plane
    assert octahedron.home_position[2] == pytest.approx(np.sqrt(2.8**2 - (2.0**2 + 1.2**2 - 2.0 * 1.2)))
