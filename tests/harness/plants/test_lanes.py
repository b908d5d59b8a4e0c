"""Many platforms at once: each as the stepping model has it, whatever the others are and do."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from gough_stewart.fmu_build.lanes import Failure, lanes_library
from gough_stewart.harness.errors import PlantError
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.lane_batch import Batch
from gough_stewart.harness.plants.lanes import LanesPlant, lanes_plant
from gough_stewart.harness.plants.model import ModelPlant
from gough_stewart.model import interface
from gough_stewart.model.errors import InterfaceError, MembersError, PlatformError, StepError
from gough_stewart.model.formulations import newton_euler
from gough_stewart.model.kinematics import leg_geometry, scaled_jacobian_of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation, orientation_rate_from_angular_velocity
from gough_stewart.model.state import Inputs, State
from gough_stewart.model.vectors import FloatArray
from tests.support.random_platforms import random_inputs, random_platform
from tests.support.uneven import INPUTS, STATE, UNEVEN

STEP = 2e-3
# Members of which no two are alike; one vector and a part of another.
N = 11


@pytest.fixture(params=[{"substeps": 2}, {"tolerance": 1e-9}], ids=["fixed", "controlled"])
def steps(request: pytest.FixtureRequest) -> dict[str, Any]:
    """Fixed internal steps, or error-controlled ones."""
    return dict(request.param)


def _members(n: int, seed: int = 7) -> tuple[list[Platform], list[State], FloatArray]:
    """The uneven platform and random ones, moving gently, each under forces of its own."""
    rng = np.random.default_rng(seed)
    platforms = [UNEVEN, *(random_platform(rng) for _ in range(min(n, 12) - 1))]
    # a random platform takes long: the further ones are the first with other payloads
    platforms += [
        replace(platforms[k % 12], platform_mass=platforms[k % 12].platform_mass * 1.01) for k in range(12, n)
    ]
    starts, inputs = [], []
    for platform in platforms:
        size = platform.characteristic_length
        starts.append(
            State(
                platform.home_position + size * rng.uniform(-0.1, 0.1, 3),
                platform.home_orientation + rng.uniform(-0.1, 0.1, 3),
                size * rng.uniform(-0.3, 0.3, 3),
                rng.uniform(-0.3, 0.3, 3),
            )
        )
        inputs.append(_held(platform) + 0.1 * random_inputs(platform, rng).to_vector())
    return platforms, starts, np.array(inputs)


@cache
def _held(platform: Platform) -> FloatArray:
    return np.concatenate([platform.home_actuator_force, np.zeros(6)])


def _run(plant: LanesPlant, inputs: FloatArray, steps: int = 20, first: int = 0) -> FloatArray:
    """Forces that change in every step; all results at the end."""
    for k in range(first, first + steps):
        plant.set_inputs((1 + 0.1 * np.sin(k)) * inputs)
        plant.do_step(k * STEP, STEP)
    return plant.results()


def _reference() -> FloatArray:
    """Results of the members by the error-controlled integration of another order, each alone."""
    found = []
    for platform, start, own in zip(*_members(N), strict=True):
        model = ModelPlant(platform, start, 1e-12, integrator="scipy")
        for k in range(10):
            model.set_inputs((1 + 0.1 * np.sin(k)) * own)
            model.do_step(k * STEP, STEP)
        found.append(model.results())
    return np.array(found)


def test_a_run_is_that_of_the_stepping_model() -> None:
    """Expected: the reference, states and signals within 1e-8."""
    platforms, starts, inputs = _members(N)
    found = _run(lanes_plant(platforms, starts, substeps=16), inputs, 10)
    for member, expected in enumerate(_reference()):
        n = signals.SIZE
        assert np.abs(found[member, :n] - expected[:n]).max() < 1e-8
        # accelerations, forces and energies follow from the state, each in the size of its kind
        for name, value in interface.unpack(interface.RESULTS, expected).items():
            own_value = interface.unpack(interface.RESULTS, found[member])[name]
            assert np.abs(own_value - value).max() < 1e-7 * (1 + np.abs(value).max()), name


def test_signals_are_the_head_of_the_results() -> None:
    """Expected: two functions, the one without the dynamics."""
    platforms, starts, inputs = _members(N)
    plant = lanes_plant(platforms, starts, substeps=2)
    results = _run(plant, inputs, 3)
    assert plant.signals().shape == (N, signals.SIZE)
    np.testing.assert_allclose(plant.signals(), results[:, : signals.SIZE], rtol=1e-13, atol=1e-14)
    assert plant.shape == (N,)
    assert plant.features == lanes_library().features


def test_it_begins_in_its_starts_held_as_at_home() -> None:
    """Expected: the starts, and of members at home the accelerations of a platform that is held: none."""
    platforms, starts, _ = _members(N)
    rest = np.zeros(3)
    starts[3] = State(platforms[3].home_position, platforms[3].home_orientation, rest, rest)
    results = lanes_plant(platforms, starts, substeps=1).results()
    np.testing.assert_array_equal(results[:, :12], [start.to_vector() for start in starts])
    acceleration = slice(signals.SIZE, signals.SIZE + 6)
    assert np.abs(results[3, acceleration]).max() < 1e-9 < np.abs(results[4, acceleration]).max()


def test_a_member_has_the_same_bits_in_any_company(steps: dict[str, Any]) -> None:
    """Expected: those of the member alone; in ten, in a thousand and in another order."""
    n = 1000
    platforms, starts, inputs = _members(n)

    def run(members: Sequence[int]) -> tuple[FloatArray, ...]:
        chosen = [platforms[k] for k in members], [starts[k] for k in members]
        plant = lanes_plant(*chosen, **steps)
        return (
            plant.results(),
            _run(plant, inputs[list(members)], 4),
            plant.integration_error,
            plant.internal_steps,
        )

    everyone = run(range(n))
    for members in ([0], [n - 1], list(range(3, 13)), list(reversed(range(n)))):
        for found, expected in zip(run(members), everyone, strict=True):
            np.testing.assert_array_equal(found, expected[members])


def test_frozen_members_stay_to_the_last_bit_while_others_go_on(steps: dict[str, Any]) -> None:
    """Expected: states as they were, and the run of the others as if nobody had been frozen."""
    platforms, starts, inputs = _members(N)
    plant, free = (lanes_plant(platforms, starts, **steps) for _ in range(2))
    before = _run(plant, inputs, 3)[:, : signals.SIZE]
    frozen = np.arange(N) % 3 == 1
    plant.freeze(frozen)
    error, taken = plant.integration_error.copy(), plant.internal_steps.copy()
    after = _run(plant, inputs, 3, first=3)[:, : signals.SIZE]
    np.testing.assert_array_equal(after[frozen], before[frozen])
    np.testing.assert_array_equal(plant.integration_error[frozen], error[frozen])
    np.testing.assert_array_equal(plant.internal_steps[frozen], taken[frozen])
    np.testing.assert_array_equal(after[~frozen], _run(free, inputs, 6)[~frozen, : signals.SIZE])


def _bad(kind: str) -> tuple[State, FloatArray]:
    """The uneven platform on its way to a pose that no motion may pass, and its inputs."""
    rest, u = np.zeros(3), np.concatenate([UNEVEN.home_actuator_force, np.zeros(6)])
    if kind == "pitch":
        return State(UNEVEN.home_position, np.array([0.0, 1.568, 0.0]), rest, np.array([0.0, 4.0, 0.0])), u
    if kind == "singular":  # turned by a quarter and more, a way on which the legs lose hold
        return State(UNEVEN.home_position, UNEVEN.home_orientation, rest, np.array([0.0, 0.0, 900.0])), u
    if kind == "collapsed":
        # joint 1 on its base point
        position = UNEVEN.base_points[0] - UNEVEN.platform_points[0] + np.array([1e-4, 0.0, 1e-4])
        return State(position, rest, rest, rest), u
    start = State(UNEVEN.home_position, UNEVEN.home_orientation, rest, rest)
    u[{"nan": 4, "infinite": 7}[kind]] = {"nan": np.nan, "infinite": -np.inf}[kind]
    return start, u


@pytest.fixture
def quiet() -> Iterator[None]:
    """Numbers that are not finite are what is tested."""
    with np.errstate(all="ignore"):
        yield


QUANTITIES = {
    "pitch": "orientation[2]",
    "singular": "condition number of the leg Jacobian",
    "collapsed": "leg_length[1]",
    "nan": "actuator_force[5]",
    "infinite": "external_force[2]",
}


@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize("kind", QUANTITIES)
def test_a_member_that_cannot_go_on_stays_as_it_was_and_others_go_on(kind: str, steps: dict[str, Any]) -> None:
    """Expected: an error with quantity and time of this member alone, once; the run of the others without it."""
    platforms, starts, inputs = _members(N)
    free = lanes_plant(platforms, starts, **steps)
    expected = _run(free, inputs, 2)
    platforms[5] = UNEVEN
    starts[5], inputs[5] = _bad(kind)
    plant = lanes_plant(platforms, starts, **steps)
    plant.set_inputs(inputs)
    with pytest.raises(MembersError) as caught:
        plant.do_step(0.0, STEP)
    (error,) = caught.value.failures.values()
    assert list(caught.value.failures) == [5]
    assert error.quantity == QUANTITIES[kind]
    assert 0 <= error.time <= STEP
    np.testing.assert_array_equal(plant.signals()[5, :12], starts[5].to_vector())
    # it is frozen now; forces of the first step were those of the others
    others = np.arange(N) != 5
    again = lanes_plant(platforms, starts, **steps)
    again.freeze(~others)
    found = _run(again, inputs, 2)
    np.testing.assert_array_equal(found[others], expected[others])
    plant.do_step(STEP, STEP)
    np.testing.assert_array_equal(plant.signals()[5, :12], starts[5].to_vector())


@pytest.mark.usefixtures("quiet")
def test_a_motion_that_overflows_says_so() -> None:
    """Expected: a motion that is not finite, under forces that are finite."""
    start, u = _bad("nan")
    u[4] = 1e300
    plant = lanes_plant([UNEVEN], [start], substeps=2)
    plant.set_inputs(u[None])
    with pytest.raises(MembersError, match="the motion is not finite; it needs more than 2 substeps"):
        plant.do_step(0.0, STEP)


def test_poses_near_a_singular_one_are_refused_from_the_limit_on() -> None:
    """Expected: condition numbers from NumPy's inverse, of poses on both sides of where det J changes its sign."""

    def jacobian(yaw: float) -> FloatArray:
        legs = leg_geometry(UNEVEN, UNEVEN.home_position, np.array([0.0, 0.0, yaw]))
        return np.asarray(scaled_jacobian_of_legs(legs)[0])

    singular = brentq(lambda yaw: np.linalg.det(jacobian(yaw)), 1.0, 2.5, xtol=1e-15)
    yaws = singular + np.concatenate([sign * np.geomspace(1e-11, 1e-2, 40) for sign in (-1, 1)])
    numbers = np.array([np.linalg.norm(J) * np.linalg.norm(np.linalg.inv(J)) for J in map(jacobian, yaws)])
    clear = np.abs(np.log10(numbers / 1e8)) > 0.01  # rounding decides at the limit itself
    rest = np.zeros(3)
    starts = [State(UNEVEN.home_position, np.array([0.0, 0.0, yaw]), rest, rest) for yaw in yaws]
    plant = lanes_plant([UNEVEN] * len(yaws), starts, substeps=1)
    with pytest.raises(MembersError) as caught:
        plant.do_step(0.0, 1e-9)
    refused = np.isin(np.arange(len(yaws)), [k for k, error in caught.value.failures.items() if error.time == 0])
    np.testing.assert_array_equal(refused[clear], (numbers >= 1e8)[clear])
    assert 5 < refused.sum() < 60


