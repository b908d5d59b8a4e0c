"""Rule 7 of the stepping model: which steps fail, and what their errors say."""

from typing import Any

import numpy as np
import pytest

from gough_stewart.model.errors import StepError
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.pose_limits import check_pose
from gough_stewart.model.stepping import SteppingModel
from tests.model.test_stepping import refused, started

PAPER = load_preset("liu2000")


def fails(start: dict[str, Any], forces: Any, quantity: str, message: str, span: float = 5.0) -> None:
    """A step of this length fails by this quantity, at a time within it, and nothing changes (rules 7, 8)."""
    model = SteppingModel(PAPER)
    model.set_many({**start, "actuator_force": forces})
    model.set("gravity", [0, 0, 0])
    error = refused(model, lambda: model.do_step(0.0, span), StepError, message)
    assert isinstance(error, StepError)
    assert error.quantity == quantity
    assert 0 <= error.time <= span
    assert quantity in str(error)
    # and the model is still good for something
    model.set("actuator_force", np.zeros(6))
    model.do_step(0.0, 1e-4)


def test_rule_7_a_singular_pose_fails_the_step() -> None:
    """Legs pulled together lower the platform into the base plane, where they cannot hold it."""
    fails({}, [-100.0] * 6, "condition number of the leg Jacobian", "singular pose")


def test_rule_7_a_yaw_through_the_singular_pose_fails_the_step() -> None:
    fails({"angular_velocity": [0, 0, 3.0]}, [0.0] * 6, "condition number of the leg Jacobian", "singular pose", 1.0)


def test_rule_7_pitch_of_90_degrees_fails_the_step() -> None:
    start = {"orientation": [0, 1.56, 0], "angular_velocity": [0, 1.0, 0]}
    fails(start, [0.0] * 6, "orientation[2]", "the pitch has reached ±90°", 0.1)


def test_rule_7_a_collapsed_leg_fails_the_step() -> None:
    """The pose with P_1 on B_1 is the end of leg 1."""
    model = SteppingModel(PAPER)
    model.set("position", PAPER.base_points[0] - PAPER.platform_points[0])
    refused(model, lambda: model.do_step(0.0, 0.1), StepError, r"leg_length\[1\] = .* at time 0 s: the leg has")


def test_rule_7_a_tolerance_that_cannot_be_held_fails_the_step() -> None:
    """Forces beyond what double precision can integrate."""
    fails({}, [1e300] * 6, "internal step size", "cannot be met", 1e-3)


@pytest.mark.parametrize("force", [1e306, -1e307, 1e308, 1.7e308])
def test_rule_7_forces_whose_accelerations_overflow_fail_the_step(force: float) -> None:
    """Expected: an error at once, where SciPy's choice of a first step is not a number."""
    fails({}, [force] * 6, "internal step size", "cannot be met", 1e-3)


def test_rule_7_a_step_without_end_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the limit, made small here; the same motion passes in shorter steps."""
    monkeypatch.setattr("gough_stewart.model.integrator.MOST_INTERNAL_STEPS", 3)
    model = started()
    refused(model, lambda: model.do_step(0.0, 0.8), StepError, "internal steps = 4 .*too many for one step")
    model.do_step(0.0, 0.01)


def test_check_pose_tells_the_sides_of_a_singular_pose_apart(paper: Platform) -> None:
    upright = np.concatenate([paper.home_position, np.zeros(9)])
    turned = np.concatenate([paper.home_position, [0, 0, 2.0], np.zeros(6)])
    assert check_pose(paper, upright, 0.0) == -check_pose(paper, turned, 0.0)
    with pytest.raises(StepError, match="passed since the last internal step"):
        check_pose(paper, turned, 1.0, handedness=check_pose(paper, upright, 0.0))
