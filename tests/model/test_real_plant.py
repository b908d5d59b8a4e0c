"""The stepping model of platforms that stick and give. Expected: standing still, energy balance, rules."""

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.model.errors import InterfaceError, StepError
from gough_stewart.model.fixed_steps import fixed_step, largest_step
from gough_stewart.model.kernel import Kernel, parameter_vector
from gough_stewart.model.kinematics import leg_geometry, leg_rates
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import State
from gough_stewart.model.variant import Variant
from tests.support.energy_balance import energy_balance
from tests.support.printed_machine import motion_by_radau
from tests.support.real_platforms import VARIANTS, gripped, real_platform
from tests.support.uneven import UNEVEN


@pytest.fixture(scope="module")
def motion_base() -> Platform:
    return gs.load_preset("motion_base")


@pytest.mark.parametrize(
    ("friction", "springs"), [("elasto_plastic", False), ("lugre", False), ("elasto_plastic", True)]
)
def test_legs_that_stick_hold_half_of_their_friction(motion_base: Platform, friction: str, springs: bool) -> None:
    """50 N on each leg more than its weight, with 100 N of Coulomb friction: stretched by micrometres, then still."""
    stiff: dict[str, Any] = {"leg_stiffness": 1e8} if springs else {}
    model = gs.SteppingModel(replace(motion_base, leg_friction_model=friction, leg_coulomb_friction=100.0, **stiff))
    model.set("actuator_force", model.get("actuator_force") + 50.0)
    # bristles that are not exactly alike: standing must not be a balance on a needle's point
    model.set("leg_bristle", 1e-17 * np.arange(6))
    heights: list[float] = []
    for end in (0.25, 0.5):
        while model.time < end - 1e-9:
            model.do_step(model.time, 0.005)
        heights.append(float(model.get("position[3]")) - 2.0)
    # 50 N over 1e7 N/m and the legs' slope
    assert 4e-6 < heights[0] < 2e-5
    assert abs(heights[1] - heights[0]) <= 1e-8


@pytest.mark.evidence
@pytest.mark.parametrize("friction", ["elasto_plastic", "lugre"])
def test_ten_seconds_under_half_of_the_friction_raise_nothing(motion_base: Platform, friction: str) -> None:
    model = gs.SteppingModel(replace(motion_base, leg_friction_model=friction, leg_coulomb_friction=100.0))
    model.set("actuator_force", model.get("actuator_force") + 50.0)
    model.set("leg_bristle", 1e-17 * np.arange(6))
    heights: list[float] = []
    for k in range(10_000):
        model.do_step(model.time, 0.001)
        if k in (4999, 9999):
            heights.append(float(model.get("position[3]")))
    assert abs(heights[1] - heights[0]) <= 1e-8


@pytest.mark.parametrize(("friction", "springs"), VARIANTS)
def test_work_becomes_energy_and_losses(friction: str, springs: bool) -> None:
    """Expected: ΔE + losses, these integrated by themselves from the printed laws; from presliding to sliding and back.

    Of steps under error control at 1e-11, and of fixed steps of 1 ms.
    """
    platform = real_platform(friction, springs)
    model = gs.SteppingModel(platform, tolerance=1e-11)
    model.set_many({"velocity": [0.06, -0.04, 0.1], "angular_velocity": [0.05, 0.1, -0.08]})
    force, steps = platform.home_actuator_force, 6
    inputs = np.zeros((steps, 12))
    inputs[:, :6] = [force + 90 * np.sin(1.1 * k + np.arange(6)) for k in range(steps)]
    states = [model.state]
    for k, u in enumerate(inputs):
        model.set_inputs(u)
        model.do_step(1e-3 * k, 1e-3)
        states.append(model.state)
    found = energy_balance(platform, np.array(states), inputs, 1e-3)
    assert found.throughput > 0.05
    assert found.losses > 0.01 * found.throughput
    # of a motion of 6 ms; whole loops, with more work, have 1e-10
    assert found.gap <= 5e-9 * found.throughput
    if friction == "smooth":
        return
    kernel, fixed = Kernel(Variant.of(platform)), [states[0]]
    for u in inputs:
        system = gripped(kernel, platform, u)
        fixed.append(fixed_step(system, fixed[-1], system.derivatives(fixed[-1]), 1e-3)[0])
    found = energy_balance(platform, np.array(fixed), inputs, 1e-3, 1e-10)
    assert found.gap <= 1e-5 * found.throughput