@pytest.mark.usefixtures("quiet")
def test_a_singular_pose_that_is_passed_within_a_substep_is_noticed() -> None:
    """Expected: a turn by two radians, across the singular pose of the test above, leaves legs on the other side."""
    start, u = _bad("singular")
    plant = lanes_plant([UNEVEN], [start], substeps=1)
    plant.set_inputs(u[None])
    with pytest.raises(MembersError, match=r"passed since the last internal step"):
        plant.do_step(0.0, STEP)


def test_a_start_with_a_leg_too_short_for_its_parts_fails_in_the_first_step() -> None:
    """Expected: the stepping model's words, of this member alone."""
    rest = np.zeros(3)
    low = State(np.array([0.0, 0.0, 0.5]), np.array([0.0, 0.0, 0.3]), rest, rest)
    home = State(UNEVEN.home_position, UNEVEN.home_orientation, rest, rest)
    longer = replace(UNEVEN, leg_lower_com=2.2)
    with pytest.raises(PlatformError, match="leg_lower_com") as expected:
        ModelPlant(longer, low).do_step(0.0, STEP)
    plant = lanes_plant([UNEVEN, longer], [home, low], substeps=4)
    with pytest.raises(MembersError) as caught:
        plant.do_step(0.0, STEP)
    assert list(caught.value.failures) == [1]
    assert str(expected.value).partition(": ")[2] in str(caught.value)


