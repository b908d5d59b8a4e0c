"""Joints that two legs share at one end, as in 6-3 and 3-3 platforms: files, and what is said."""

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.platform_files import loaded, written
from tests.support.shared_joints import SHARED
from tests.support.uneven import UNEVEN


def test_files_and_circles_have_shared_joints() -> None:
    """Expected: the same platform; circles with an angle of 0 have a joint for each pair, the distances by hand."""
    for platform in SHARED:
        assert loaded(written(platform)) == platform
    rest = {name: value for name, value in UNEVEN.as_dict().items() if name not in (*_JOINTS, "leg_length_max")}
    octahedron = gs.Platform.from_radii(2.0, 1.2, 0.0, 0.0, home_leg_length=2.8, **rest)
    assert octahedron.base_points[[0, 1, 3]] == pytest.approx(octahedron.base_points[[5, 2, 4]], abs=1e-15)
    assert octahedron.platform_points[::2] == pytest.approx(octahedron.platform_points[1::2], abs=1e-15)
    # corners 60° apart: R² + r² − R r in the plane
    assert octahedron.home_position[2] == pytest.approx(np.sqrt(2.8**2 - (2.0**2 + 1.2**2 - 2.0 * 1.2)))


_JOINTS = ("base_points", "platform_points", "home_position", "home_orientation")


def test_two_legs_in_one_place_are_refused() -> None:
    """Expected: legs 2 and 5, which share both joints, within a millionth of the largest distance."""
    tips = UNEVEN.platform_points.copy()
    tips[4] = tips[1]
    for share in (0.0, 0.9e-6, 1.1e-6):
        base = UNEVEN.base_points.copy()
        widest = np.linalg.norm(base[:, None] - base[None], axis=-1).max()
        base[4] = base[1] + share * widest * np.array([0.6, 0, -0.8])
        changed = {"base_points": base, "platform_points": tips, "leg_length_min": None, "leg_length_max": None}
        if share > 1e-6:
            assert (UNEVEN.with_parameters(changed).base_points == base).all()
            continue
        with pytest.raises(gs.GoughStewartError, match=r"legs 2 and 5 share both joints, at \(-0.61, 1.88, -0.03\) m"):
            UNEVEN.with_parameters(changed)
