"""What a Platform accepts, refuses, and promises."""

import pickle
import re
from copy import deepcopy
from dataclasses import FrozenInstanceError, replace
from typing import Any

import numpy as np
import pytest

from gough_stewart import GoughStewartError, Platform, leg_geometry, load_preset, preset_names
from gough_stewart.model.kinematics import conditioning
from tests.support.lagrangian import FloatArray
from tests.support.uneven import UNEVEN


def refused(platform: Platform, message: str, **change: Any) -> str:
    """The field of the error of a change, which is the same by `replace` and, for numbers, by `with_parameters`."""
    with pytest.raises(GoughStewartError, match=message) as caught:
        replace(platform, **change)
    if not {"name", "source"} & {*change}:
        with pytest.raises(GoughStewartError, match=f"^{re.escape(str(caught.value))}$"):
            platform.with_parameters(change)
    return str(vars(caught.value)["field"])


def says(text: str, **change: Any) -> None:
    """The change of the uneven platform is refused in exactly these words."""
    assert refused(UNEVEN, f"^{re.escape(text)}$", **change) == text.partition(": ")[0]


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("base_points", np.zeros((5, 3)), r"has shape \(5, 3\); expected numbers of shape \(6, 3\)"),
        ("platform_mass", [1.0, 2.0], r"has shape \(2,\); expected one number"),
        ("platform_com", 0.1, r"has shape \(\); expected numbers of shape \(3,\)"),
        ("platform_points", "round", "expected numbers of shape"),
        ("platform_points", [[1, 2], [3]], "expected numbers of shape"),
        ("gravity", [0, 0, np.nan], "expected finite numbers"),
        ("platform_mass", True, "expected one number"),
        ("platform_mass", "10", "expected one number"),
        ("platform_mass", None, "expected one number"),
        ("platform_mass", np.inf, "expected finite numbers"),
        ("home_orientation", [0, 0, np.pi / 2], "leg Jacobian is singular at the home pose"),
        ("home_position", [0, 0, 0.0], "leg Jacobian is singular at the home pose"),
        ("base_points", np.append(np.arange(17.0), -1e200).reshape(6, 3), "expected numbers below 1e"),
    ],
)
def test_an_impossible_parameter_is_refused_by_name(paper: Platform, field: str, value: Any, message: str) -> None:
    assert field in refused(paper, message, **{field: value})


@pytest.mark.parametrize("name", preset_names())
def test_presets_are_well_conditioned_and_cite_a_source(name: str) -> None:
    platform = load_preset(name)
    home = platform, platform.home_position, platform.home_orientation
    assert conditioning(*home).condition_number < 10
    assert platform.name == name
    assert platform.source


def test_published_preset_follows_the_formulas_of_the_appendix(paper: Platform) -> None:
    """Expected: the appendix, + first: azimuths 2(i−1)π/3 ± π/12, and the platform joint 30° away."""
    base, top = [], []
    for i in (1, 2, 3):
        for sign in (1, -1):
            azimuth = 2 * (i - 1) * np.pi / 3 + sign * np.pi / 12
            base.append([2 * np.sin(azimuth), 2 * np.cos(azimuth), 0])
            near = azimuth + sign * np.pi / 6
            top.append([np.sin(near), np.cos(near), 0])
    assert np.allclose(paper.base_points, base, atol=1e-15)
    assert np.allclose(paper.platform_points, top, atol=1e-15)


def test_desktop_preset_has_the_published_leg_length() -> None:
    """Expected: 0.170350 m, a number of the source that the file does not hold."""
    platform = load_preset("desktop_hexapod")
    length = leg_geometry(platform, platform.home_position, platform.home_orientation).length
    assert np.allclose(length, 0.170350, atol=1e-6)


def test_motion_base_masses_are_those_of_the_sources_cylinders() -> None:
    """Expected: cylinder formulas with the source's density and dimensions."""
    platform, rho = load_preset("motion_base"), 76e3 / 9.81
    L = leg_geometry(platform, platform.home_position, platform.home_orientation).length[0]
    assert platform.platform_mass == pytest.approx(rho * np.pi * 0.05, abs=0.05)
    assert platform.leg_lower_mass == pytest.approx(rho * np.pi * (0.05**2 - 0.03**2) * 0.75 * L, abs=0.05)
    assert platform.leg_upper_mass == pytest.approx(rho * np.pi * 0.03**2 * 0.75 * L, abs=0.05)
    assert platform.leg_lower_com == pytest.approx(0.375 * L, abs=0.001)


