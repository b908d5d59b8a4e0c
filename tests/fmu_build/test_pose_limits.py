"""Limits of the pose in a unit, from both sides: the condition number, the sign of det J, derivatives."""

import re
from ctypes import c_double
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

from gough_stewart.model.kinematics import leg_geometry, scaled_jacobian_of_legs
from tests.support.fmu_plants import DISCARD, ERROR, OK, Fmu, plant, refused
from tests.support.uneven import UNEVEN

REST = np.zeros(3)
# The platform turns through a pose in which det J changes its sign.
TURNED = (1.0, 2.5)


def jacobian(yaw: float) -> NDArray[np.float64]:
    """With angles scaled to lengths."""
    legs = leg_geometry(UNEVEN, UNEVEN.home_position, np.array([0.0, 0.0, yaw]))
    return np.asarray(scaled_jacobian_of_legs(legs)[0])


def singular_yaw() -> float:
    return float(brentq(lambda yaw: np.linalg.det(jacobian(yaw)), *TURNED, xtol=1e-15))


def turned(yaw: float, rate: float = 0.0) -> dict[str, Any]:
    """Start values at a yaw, with no other motion."""
    pose = {"position": UNEVEN.home_position, "orientation": [0.0, 0.0, yaw]}
    return {**pose, "velocity": REST, "angular_velocity": [0.0, 0.0, rate]}


def test_a_pose_is_refused_from_the_condition_number_of_numpy_on(fmu3: Fmu) -> None:
    """Expected: ‖J‖‖J⁻¹‖ by NumPy's inverse; 1e8 is the limit, on both sides of the singular pose."""
    seen = set()
    for side in (-1, 1):
        for distance in (1e-9, 3e-9, 1e-8, 1e-7, 1e-6, 1e-3):
            yaw = singular_yaw() + side * distance
            J = jacobian(yaw)
            number = np.linalg.norm(J) * np.linalg.norm(np.linalg.inv(J))
            if 0.9 < number / 1e8 < 1.1:  # rounding decides
                continue
            with plant(fmu3) as p:
                status = refused(p.start, turned(yaw))
                assert status == (OK if number < 1e8 else ERROR), (number, yaw)
                seen.add((side, status))
                if status == ERROR:
                    (shown,) = re.findall(r"condition number of the leg Jacobian = (\S+): ", p.messages[-1].text)
                    assert float(shown) == pytest.approx(number, rel=1e-4)
    assert len(seen) == 4


@pytest.mark.parametrize("side", [1, -1])
def test_either_assembly_goes_on_in_its_own_half_and_cannot_pass_to_the_other(fmu: Fmu, side: int) -> None:
    """Expected: det J by NumPy has another sign on the other side, to which one large step would go."""
    yaw = singular_yaw() + side * 0.1
    assert np.linalg.det(jacobian(yaw)) * np.linalg.det(jacobian(yaw - 0.2 * side)) < 0
    with plant(fmu) as p:
        p.start({**turned(yaw), "actuator_force": [0.0] * 6})
        p.step(0.0, 1e-3)
        assert np.sign(np.linalg.det(jacobian(p.get("orientation")[2]))) == np.sign(np.linalg.det(jacobian(yaw)))
    with plant(fmu) as p:
        p.start({**turned(yaw, -side * 2000.0), "fixed_step_size": 1e-4})
        assert refused(p.step, 0.0, 1e-4) == DISCARD
        assert "the platform has passed a singular pose since the last internal step" in p.messages[-1].text
        assert p.get("orientation")[2] == yaw


def test_derivatives_that_are_not_finite_are_told_and_those_of_other_poses_given_again(fmu: Fmu) -> None:
    """Expected: a leg of no length has no direction, so no derivatives; at home again those of before."""
    home = np.concatenate([UNEVEN.home_position, np.zeros(9)])
    collapsed = np.concatenate([UNEVEN.base_points[3] - UNEVEN.platform_points[3], np.zeros(9)])
    told = "derivatives are not finite; the pose is singular or the forces are too large"
    found = (c_double * 12)()
    with plant(fmu, co_simulation=False) as p:
        p.start({"position": home[:3], "orientation": REST}, time=7.3)
        derivatives = p.fmu.getDerivatives if p.is_fmi2 else p.fmu.getContinuousStateDerivatives
        derivatives(found, 12)
        before = list(found)
        p.fmu.setContinuousStates((c_double * 12)(*collapsed), 12)
        for call, argument in ((derivatives, (found, 12)), (p.get, ("der(position)",)), (p.get, ("der(velocity)",))):
            assert refused(call, *argument) == DISCARD
            assert told in p.messages[-1].text
        p.fmu.setContinuousStates((c_double * 12)(*home), 12)
        derivatives(found, 12)
        assert list(found) == before
        assert np.array_equal(p.get("der(velocity)"), before[6:9])
        assert np.abs(before[6:]).min() > 1e-3