def test_parameters_change_in_mid_run_for_those_that_are_meant() -> None:
    """Expected: the runs of stepping models that get the same changes."""
    platforms, starts, inputs = _members(N)
    plant = lanes_plant(platforms, starts, substeps=16)
    heavier = np.array([1.5 * platform.platform_mass for platform in platforms])
    some = np.arange(N) % 2 == 0
    heavier_of_some = np.where(some, 2.0 * heavier, np.nan)
    models = [
        ModelPlant(platform, start, 1e-12, integrator="scipy")
        for platform, start in zip(platforms, starts, strict=True)
    ]

    def changes(step: int, k: int) -> dict[str, object]:
        if step == 2:
            return {"platform_mass": heavier[k], "gravity": [0.3, -0.2, -5.0]}
        if step == 4 and some[k]:
            return {"platform_mass": heavier_of_some[k]}
        return {"platform_com": [0.0, 0.01 * k, 0.02]} if step == 5 else {}

    for step in range(8):
        if step == 2:
            plant.set_parameters({"platform_mass": heavier, "gravity": [0.3, -0.2, -5.0]})
        if step == 4:
            plant.set_parameters_of(some, {"platform_mass": heavier_of_some})
        if step == 5:
            plant.set_parameters({"platform_com": np.array([[0.0, 0.01 * k, 0.02] for k in range(N)])})
        plant.set_inputs(inputs)
        plant.do_step(step * STEP, STEP)
        for k, model in enumerate(models):
            model.set_parameters(changes(step, k))
            model.set_inputs(inputs[k])
            model.do_step(step * STEP, STEP)
    expected = np.array([model.results() for model in models])
    assert np.abs(plant.signals() - expected[:, : signals.SIZE]).max() < 1e-8


@pytest.mark.parametrize(
    ("values", "error", "message"),
    [
        ({"platform_mass": [1.0, -2.0, 3.0]}, PlatformError, r"platform_mass: is -2 kg; .*number 1 of the platforms"),
        ({"platform_inertia": np.diag([1.0, 1.0, 3.0])}, PlatformError, "triangle inequality.*number 0"),
        ({"platform_com": [100.0, 0.0, 0.0]}, PlatformError, "more than ten times"),
        ({"gravity": [[0.0, 0.0, np.nan]] * 3}, InterfaceError, "gravity: .*finite"),
        ({"platform_mass": [1.0, 2.0]}, InterfaceError, r"platform_mass: has shape \(2,\)"),
        ({"platform_mass": 2.0, "base_points": np.zeros((6, 3))}, InterfaceError, "cannot be set during a run"),
        ({"nonsense": 2.0}, InterfaceError, "nonsense: cannot be set"),
        ({"platform_mass": "heavy"}, InterfaceError, "heavy"),
    ],
)
def test_impossible_parameters_are_refused_and_change_nothing(
    values: dict[str, object], error: type[Exception], message: str
) -> None:
    """Expected: what is wrong, and the run of a plant that was not asked."""
    platforms, starts, inputs = _members(3)
    plant, untouched = (lanes_plant(platforms, starts, substeps=2) for _ in range(2))
    with pytest.raises(error, match=message):
        plant.set_parameters({"leg_viscous_friction": 3.0, **values})
    np.testing.assert_array_equal(_run(plant, inputs, 2), _run(untouched, inputs, 2))