def test_a_model_takes_fixed_steps_up_to_the_largest_that_resolves_its_modes() -> None:
    """Expected: h |λ| = 2.6 for the motors on their springs, √(k/m_a + …) above √(k/m_a); what is larger is refused."""
    platform = real_platform("elasto_plastic", True, leg_armature=0.5)
    model = gs.SteppingModel(platform, fixed_step_size=1e-3)
    with pytest.raises(
        StepError, match=r"^fixed_step_size = 0\.001 at time 0 s: is too large for legs that stick"
    ) as e:
        model.do_step(0.0, 2e-3)
    assert model.time == 0
    largest = float(str(e.value).split("at most ")[1].split()[0])
    fast = np.sqrt((platform.leg_stiffness + platform.leg_bristle_stiffness) / platform.leg_armature)
    assert 0.7 * 2.6 / fast < largest < 2.6 / fast
    model = gs.SteppingModel(platform, fixed_step_size=0.999 * largest)
    model.do_step(0.0, 2e-3)
    assert model.time == 2e-3
    with pytest.raises(InterfaceError, match="fixed_step_size: is -1 s; expected 0 for error control, or > 0"):
        gs.SteppingModel(platform, fixed_step_size=-1)


@pytest.mark.parametrize(
    ("friction", "springs", "tolerance"),
    [
        ("elasto_plastic", True, 1e-6),
        *(
            pytest.param(*case, marks=pytest.mark.evidence)
            for case in product(("elasto_plastic", "lugre"), (False, True), (1e-8,))
        ),
    ],
)
def test_a_platform_moves_as_a_lagrangian_with_printed_laws_under_radau(
    friction: str, springs: bool, tolerance: float
) -> None:
    """Legs slide, four of them reverse. Expected: equations and integration that share nothing with the model's."""
    platform = real_platform(friction, springs)
    model = gs.SteppingModel(platform, tolerance=1e-11)
    model.set("velocity", [0.03, -0.02, 0.05])
    force = platform.home_actuator_force + np.array([-90, 15, -70, -110, 12, -60])
    model.set("actuator_force", force)
    start = model.state
    expected = motion_by_radau(platform, start, force, 8e-3, tolerance)
    model.do_step(0.0, 8e-3)
    # Radau's accuracy: of velocities the tolerance, poses and bristles are better
    bounds = np.full(len(start), 2 * tolerance)
    bounds[:6], bounds[12:18] = 0.01 * tolerance, 1e-4 * tolerance
    # the rates of roll, pitch and yaw are not the angular velocity
    gap = np.delete(np.abs(model.state - expected) / bounds, slice(9, 12))
    assert gap.max() < 1
    assert np.ptp(np.sign(model.state[12:18])) == 2


@pytest.mark.parametrize("springs", [False, True])
def test_the_largest_fixed_step_is_that_of_legs_that_stand(springs: bool) -> None:
    """Expected: the same for legs that slide, whose bristles forget within 10 µs, and for legs at rest."""
    platform = real_platform("lugre", springs, **({"leg_armature": 0.5} if springs else {}))
    variant = Variant.of(platform)
    kernel, p, rest = Kernel(variant), parameter_vector(platform, variant), gs.SteppingModel(platform).state
    moving = rest.copy()
    moving[6:12], moving[12:18] = 0.2, 5e-6
    if springs:
        moving[24:] = 0.3
    assert largest_step(kernel, variant, moving, p) == pytest.approx(largest_step(kernel, variant, rest, p), rel=1e-12)


