"""Leg kinematics against closed forms, also where a leg has no length."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from tests.support.uneven import STATE, UNEVEN


def test_the_legs_of_a_pose_are_those_of_elementary_geometry() -> None:
    """Expected: written out with SciPy's rotation."""
    arm = Rotation.from_euler("xyz", STATE.orientation).apply(UNEVEN.platform_points.copy())
    l = STATE.position + arm - UNEVEN.base_points
    L = np.linalg.norm(l, axis=1)
    u = l / L[:, None]
    legs = gs.leg_geometry(UNEVEN, *STATE[:2])
    for part, expected in zip(legs, (arm, l, L, u), strict=True):
        assert part == pytest.approx(expected, abs=1e-14)
    J = np.hstack([u, np.cross(arm, u)])
    assert gs.leg_jacobian(UNEVEN, *STATE[:2]) == pytest.approx(J, abs=1e-13)
    model = gs.SteppingModel(UNEVEN)
    model.set_many(STATE._asdict())
    assert model.get("leg_velocity") == pytest.approx(J @ np.concatenate(STATE[2:]), rel=1e-12)
    rho = np.sqrt((UNEVEN.platform_points**2).sum() / 6)
    assert UNEVEN.characteristic_length == pytest.approx(rho, rel=1e-12)


def test_a_leg_of_length_zero_is_a_singular_pose_that_its_neighbours_do_not_feel(paper: gs.Platform) -> None:
    """Expected: joints of leg 1 that meet to the last bit at the origin; a warning would fail the test."""
    base, points = paper.base_points.copy(), paper.platform_points.copy()
    base[0] = points[0] = [0.5, 1.0, 0.0]
    met = replace(paper, base_points=base, platform_points=points, home_orientation=np.zeros(3))
    o = np.zeros(3)
    assert gs.leg_geometry(met, o, o).length[0] == 0
    assert np.isnan(gs.mass_matrix(met, o, o)).any()
    with pytest.raises(gs.GoughStewartError, match="condition number inf"):
        gs.static_leg_forces(met, o, o)
    with pytest.raises(gs.GoughStewartError, match="condition number inf"):
        gs.inverse_dynamics(met, gs.State(o, o, o, o), gs.Acceleration(o, o))
    position = np.stack([met.home_position + 0.1, o, met.home_position - 0.1])
    strong = replace(met, actuator_force_max=1e4, leg_velocity_max=1.0, leg_stiffness=1e6, leg_armature=1.0)
    many: Any = gs.evaluate_poses(strong, position, o)
    assert many.condition_number[1] == np.inf
    # nothing is held there
    assert many.payload[0] > 0
    assert {many.payload[1], many.force_margin[1], many.largest_speed[1], *(values[1] for values in many[8:])} == {0}
    for k in (0, 2):
        one = gs.evaluate_poses(met, position[k], o)
        assert (many.limit[k], many.condition_number[k]) == (0, pytest.approx(one.condition_number, rel=1e-12))
        assert gs.leg_jacobian(met, position, o)[k] == pytest.approx(gs.leg_jacobian(met, position[k], o), rel=1e-13)