def _distance(plant: LanesPlant, exact: FloatArray) -> float:
    found = plant.signals()[0, :12]
    return float((np.abs(found - exact) / (1 + np.abs(found))).max())


def test_the_error_is_estimated_and_falls_with_the_fourth_order() -> None:
    """Expected: the distance from the stepping model at a tight tolerance; a sixteenth with twice the substeps."""
    smooth = replace(UNEVEN, leg_coulomb_friction=0.0)
    exact = _after(smooth, STATE, INPUTS.to_vector(), 0.1, 1e-13)
    true, estimated = [], []
    for substeps in (4, 8, 16):
        plant = lanes_plant([smooth], [STATE], substeps=substeps)
        plant.set_inputs(INPUTS.to_vector()[None])
        plant.do_step(0.0, 0.1)
        true.append(_distance(plant, exact))
        estimated.append(float(plant.integration_error[0]))
    # what the substeps add, which may be in another direction than what they sum to
    ratio = np.array(estimated) / true
    assert (ratio > 0.9).all(), ratio
    assert (ratio < 4).all(), ratio
    np.testing.assert_allclose(np.array(true[:-1]) / true[1:], 16, rtol=0.25)


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8, 1e-10, 1e-12])
def test_controlled_steps_hold_their_tolerance_over_a_long_step(tolerance: float) -> None:
    """Expected: the stepping model at a tight tolerance, within the sum of errors; more steps for finer tolerances."""
    u = INPUTS.to_vector()
    exact = _after(UNEVEN, STATE, u, 0.1, 1e-13)
    plant = lanes_plant([UNEVEN], [STATE], tolerance=tolerance)
    plant.set_inputs(u[None])
    plant.do_step(0.0, 0.1)
    taken, bound = float(plant.internal_steps[0]), float(plant.integration_error[0])
    assert bound <= taken * tolerance
    assert bound > 0.01 * taken * tolerance  # not far more steps than it takes
    assert _distance(plant, exact) < 2 * bound
    # local errors of order 5: a hundredth of the tolerance takes 100^(1/5) = 2.5 times as many
    finer = lanes_plant([UNEVEN], [STATE], tolerance=max(tolerance / 100, 1e-13))
    finer.set_inputs(u[None])
    finer.do_step(0.0, 0.1)
    assert 1.3 < finer.internal_steps[0] / taken < 4


def test_controlled_steps_have_order_four() -> None:
    """Expected: one internal step of half the size is off by a 32nd, as the stepping model says from the same start."""
    smooth = replace(UNEVEN, leg_coulomb_friction=0.0)
    true = []
    for size in (0.02, 0.01, 0.005):
        plant = lanes_plant([smooth], [STATE], tolerance=1e-3)
        plant.set_inputs(INPUTS.to_vector()[None])
        plant.do_step(0.0, size)
        assert plant.internal_steps[0] == 1
        true.append(_distance(plant, _after(smooth, STATE, INPUTS.to_vector(), size, 1e-13)))
    np.testing.assert_allclose(np.array(true[:-1]) / true[1:], 32, rtol=0.2)


def test_a_stiff_member_takes_small_steps_and_its_neighbours_do_not() -> None:
    """Expected: the stepping model; as many steps for the others as without it; sizes carry over to the next step."""
    u = np.concatenate([UNEVEN.home_actuator_force, np.zeros(6)]) + INPUTS.to_vector()
    sticky = replace(UNEVEN, leg_coulomb_friction=60.0, leg_friction_velocity=1e-3)
    start = State(UNEVEN.home_position, UNEVEN.home_orientation, np.zeros(3), np.zeros(3))
    plant = lanes_plant([UNEVEN, sticky, UNEVEN], [start] * 3, tolerance=1e-8)
    plant.set_inputs(np.stack([u] * 3))
    taken = [np.zeros(3)]
    for k in range(3):
        plant.do_step(k * STEP, STEP)
        taken.append(plant.internal_steps.copy())
    own = np.diff(taken, axis=0)
    assert (own[:, [0, 2]] <= 4).all()
    assert (own[:, 1] > 2 * own[:, 0]).all()
    assert own[0, 1] < 40  # its first size is found within some trials
    assert own[2, 1] < own[0, 1] / 2
    for member, platform in ((0, UNEVEN), (1, sticky)):
        exact = _after(platform, start, u, 3 * STEP, 1e-12)
        assert np.abs(plant.signals()[member, :12] - exact).max() < 3e-8