def test_stiff_legs_are_the_rigid_plant_to_first_order() -> None:
    """Expected: the rigid plant without friction; legs stretch by F/k, so poses differ by ∝ 1/k under smooth forces."""
    frictionless = {"leg_viscous_friction": 0.0, "leg_coulomb_friction": 0.0, "leg_static_friction": 0.0}
    stiffness, ends = [0.0, 1e7, 1e8, 1e9], []
    for k in stiffness:
        platform = real_platform("smooth", True, **frictionless, leg_stiffness=k, leg_damping=0.0)
        model = gs.SteppingModel(platform, tolerance=1e-11)
        model.set_many({"velocity": [0.06, -0.04, 0.1], "angular_velocity": [0.05, 0.1, -0.08]})
        for n in range(20):
            model.set("actuator_force", platform.home_actuator_force + 40 * np.sin(0.2 * n + np.arange(6)))
            model.do_step(1e-3 * n, 1e-3)
        ends.append(model.state[:6])
    errors = np.abs(np.array(ends[1:]) - ends[0]).max(axis=1)
    order = -np.polyfit(np.log(stiffness[1:]), np.log(errors), 1)[0]
    assert errors[-1] > 1e-9  # not of the tolerance
    assert order == pytest.approx(1.0, abs=0.1)


def test_motors_start_where_they_hold_the_pose_and_follow_what_is_set() -> None:
    """Expected: leg length plus force over stiffness, and the rates of the legs."""
    platform = real_platform("elasto_plastic", True)
    model = gs.SteppingModel(platform)
    stretch = platform.home_actuator_force / platform.leg_stiffness
    assert model.get("motor_position") == pytest.approx(np.asarray(model.get("leg_length")) + stretch, rel=1e-14)
    assert model.get("leg_force") == pytest.approx(platform.home_actuator_force, rel=1e-7)
    state = State(
        platform.home_position + np.array([0.02, 0.01, -0.03]),
        platform.home_orientation,
        np.array([0.1, 0, 0.2]),
        np.zeros(3),
    )
    model.set_many(state._asdict())
    legs, rates = leg_geometry(platform, *state[:2]).length, leg_rates(platform, state).length_rate
    assert np.abs(np.asarray(model.get("motor_position")) - legs).max() < 1e-3
    assert model.get("motor_velocity") == pytest.approx(rates, rel=1e-14)
    # set in the same call, they stay
    model.set_many({"position": platform.home_position, "motor_position": legs})
    assert model.get("motor_position") == pytest.approx(legs, rel=1e-15)


def test_a_restored_model_repeats_its_bits() -> None:
    platform = real_platform("lugre", True)
    model = gs.SteppingModel(platform)
    model.set("actuator_force", platform.home_actuator_force + 90 * np.arange(6))
    model.do_step(0.0, 0.004)
    saved = model.save_state()
    model.do_step(0.004, 0.003)
    first = model.result_vector()
    model.restore_state(saved)
    model.do_step(0.004, 0.003)
    assert np.array_equal(model.result_vector(), first)
    assert len(first) == len(model.variant.columns) == 50 + 24


def test_what_a_platform_does_not_have_is_said() -> None:
    model = gs.SteppingModel(UNEVEN)
    with pytest.raises(
        InterfaceError, match="leg_bristle: is nothing that this platform has: leg_friction_model is 's"
    ):
        model.get("leg_bristle")
    with pytest.raises(InterfaceError, match="leg_damping: is nothing that this platform has: leg_stiffness is 0"):
        model.set("leg_damping", 3.0)
    with pytest.raises(InterfaceError, match="leg_stiffness: would give the model other states; make a SteppingModel"):
        model.set("leg_stiffness", 1e7)
    assert model.get("leg_friction_model") == 0


def test_a_run_records_bristles_and_motors() -> None:
    """The first columns are those of the ideal plant; the same experiment on it differs by the stiction."""
    changed = {
        "loop.duration": 0.02,
        "plant.parameters.leg_friction_model": "elasto_plastic",
        "plant.parameters.leg_coulomb_friction": 100,
        "plant.parameters.leg_stiffness": 1e8,
    }
    record = gs.run("heave_step", changed)
    assert record.metadata["outcome"]["status"] == "completed"
    assert record["leg_bristle"].shape == record["motor_position"].shape == record["leg_force"].shape
    assert np.abs(record["leg_bristle"]).max() > 1e-8
    assert np.abs(record["motor_position"] - record["leg_length"]).max() < 1e-3
    assert record.metadata["machine"]["leg_friction_model"] == "elasto_plastic"