def test_errors_name_joint_element_and_number_in_whole_sentences() -> None:
    """Expected: the pair of joints, the elements, the moments by hand; legs and elements that are not the first."""
    base, top = UNEVEN.base_points.copy(), UNEVEN.platform_points.copy()
    base[4], top[5] = base[2], top[1]
    refused(UNEVEN, r"^base_points: joints 1 and 2 coincide at \(1, 2, 3\) m", base_points=np.tile([1.0, 2, 3], (6, 1)))
    different = "m; expected six different points (an idealised double joint needs a small offset)"
    says(f"base_points: joints 3 and 5 coincide at (1.47, -1.32, 0.07) {different}", base_points=base)
    says(f"platform_points: joints 2 and 6 coincide at (-0.69, 0.75, 0.03) {different}", platform_points=top)
    says(
        "platform_inertia: is not positive definite: principal moments (-1, 2, 2.5) kg m²; expected all > 0",
        platform_inertia=np.diag([2.0, -1.0, 2.5]),
    )
    for name, end in (("leg_lower_com", "base"), ("leg_upper_com", "platform")):
        length = leg_geometry(UNEVEN, UNEVEN.home_position, UNEVEN.home_orientation).length.min()
        says(
            f"{name}: is 3.1 m from the {end} joint; expected between 0 and the shortest leg of the home pose, "
            f"{length:g} m",
            **{name: 3.1},
        )
    says("leg_length_min: is 3.95 m; expected below leg_length_max = 3.9 m", leg_length_min=3.95)
    says("joint_angle_max: is 40 rad; expected at most π (radians, not degrees)", joint_angle_max=40.0)
    says("home_orientation: has pitch -1.58 rad; expected less than ±90°", home_orientation=[0.1, -1.58, 0.3])
    says(
        "leg_viscous_friction_factor[4]: is -0.1; expected >= 0: each leg's viscous friction over leg_viscous_friction",
        leg_viscous_friction_factor=[0.7, 1.4, 0.9, -0.1, -0.5, 1.1],
    )
    says("platform_mass: is -2 kg; expected > 0: mass of the platform with payload", platform_mass=-2)
    says("actuator_power_max: is 0 W; expected > 0, or leave it out: maximum actuator power", actuator_power_max=0.0)
    says("source: is 3; expected a text", source=3)
    says("name: is None; expected a text", name=None)


def beside(name: str, share: float) -> dict[str, Any]:
    """Joint 6 of base or platform beside joint 4, at a share of the largest distance of two of them."""
    points = getattr(UNEVEN, name).copy()
    largest = np.linalg.norm(points[:, None] - points[None], axis=-1).max()
    points[5] = points[3] + share * largest * np.array([0.0, 0.6, 0.8])
    return {name: points, "leg_length_min": None, "leg_length_max": None}


def skewed(share: float) -> FloatArray:
    """The inertia with one element changed by a share of its largest, 8.1."""
    J = UNEVEN.platform_inertia.copy()
    J[0, 2] += share * 8.1
    return J


HOME_LEGS = leg_geometry(UNEVEN, UNEVEN.home_position, UNEVEN.home_orientation).length
FAR = 10 * float(np.sqrt((UNEVEN.platform_points**2).sum(axis=1)).max()) * np.array([0.6, 0.0, 0.8])
STEEP = np.pi / 2 - 1e-3
FREE: dict[str, Any] = {"leg_length_min": None, "leg_length_max": None}
TOO_LARGE = r"expected numbers below 1e\+30 in SI units"
# Just accepted, just refused, and the words.
BOUNDS: list[tuple[dict[str, Any], dict[str, Any], str]] = [
    (beside("base_points", 1.1e-6), beside("base_points", 0.9e-6), "joints 4 and 6 coincide"),
    (beside("platform_points", 1.1e-6), beside("platform_points", 0.9e-6), "joints 4 and 6 coincide"),
    ({"platform_inertia": skewed(0.9e-9)}, {"platform_inertia": skewed(1.1e-9)}, "not symmetric"),
    ({"platform_inertia": np.diag([2, 1, 3 + 2.7e-9])}, {"platform_inertia": np.diag([2, 1, 3 + 3.3e-9])}, "triangle"),
    ({"platform_com": (1 - 1e-9) * FAR}, {"platform_com": (1 + 1e-9) * FAR}, "ten times"),
    ({"joint_angle_max": np.pi}, {"joint_angle_max": np.nextafter(np.pi, 4)}, "at most π"),
    (
        {"leg_length_min": float(HOME_LEGS.min())},
        {"leg_length_min": np.nextafter(HOME_LEGS.min(), 9)},
        "but a home leg is",
    ),
    (
        {"leg_length_max": float(HOME_LEGS.max())},
        {"leg_length_max": np.nextafter(HOME_LEGS.max(), 0)},
        "but a home leg is",
    ),
    ({"platform_mass": 1e30}, {"platform_mass": 1.1e30}, f"^platform_mass: is 1.1e\\+30; {TOO_LARGE}"),
    ({"actuator_force_max": 1e30}, {"actuator_force_max": 1.1e30}, f"^actuator_force_max: is 1.1e\\+30; {TOO_LARGE}"),
    *(({"gravity": [0, s * 1e30, 0]}, {"gravity": [0, s * 1.1e30, 0]}, f"^gravity: is .*{TOO_LARGE}") for s in (1, -1)),
    *(
        (
            {"home_orientation": [0.0, s * (STEEP - 1e-9), 0.0], **FREE},
            {"home_orientation": [0.0, s * (STEEP + 1e-9), 0.0], **FREE},
            f"has pitch {s * STEEP:g} rad",
        )
        for s in (1, -1)
    ),
]