@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize("torque", [1e6, 1e9, 1e12])
def test_a_first_size_that_gives_no_numbers_is_too_large(torque: float) -> None:
    """Expected: the singular pose that the stepping model reaches, not a motion without numbers.

    The first internal step tries all of 0.1 s, in which angles are far beyond those whose sine is known.
    """
    start = State(UNEVEN.home_position, UNEVEN.home_orientation, np.zeros(3), np.zeros(3))
    u = np.concatenate([UNEVEN.home_actuator_force, np.zeros(3), torque * np.array([0.3, 1.0, 0.2])])
    with pytest.raises(StepError) as expected:
        _after(UNEVEN, start, u, 0.1, 1e-9)
    plant = lanes_plant([UNEVEN], [start], tolerance=1e-9)
    plant.set_inputs(u[None])
    with pytest.raises(MembersError) as caught:
        plant.do_step(0.0, 0.1)
    error = caught.value.failures[0]
    assert error.quantity == expected.value.quantity == "condition number of the leg Jacobian"
    assert error.time == pytest.approx(expected.value.time, rel=0.03)


def test_a_member_that_needs_too_many_steps_says_so_and_others_go_on() -> None:
    """Expected: after 10,000 internal steps of one plant step: the cause in words; the others as without it."""
    u = np.concatenate([UNEVEN.home_actuator_force, np.zeros(6)]) + INPUTS.to_vector()
    hopeless = replace(UNEVEN, leg_coulomb_friction=5e3, leg_friction_velocity=1e-7)
    plant = lanes_plant([UNEVEN, hopeless], [STATE] * 2, tolerance=1e-12)
    free = lanes_plant([UNEVEN], [STATE], tolerance=1e-12)
    for each, forces in ((plant, np.stack([u, u])), (free, u[None])):
        each.set_inputs(forces)
    with pytest.raises(MembersError) as caught:
        plant.do_step(0.0, STEP)
    free.do_step(0.0, STEP)
    ((k, error),) = caught.value.failures.items()
    assert (k, error.quantity, error.value) == (1, "internal steps", 10_000)
    assert 0 <= error.time < STEP
    assert "too many for one plant step at tolerance 1e-12; forces too large, leg_friction_velocity" in str(error)
    np.testing.assert_array_equal(plant.signals()[1, :12], STATE.to_vector())
    np.testing.assert_array_equal(plant.signals()[0], free.signals()[0])


def _after(platform: Platform, start: State, u: FloatArray, duration: float, tolerance: float) -> FloatArray:
    """States of the stepping model, an integration of another order."""
    model = ModelPlant(platform, start, tolerance, integrator="scipy")
    model.set_inputs(u)
    model.do_step(0.0, duration)
    return model.results()[:12]


def test_the_largest_estimate_along_the_run_is_kept() -> None:
    """Expected: of a member that is let go late, the estimate of then; held again it has no more to add."""
    rest = State(UNEVEN.home_position, UNEVEN.home_orientation, np.zeros(3), np.zeros(3))
    plant = lanes_plant([UNEVEN], [rest], substeps=1)
    seen = []
    for k in range(4):
        if k == 1:
            plant.set_inputs(INPUTS.to_vector()[None])
        plant.do_step(k * 0.02, 0.02)
        seen.append(float(plant.integration_error[0]))
    assert seen[0] < 1e-12 < 1e-3 * seen[1]
    assert seen[1] <= seen[2] <= seen[3]


def test_no_step_of_a_run_is_overlooked() -> None:
    """Expected: the largest distance of any step from the stepping model, which starts each step in the same state.

    Forces jump, and legs with Coulomb friction reverse, between the multiples of any interval.
    """
    n, steps, size = 3, 40, 8e-3
    platforms, starts, inputs = _members(n)
    platforms = [replace(each, leg_coulomb_friction=3.0, leg_friction_velocity=2e-3) for each in platforms]
    plant = lanes_plant(platforms, starts, substeps=1)
    largest = np.zeros(n)
    for k in range(steps):
        forces = inputs.copy()
        forces[:, :6] *= 1 + 0.3 * np.sin(1.7 * k + np.arange(6)) * (k % 7 == 5)
        before = plant.signals()[:, :12].copy()
        plant.set_inputs(forces)
        plant.do_step(k * size, size)
        for member in range(n):
            model = ModelPlant(platforms[member], State.from_vector(before[member]), 1e-11, integrator="scipy")
            model.set_inputs(forces[member])
            model.do_step(0.0, size)
            exact, found = model.results()[:12], plant.signals()[member, :12]
            largest[member] = max(largest[member], float((np.abs(found - exact) / (1 + np.abs(found))).max()))
    assert (largest > 1e-6).all()
    ratio = plant.integration_error / largest
    assert (ratio > 0.5).all(), ratio
    assert (ratio < 2).all(), ratio


@pytest.mark.parametrize(("time", "step"), [(0.0, 0.0), (0.0, -1.0), (0.5, 1e-3), (0.0, np.nan)])
def test_wrong_times_are_refused_and_change_nothing(time: float, step: float) -> None:
    plant = lanes_plant([UNEVEN], [STATE], substeps=1)
    before = plant.results()
    with pytest.raises(StepError, match=r"step|time"):
        plant.do_step(time, step)
    np.testing.assert_array_equal(plant.results(), before)


