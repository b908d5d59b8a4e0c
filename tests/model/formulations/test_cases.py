"""The open-loop case of the paper, number by number, and how it is scaled to other platforms."""

import numpy as np
import pytest

from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.formulations.cases import case_of, paper_case, with_pairs_swapped
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.platform_toml import load_preset
from tests.support.uneven import UNEVEN


def test_the_case_is_that_of_section_iv() -> None:
    """Expected: the numbers of the paper."""
    case = paper_case()
    assert np.concatenate(case.start).tolist() == [0, 0, 3, 0, 0, -0.1, 0, 0.2, 0, 0, 0.1, 0]
    assert case.actuator_force.tolist() == [55, 49.5, 55, 49.5, 55, 49.5]
    assert np.concatenate(case.inputs).tolist() == [55, 49.5, 55, 49.5, 55, 49.5, 0, 0, 0, 0, 0, 0]
    assert case.time == pytest.approx(np.arange(101) / 100)
    assert case.is_published
    assert not case.minus_first
    assert case.platform == load_preset("liu2000")


def test_minus_first_swaps_the_legs_of_each_pair_under_the_same_forces() -> None:
    """Expected: the appendix with − before +, azimuths 2(i−1)π/3 ∓ π/12."""
    case = paper_case(minus_first=True)
    azimuth = np.radians([-15, 15, 105, 135, 225, 255])
    base = 2 * np.stack([np.sin(azimuth), np.cos(azimuth), 0 * azimuth], axis=1)
    assert case.platform.base_points == pytest.approx(base, abs=1e-12)
    assert case.actuator_force.tolist() == paper_case().actuator_force.tolist()
    assert case.minus_first
    swapped = with_pairs_swapped(UNEVEN)
    for k, old in enumerate([1, 0, 3, 2, 5, 4]):
        assert swapped.base_points[k].tolist() == UNEVEN.base_points[old].tolist()
        assert swapped.platform_points[k].tolist() == UNEVEN.platform_points[old].tolist()


def test_on_another_platform_the_case_is_scaled_by_froude() -> None:
    """Expected: λ of the mean home legs; velocities × √λ, angular velocities / √λ, time × √λ; forces by statics."""
    case, home = case_of(UNEVEN), (UNEVEN.home_position, UNEVEN.home_orientation)
    root = np.sqrt(leg_geometry(UNEVEN, *home).length.mean() / np.sqrt(14 - 2 * np.sqrt(3)))
    assert case.start.position.tolist() == UNEVEN.home_position.tolist()
    assert case.start.orientation == pytest.approx(UNEVEN.home_orientation + np.array([0, 0, -0.1]))
    assert case.start.velocity == pytest.approx([0, 0.2 * root, 0])
    assert case.start.angular_velocity == pytest.approx([0, 0.1 / root, 0])
    assert case.duration == pytest.approx(root)
    assert case.actuator_force == pytest.approx(static_leg_forces(UNEVEN, *home) * [10 / 9, 1, 10 / 9, 1, 10 / 9, 1])
    assert not case.is_published


def test_the_papers_platform_under_another_name_has_the_papers_case() -> None:
    from dataclasses import replace

    renamed = replace(load_preset("liu2000"), name="mine", source="")
    case = case_of(renamed)
    assert case.platform == renamed
    assert case.is_published
    assert case.actuator_force.tolist() == paper_case().actuator_force.tolist()