@pytest.mark.parametrize(("inside", "outside", "text"), BOUNDS)
def test_bounds_hold_from_both_sides(inside: dict[str, Any], outside: dict[str, Any], text: str) -> None:
    """Expected: a millionth of the largest distance, 1e-9 of an inertia, ten radii, π, 1e30, home legs, 1e-3 of 90°."""
    for name, value in inside.items():
        assert np.array_equal(getattr(replace(UNEVEN, **inside), name), value)
    refused(UNEVEN, text, **outside)


def test_a_change_may_contradict_what_stays() -> None:
    """Expected: legs of the new home pose beyond the stroke, and shorter than a part's centre of mass."""
    home = UNEVEN.home_position
    refused(UNEVEN, "^leg_length_max: is 3.9 m, but a home leg is", home_position=home * [1, 1, 1.4])
    refused(UNEVEN, "^leg_length_max: is 3.9 m, but a home leg is", base_points=UNEVEN.base_points - [0, 0, 0.9])
    refused(UNEVEN, "^leg_lower_com: is 2 m", home_position=home * [1, 1, 0.5], leg_lower_com=2.0, **FREE)


def test_a_home_pose_is_singular_from_a_condition_number_of_1e8_on(paper: Platform) -> None:
    """Expected: NumPy's condition number with scaled angles of yaws beside Fichter's singular pose at 90°."""
    for off, is_singular in ((5e-8, False), (3e-8, True)):
        orientation = np.array([0.0, 0.0, np.pi / 2 - off])
        turn = np.array([[np.sin(off), -np.cos(off), 0], [np.cos(off), np.sin(off), 0], [0, 0, 1]])
        arm = paper.platform_points @ turn.T
        l = paper.home_position + arm - paper.base_points
        u = l / np.linalg.norm(l, axis=1)[:, None]
        number = np.linalg.cond(np.hstack([u, np.cross(arm, u)]))  # all joints 1 m from Op
        assert (number > 1e8) == is_singular
        if is_singular:
            text = r"singular at the home pose \(condition number .*below 1e\+08"
            refused(paper, text, home_orientation=orientation)
        else:
            assert replace(paper, home_orientation=orientation).home_orientation[2] == orientation[2]


# With all that an ideal plant does not have, so that no number is 0.
REAL = replace(
    UNEVEN,
    leg_friction_model="lugre",
    leg_static_friction=1.4 * UNEVEN.leg_coulomb_friction,
    leg_bristle_stiffness=1e6,
    leg_bristle_damping=31.0,
    leg_breakaway_share=0.7,
    leg_stiffness=2e6,
    leg_damping=17.0,
)


@pytest.mark.parametrize("name", [*UNEVEN.as_dict(), "leg_velocity_max"])
def test_equal_platforms_are_equal_in_every_field(name: str) -> None:
    """Expected: a change of the last number of any field makes another platform; the same value makes the same."""
    value: Any = getattr(REAL, name)
    assert replace(REAL, **{name: value}) == REAL
    assert hash(replace(REAL, **{name: value})) == hash(REAL)
    other: Any = f"{value}x" if isinstance(value, str) else 1.3 if value is None else np.array(value)
    if isinstance(other, np.ndarray):
        other[(-1,) * other.ndim] *= 1 + 1e-12
    if name == "leg_friction_model":
        other = "elasto_plastic"
    assert replace(REAL, **{name: other}) != REAL


def test_the_friction_of_screws_is_that_of_their_preload() -> None:
    """Expected: JIS B 1192 with a third of the largest force and the screw of motion_base; all else as there."""
    screws, base = load_preset("motion_base_screws"), load_preset("motion_base")
    assert screws.actuator_force_max is not None
    preload, lead, diameter = screws.actuator_force_max / 3, 0.025, 0.04
    torque = 0.05 * (lead / (np.pi * diameter)) ** -0.5 * preload * lead / (2 * np.pi)
    assert screws.leg_coulomb_friction == pytest.approx(2 * np.pi * torque / lead, rel=0.01)
    assert screws.leg_static_friction / screws.leg_bristle_stiffness == pytest.approx(20e-6)
    friction = ("friction_model", "coulomb_friction", "static_friction", "stribeck_velocity", "bristle_stiffness")
    own = ("name", "source", *(f"leg_{each}" for each in friction))
    assert replace(screws, **{name: getattr(base, name) for name in own}) == base


def test_a_platform_and_its_copies_are_read_only_and_share_no_memory_with_what_they_were_made_from() -> None:
    points = UNEVEN.base_points.copy()
    platform = replace(UNEVEN, base_points=points)
    points[0, 0] = 99
    for copied in (platform, deepcopy(platform), pickle.loads(pickle.dumps(platform))):
        assert copied == UNEVEN
        with pytest.raises(FrozenInstanceError):
            copied.platform_mass = 3.0  # type: ignore[misc]
        for array in (copied.base_points, copied.gravity):
            with pytest.raises(ValueError, match="read-only"):
                array[-1] = 1.0