def test_wrong_use_is_refused() -> None:
    with pytest.raises(PlantError, match="1 platforms and 2 starts"):
        lanes_plant([UNEVEN], [STATE, STATE], substeps=1)
    with pytest.raises(PlantError, match="substeps is 0"):
        lanes_plant([UNEVEN], [STATE], substeps=0)
    with pytest.raises(InterfaceError, match=r"inputs: have shape \(12,\)"):
        lanes_plant([UNEVEN], [STATE], substeps=1).set_inputs(np.zeros(12))


def _failing(at: dict[int, str]) -> tuple[list[Platform], list[State], FloatArray]:
    """The usual members with some of them on their way to a pose or a number that ends a motion."""
    platforms, starts, inputs = _members(N)
    for k, kind in at.items():
        platforms[k] = UNEVEN
        starts[k], inputs[k] = _bad(kind)
    return platforms, starts, inputs


@pytest.mark.usefixtures("quiet")
def test_each_of_many_failures_is_told_with_its_own_data() -> None:
    """Expected: of five members by hand: quantity, value, time and words; at a later step than the first.

    A pitch of 1.568 rad passes 90° less 1e-3 rad after 0.2 ms at 4 rad/s, in the first substep of 0.5 ms.
    """
    at = {1: "nan", 3: "pitch", 4: "infinite", 8: "collapsed", 10: "singular"}
    platforms, starts, inputs = _failing(at)
    plant = lanes_plant(platforms, starts, substeps=4)
    held = np.array([np.concatenate([each.home_actuator_force, np.zeros(6)]) for each in platforms])
    plant.set_inputs(held)
    with pytest.raises(MembersError) as caught:
        plant.do_step(0.0, STEP)
    first = caught.value.failures
    assert sorted(first) == [3, 8, 10]
    assert first[3].quantity == "orientation[2]"
    assert first[3].time == pytest.approx(STEP / 4, abs=1e-12)
    assert first[3].value == pytest.approx(1.568 + 4.0 * STEP / 4, abs=1e-3)
    assert str(first[3]).endswith("the pitch has reached ±90°")
    assert (first[8].quantity, first[8].time) == ("leg_length[1]", 0.0)
    assert first[8].value == pytest.approx(1e-4 * np.sqrt(2), rel=1e-9)
    assert str(first[8]).endswith("the leg has collapsed")
    assert first[10].quantity == "condition number of the leg Jacobian"
    assert 0 < first[10].time <= STEP
    assert first[10].time / (STEP / 4) == pytest.approx(round(first[10].time / (STEP / 4)), abs=1e-9)
    plant.set_inputs(inputs)
    with pytest.raises(MembersError) as caught:
        plant.do_step(STEP, STEP)
    second = caught.value.failures
    assert {k: (error.quantity, error.time) for k, error in second.items()} == {
        1: ("actuator_force[5]", STEP),
        4: ("external_force[2]", STEP),
    }
    assert np.isnan(second[1].value)
    assert second[4].value == -np.inf
    assert str(second[4]).endswith("expected finite numbers")
    plant.do_step(2 * STEP, STEP)
    frozen = [1, 3, 4, 8, 10]
    np.testing.assert_array_equal(plant.signals()[[3, 8, 10], :12], [starts[k].to_vector() for k in (3, 8, 10)])
    assert (plant._batch.running[:N] == 0).nonzero()[0].tolist() == frozen
    assert (plant._batch.running[N:] == 0).all()


@pytest.mark.parametrize("leg", range(6))
def test_the_leg_that_has_collapsed_is_named(leg: int) -> None:
    """Expected: its number and length, of the second of two members."""
    rest = np.zeros(3)
    joint = UNEVEN.base_points[leg] - UNEVEN.platform_points[leg]
    starts = [State(UNEVEN.home_position, UNEVEN.home_orientation, rest, rest)]
    starts.append(State(joint + np.array([3e-4, 0.0, 4e-4]), rest, rest, rest))
    plant = lanes_plant([UNEVEN, UNEVEN], starts, substeps=1)
    with pytest.raises(MembersError) as caught:
        plant.do_step(0.0, 1e-6)
    ((k, error),) = caught.value.failures.items()
    assert (k, error.quantity) == (1, f"leg_length[{leg + 1}]")
    assert error.value == pytest.approx(5e-4, rel=1e-9)


def test_pitches_of_either_sign_end_a_motion_at_the_limit() -> None:
    """Expected: 1e-3 rad below 90°, from both sides and of both signs, of four members at once."""
    rest, far = np.zeros(3), np.pi / 2 - 1e-3
    pitches = [far - 1e-6, -far + 1e-6, far + 1e-6, -far - 1e-6]
    starts = [State(UNEVEN.home_position, np.array([0.0, pitch, 0.0]), rest, rest) for pitch in pitches]
    plant = lanes_plant([UNEVEN] * 4, starts, substeps=1)
    with pytest.raises(MembersError) as caught:
        plant.do_step(0.0, 1e-9)
    assert {k: error.value for k, error in caught.value.failures.items()} == {2: pitches[2], 3: pitches[3]}
    assert {error.time for error in caught.value.failures.values()} == {0.0}


