"""What a Platform accepts, refuses, and promises."""

import pickle
from collections.abc import Callable
from copy import deepcopy
from dataclasses import FrozenInstanceError, replace
from typing import Any

import numpy as np
import pytest

from gough_stewart.model.errors import GoughStewartError, PlatformError
from gough_stewart.model.kinematics import conditioning, leg_geometry
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset, preset_names
from tests.support.uneven import UNEVEN

COINCIDENT = np.array([[2.0, 0, 0], [2.0, 0, 0], [0, 2, 0], [0, -2, 0], [-2, 0, 0], [1, 1, 0]])


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
        ("platform_mass", -10.0, "is -10 kg; expected > 0: mass of the platform"),
        ("leg_lower_mass", 0.0, "is 0 kg; expected > 0"),
        ("leg_upper_mass", -1.0, "is -1 kg; expected > 0"),
        ("leg_lower_inertia", -0.1, r"is -0.1 kg.m2; expected >= 0"),
        ("platform_inertia", [[5, 1, 0], [0, 5, 0], [0, 0, 10]], r"not symmetric: \[1,2\] = 1 but \[2,1\] = 0"),
        ("platform_inertia", np.diag([5, -5, 10]), "not positive definite"),
        ("platform_inertia", np.diag([5, 5, 10.1]), "triangle inequality"),
        ("leg_lower_com", -0.1, "is -0.1 m; expected >= 0"),
        ("leg_upper_com", 4.0, "expected between 0 and the shortest leg"),
        ("platform_com", [0, 0, 100.0], "more than ten times"),
        ("base_points", COINCIDENT, "joints 1 and 2 coincide"),
        ("platform_points", COINCIDENT, "joints 1 and 2 coincide"),
        ("leg_viscous_friction", -1.0, "is -1 N.s/m; expected >= 0"),
        ("leg_coulomb_friction", -1.0, "is -1 N; expected >= 0"),
        ("leg_friction_velocity", 0.0, "is 0 m/s; expected > 0"),
        ("home_orientation", [0, 1.6, 0], "expected less than ±90°"),
        ("home_orientation", [0, 0, np.pi / 2], "leg Jacobian is singular at the home pose"),
        ("home_position", [0, 0, 0.0], "leg Jacobian is singular at the home pose"),
        ("leg_length_min", 3.5, "but a home leg is 3.2459 m long"),
        ("leg_length_max", 3.0, "but a home leg is 3.2459 m long"),
        ("leg_length_min", -1.0, "is -1 m; expected > 0, or leave it out"),
        ("actuator_force_max", 0.0, "is 0 N; expected > 0, or leave it out"),
        ("joint_angle_max", 45.0, "radians, not degrees"),
        ("name", 3, "expected a text"),
        ("base_points", np.append(np.arange(17.0), -1e200).reshape(6, 3), "expected numbers below 1e"),
    ],
)
def test_an_impossible_parameter_is_refused_by_name(paper: Platform, field: str, value: Any, message: str) -> None:
    with pytest.raises(PlatformError, match=message) as caught:
        replace(paper, **{field: value})
    assert field in caught.value.field
    assert isinstance(caught.value, GoughStewartError)


def test_base_and_platform_joint_in_one_place_is_refused(paper: Platform) -> None:
    shifted = paper.home_position - (paper.home_position + paper.platform_points[0] - paper.base_points[0])
    with pytest.raises(PlatformError, match="joint 1 coincide in the home pose"):
        replace(paper, home_position=shifted)


@pytest.mark.parametrize("leg", range(6))
def test_a_leg_of_no_length_is_told_by_its_share_of_the_base(leg: int) -> None:
    """Expected: a millionth of the largest coordinate of a base joint, 2.04 m."""
    joint = UNEVEN.base_points[leg] - leg_geometry(UNEVEN, np.zeros(3), UNEVEN.home_orientation).arm[leg]
    for share, message in ((0.9, f"joint {leg + 1} coincide in the home pose"), (1.1, "leg_lower_com")):
        above = joint + share * 2.04e-6 * np.array([0.6, 0.0, 0.8])
        with pytest.raises(PlatformError, match=message):
            replace(UNEVEN, home_position=above)


def test_contradictory_stroke_is_refused(paper: Platform) -> None:
    with pytest.raises(PlatformError, match="expected below leg_length_max"):
        replace(paper, leg_length_min=3.0, leg_length_max=2.0)


def test_a_disc_on_the_edge_of_the_triangle_inequality_is_accepted(paper: Platform) -> None:
    """Expected: a flat body has J_z = J_x + J_y exactly, as the published platform does."""
    assert np.linalg.eigvalsh(paper.platform_inertia)[2] == 10.0


def test_is_frozen_and_its_arrays_are_read_only(paper: Platform) -> None:
    with pytest.raises(FrozenInstanceError):
        paper.platform_mass = 3.0  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        paper.base_points[0, 0] = 1.0


@pytest.mark.parametrize("copied", [deepcopy, lambda platform: pickle.loads(pickle.dumps(platform))])
def test_copies_are_equal_and_read_only(paper: Platform, copied: Callable[[Platform], Platform]) -> None:
    other = copied(paper)
    assert other == paper
    with pytest.raises(ValueError, match="read-only"):
        other.gravity[2] = 0


def test_does_not_share_memory_with_what_it_was_made_from(paper: Platform) -> None:
    points = paper.base_points.copy()
    platform = replace(paper, base_points=points)
    points[0, 0] = 99
    assert platform == paper


def test_equal_platforms_hash_alike_and_different_ones_differ(paper: Platform) -> None:
    same = replace(paper)
    assert same == paper
    assert hash(same) == hash(paper)
    assert replace(paper, platform_mass=11) != paper
    assert paper != "liu2000"


@pytest.mark.parametrize(
    ("name", "size", "mass"), [("desktop_hexapod", (0.1, 0.4), (1, 3)), ("motion_base", (2, 4), (1000, 2000))]
)
def test_presets_have_the_size_they_claim(name: str, size: tuple[float, float], mass: tuple[float, float]) -> None:
    platform = load_preset(name)
    reach = np.linalg.norm(platform.base_points, axis=1).max()
    assert size[0] <= reach <= size[1]
    assert mass[0] <= platform.platform_mass <= mass[1]


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


def test_published_platform_joints_are_those_of_the_appendix(paper: Platform) -> None:
    """Expected: the set (2i−1)π/3 ± π/12 in whatever order."""
    azimuths = sorted(np.degrees(np.arctan2(*paper.platform_points[:, :2].T)) % 360)
    assert np.allclose(azimuths, [45, 75, 165, 195, 285, 315])


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
