"""Units of platforms with joints that legs share, against Kane's equations."""

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.model.formulations import kane
from tests.support.fmu_plants import ERROR, OK, Fmu, plant, refused
from tests.support.shared_joints import SHARED
from tests.support.uneven import INPUTS, MOVING, STATE, UNEVEN


@pytest.mark.parametrize("platform", SHARED, ids=lambda platform: platform.name)
def test_a_unit_moves_as_kane_does(fmu: Fmu, platform: gs.Platform) -> None:
    """Expected: the constrained equations of motion of all bodies, integrated."""
    start = kane.consistent_start(platform, STATE)
    expected = kane.integrate(platform, *start, INPUTS, np.array([0.0, 0.2])).platform
    with plant(fmu) as p:
        p.start(MOVING, 1e-10, platform=platform)
        p.do_step(0.0, 0.2)
        assert p.get("position") == pytest.approx(expected.position[-1], abs=2e-7)
        assert p.get("orientation") == pytest.approx(expected.orientation[-1], abs=2e-7)


@pytest.mark.parametrize(("one", "other"), [(0, 5), (1, 3), (4, 2)])
@pytest.mark.parametrize("name", ["base_points", "platform_points"])
def test_legs_that_share_both_joints_are_named(fmu: Fmu, name: str, one: int, other: int) -> None:
    """Expected: closer than a millionth of the largest distance is one joint; one end may be shared."""
    low, high = sorted((one + 1, other + 1))
    elsewhere = {"base_points", "platform_points"} - {name}
    for share, shares_both, is_one in ((0.5, False, False), (0.5, True, True), (2.0, True, False)):
        points = {key: np.array(getattr(UNEVEN, key)) for key in ("base_points", "platform_points")}
        for key in (name, *elsewhere) if shares_both else (name,):
            points[key][other] = points[key][one]
        widest = max(np.linalg.norm(a - b) for a in points[name] for b in points[name])
        points[name][other] += share * 1e-6 * widest * np.array([0.6, 0.0, -0.8])
        with plant(fmu) as p:
            status = refused(p.start, {**MOVING, **points})
            said = p.take_messages()
        assert (f"legs {low} and {high} share both joints" in said) == is_one
        assert is_one or shares_both or status == OK
        assert not is_one or status == ERROR