@pytest.mark.usefixtures("quiet")
def test_states_are_checked_of_those_that_run_only() -> None:
    """Expected: of states made bad, what was done to them; the sides of det J by NumPy; others untouched."""
    rng = np.random.default_rng(2)
    platforms, starts, _ = _members(16)
    x = np.array([start.to_vector() for start in starts])
    x[1, 3:6], x[2, 3:6], x[4, 4], x[5, 0], x[6, 8] = [0, 0, 2.6], [0, 0, -2.6], 1.57, np.nan, np.inf
    for k in (9, 10):
        x[k, :3] = platforms[k].base_points[k - 5] - platforms[k].platform_points[k - 5]
        x[k, 3:6] = 0
    for member in (12, 13):
        x[member, 4] = -1.5705
    running = np.where(np.isin(np.arange(16), [6, 10, 13]), 0, -1)
    sides = rng.choice([-1.0, 0.0, 1.0], 16)
    plant = lanes_plant(platforms, starts, substeps=1)
    batch = plant._batch
    batch.states[:] = batch.padded(x)
    batch.running[:] = running
    batch.side[:] = sides
    assert plant._kernel.check(batch) == np.count_nonzero(batch.failure)
    expected = {4: Failure.PITCHED, 5: Failure.NOT_FINITE, 9: Failure.COLLAPSED + 4, 12: Failure.PITCHED}
    assert {k: batch.failure[k] for k in expected} == expected
    untouched = running == 0
    assert not batch.failure[untouched].any()
    np.testing.assert_array_equal(batch.side[untouched], sides[untouched])
    for k in np.flatnonzero(running & ~np.isin(np.arange(16), list(expected))).tolist():
        legs = leg_geometry(platforms[k], x[k, :3], x[k, 3:6])
        side = np.sign(np.linalg.det(scaled_jacobian_of_legs(legs)[0]))
        passed = sides[k] not in (0, side)
        assert batch.failure[k] == (Failure.PASSED_SINGULAR if passed else Failure.GOES_ON), k
        assert batch.side[k] == (sides[k] if passed else side), k


def test_a_batch_holds_each_parameter_of_each_member_in_its_place() -> None:
    """Expected: eleven members in two vectors of eight, the last one repeated; parameters by name as they were."""
    platforms, _, _ = _members(N)
    batch = Batch.of(N)
    assert batch.blocks == 2
    assert batch.states.shape == batch.reached.shape == (12, 16)
    assert batch.inputs.shape == (12, 16)
    assert batch.parameters.ctypes.data % 64 == 0
    assert Batch.of(8).blocks == 1
    assert Batch.of(9).states.strides[0] // 64 % 2 == 1
    for name in (v.name for v in interface.PLATFORM_PARAMETERS):
        batch.put_parameter(name, np.stack([np.asarray(getattr(each, name)) for each in platforms]))
    everyone, some, two = batch.parameters_of(), batch.parameters_of(slice(3, 5)), batch.parameters_of([10, 0])
    for v in interface.PLATFORM_PARAMETERS:
        for k, each in enumerate([*platforms, *[platforms[-1]] * 5]):
            assert np.array_equal(getattr(everyone, v.name)[k], getattr(each, v.name)), (v.name, k)
        assert np.array_equal(getattr(some, v.name), [getattr(platforms[k], v.name) for k in (3, 4)])
        assert np.array_equal(getattr(two, v.name), [getattr(platforms[k], v.name) for k in (10, 0)])
    values = np.arange(22.0).reshape(11, 2)
    padded = batch.padded(values)
    assert padded[:, :11].T.tolist() == values.tolist()
    assert padded[:, 11:].T.tolist() == [[20.0, 21.0]] * 5
    zeros = ("states", "inputs", "running", "side", "failure", "error", "proposed", "internal_steps")
    assert not any(getattr(batch, name).any() for name in zeros)


@pytest.mark.parametrize(
    ("n", "starts", "substeps", "text"),
    [
        (0, 0, 1, "0 platforms and 0 starts; expected at least one platform, and a start for each"),
        (2, 1, 1, "2 platforms and 1 starts; expected at least one platform, and a start for each"),
        (1, 1, 0, "substeps is 0; expected a whole number from 1 to 1024"),
        (1, 1, 1025, "substeps is 1025; expected a whole number from 1 to 1024"),
        (1, 1, 2.0, "substeps is 2.0; expected a whole number from 1 to 1024"),
    ],
)
def test_plants_that_cannot_be_made_are_refused_in_whole_sentences(
    n: int, starts: int, substeps: int, text: str
) -> None:
    with pytest.raises(PlantError) as caught:
        lanes_plant([UNEVEN] * n, [STATE] * starts, substeps=substeps)
    assert str(caught.value) == text


def test_substeps_from_one_to_the_most_are_taken_and_used() -> None:
    """Expected: the end of one step of classical RK4 by hand, over the whole step; 1024 differ from it."""
    inputs = Inputs(*INPUTS)

    def rate(x: FloatArray) -> FloatArray:
        state = State.from_vector(x)
        R = matrix_from_orientation(state.orientation)
        a = newton_euler.solve(UNEVEN, state.position, R, state.velocity, state.angular_velocity, *inputs)
        turning = orientation_rate_from_angular_velocity(state.orientation, state.angular_velocity)
        return np.concatenate([state.velocity, turning, a.linear, a.angular])

    h, x = 0.02, STATE.to_vector()
    k1 = rate(x)
    k2 = rate(x + h / 2 * k1)
    k3 = rate(x + h / 2 * k2)
    k4 = rate(x + h * k3)
    by_hand = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    ends = []
    for substeps in (1, 1024):
        plant = lanes_plant([UNEVEN, UNEVEN], [STATE, STATE], substeps=substeps)
        assert plant.substeps == substeps
        plant.set_inputs(np.stack([np.zeros(12), INPUTS.to_vector()]))
        plant.do_step(0.0, h)
        ends.append(plant.signals()[1, :12].copy())
    assert ends[0] == pytest.approx(by_hand, abs=1e-11)
    assert np.abs(ends[1] - by_hand).max() > 1e-9


def test_short_legs_are_told_of_members_that_start_only() -> None:
    """Expected: of three with a leg too short, with different parts, the two that are not frozen."""
    rest = np.zeros(3)
    low = State(np.array([0.0, 0.0, 0.6]), np.array([0.0, 0.0, 0.3]), rest, rest)
    home = State(UNEVEN.home_position, UNEVEN.home_orientation, rest, rest)
    parts: tuple[dict[str, Any], ...] = ({"leg_lower_com": 2.2}, {}, {"leg_upper_com": 2.1}, {"leg_lower_com": 2.0})
    platforms = [replace(UNEVEN, **part) for part in parts]
    plant = lanes_plant(platforms, [low, home, low, low], substeps=1)
    plant.freeze(np.array([False, False, False, True]))
    with pytest.raises(MembersError) as caught:
        plant.do_step(0.0, 1e-6)
    R = matrix_from_orientation(low.orientation)
    shortest = np.linalg.norm(low.position + UNEVEN.platform_points @ R.T - UNEVEN.base_points, axis=1).min()
    found = {k: (error.quantity, error.value, error.time) for k, error in caught.value.failures.items()}
    assert found == {0: ("leg_lower_com", 2.2, 0.0), 2: ("leg_upper_com", 2.1, 0.0)}
    assert str(caught.value.failures[2]) == (
        "leg_upper_com = 2.1 at time 0 s: is 2.1 m from the platform joint; expected between 0 and the shortest leg of "
        f"the start pose, {shortest:g} m"
    )
    # once the first step is done there is no such check
    plant.do_step(1e-6, 1e-6)


@pytest.mark.parametrize("part", ["leg_lower_com", "leg_upper_com"])
def test_a_centre_of_mass_is_within_the_shortest_leg_of_the_start(part: str) -> None:
    """Expected: refused 1 % beyond the shortest leg, which leaves home by 20 %, and taken 1 % before."""
    rest = np.zeros(3)
    start = State(0.8 * UNEVEN.home_position, UNEVEN.home_orientation, rest, rest)
    shortest = float(leg_geometry(UNEVEN, start.position, start.orientation).length.min())
    sizes: list[dict[str, Any]] = [{part: factor * shortest} for factor in (0.99, 1.01)]
    platforms = [replace(UNEVEN, **size) for size in sizes]
    plant = lanes_plant(platforms, [start, start], substeps=1)
    with pytest.raises(MembersError) as caught:
        plant.do_step(0.0, 1e-6)
    assert {k: error.quantity for k, error in caught.value.failures.items()} == {1: part}


def test_a_plant_of_many_gives_arrays_of_its_members_alone() -> None:
    """Expected: N rows, before and after a step; inputs of another number of members are refused by shape."""
    platforms, starts, inputs = _members(N)
    plant = lanes_plant(platforms, starts, substeps=1)
    for k in range(2):
        assert plant.signals().shape == (N, 24)
        assert plant.results().shape == (N, 50)
        assert plant.integration_error.shape == (N,)
        plant.set_inputs(inputs)
        plant.do_step(k * STEP, STEP)
    with pytest.raises(InterfaceError, match=r"^inputs: have shape \(10, 12\); expected \(11, 12\)$"):
        plant.set_inputs(inputs[:10])
    own = [np.concatenate([each.home_actuator_force, np.zeros(6)]) for each in platforms]
    fresh = lanes_plant(platforms, starts, substeps=1)
    assert pytest.approx(np.array(own), rel=1e-9, abs=1e-9) == fresh._batch.inputs[:, :N].T


def test_a_kernel_steps_with_or_without_signals(steps: dict[str, Any]) -> None:
    """Expected: the same states, to the last bit; signals where they are asked for."""
    platforms, starts, inputs = _members(N)
    batches = []
    for with_signals in (True, False):
        plant = lanes_plant(platforms, starts, **steps)
        plant.set_inputs(inputs)
        out, kernel, batch = plant._signals if with_signals else None, plant._kernel, plant._batch
        failed = kernel.step(batch, 1e-3, 2, out) if "substeps" in steps else kernel.advance(batch, 2e-3, 1e-9, out)
        assert failed == 0
        batches.append(batch)
        if out is not None:
            legs = leg_geometry(batch.parameters_of(), *(batch.states[k : k + 3].T for k in (0, 3)))
            np.testing.assert_array_equal(out[:12], batch.states)
            np.testing.assert_allclose(out[12:18].T, legs.length, rtol=1e-12)
    np.testing.assert_array_equal(batches[1].states, batches[0].states)
    np.testing.assert_array_equal(batches[1].error, batches[0].error)
    assert (batches[0].error[:N] > 0).all()
