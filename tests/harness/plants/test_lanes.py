"""Many platforms at once, each as alone: by a Lagrangian under DOP853; where they stick or give, a stepping model."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import gough_stewart as gs
from gough_stewart import GoughStewartError
from gough_stewart.harness.plants.lanes import BatchPlant
from tests.support.lagrangian import FloatArray
from tests.support.plain_motion import trajectory
from tests.support.random_platforms import random_inputs, random_platform
from tests.support.real_platforms import real_platform
from tests.support.uneven import INPUT_VALUES, STATE, UNEVEN

STEP = 2e-3
# Members of which no two are alike; one vector and a part of another.
N = 11
STATES, LENGTHS = slice(0, 12), slice(12, 18)
U = np.concatenate(list(INPUT_VALUES.values()))
REST = np.zeros(3)
HELD = np.concatenate([UNEVEN.home_actuator_force, np.zeros(6)])


@pytest.fixture(params=[{"substeps": 2}, {"tolerance": 1e-9}], ids=["fixed", "controlled"])
def steps(request: pytest.FixtureRequest) -> dict[str, Any]:
    """Fixed internal steps, or error-controlled ones."""
    return dict(request.param)


@pytest.fixture
def quiet() -> Iterator[None]:
    """Numbers that are not finite are what is tested."""
    with np.errstate(all="ignore"):
        yield


def at_rest(platform: gs.Platform, position: Any = None, orientation: Any = None) -> gs.State:
    here = platform.home_position if position is None else np.asarray(position)
    return gs.State(here, platform.home_orientation if orientation is None else np.asarray(orientation), REST, REST)


@cache
def held(platform: gs.Platform) -> FloatArray:
    return np.asarray(np.concatenate([platform.home_actuator_force, np.zeros(6)]))


def members(n: int, seed: int = 7) -> tuple[list[gs.Platform], list[gs.State], FloatArray]:
    """The uneven platform and random ones, moving gently, each under forces of its own."""
    rng = np.random.default_rng(seed)
    platforms = [UNEVEN, *(random_platform(rng) for _ in range(n - 1))]
    starts, inputs = [], []
    for platform in platforms:
        size = platform.characteristic_length
        moved, turned = size * rng.uniform(-0.1, 0.1, 3), rng.uniform(-0.1, 0.1, 3)
        rates = size * rng.uniform(-0.3, 0.3, 3), rng.uniform(-0.3, 0.3, 3)
        starts.append(gs.State(platform.home_position + moved, platform.home_orientation + turned, *rates))
        inputs.append(held(platform) + 0.1 * random_inputs(platform, rng))
    return platforms, starts, np.array(inputs)


def run(plant: BatchPlant, inputs: FloatArray, steps: int = 20, first: int = 0) -> FloatArray:
    """Forces that change in every step; all results at the end."""
    for k in range(first, first + steps):
        plant.set_inputs((1 + 0.1 * np.sin(k)) * inputs)
        plant.do_step(k * STEP, STEP)
    return plant.results().copy()


def exact_end(platform: gs.Platform, start: gs.State, u: FloatArray, size: float) -> FloatArray:
    return np.asarray(trajectory(platform, np.concatenate(list(start)), lambda _t: u, np.array([0.0, size]), 1e-13)[-1])


def failures_of(plant: BatchPlant, time: float, step: float) -> dict[int, gs.StepError]:
    with pytest.raises(GoughStewartError) as caught:
        plant.do_step(time, step)
    return dict(vars(caught.value)["failures"])


def distance(found: FloatArray, exact: FloatArray) -> float:
    return float((np.abs(found - exact) / (1 + np.abs(exact))).max())


def test_members_move_as_the_lagrangian_says_with_changes_for_those_that_are_meant() -> None:
    """Expected: within 1e-8, of platforms that change their payload and gravity on the way, together or not."""
    platforms, starts, inputs = members(N)
    plant = BatchPlant(platforms, starts, substeps=16)
    some, masses = np.arange(N) % 2 == 0, np.array([1.5 * p.platform_mass for p in platforms])
    coms = np.array([[0.0, 0.01 * k, 0.02] for k in range(N)])
    expected = [np.concatenate(list(start)) for start in starts]
    for k in range(4):
        if k == 1:
            plant.set_parameters({"platform_mass": masses, "gravity": [0.3, -0.2, -5.0]})
        if k == 2:
            plant.set_parameters_of(some, {"platform_mass": np.where(some, 2 * masses, np.nan)})
        if k == 3:
            plant.set_parameters({"platform_com": coms})
        plant.set_inputs((1 + 0.1 * k) * inputs)
        plant.do_step(k * STEP, STEP)
        for m, x in enumerate(expected):
            changes: list[dict[str, Any]] = [
                {},
                {"platform_mass": masses[m], "gravity": np.array([0.3, -0.2, -5.0])},
                {"platform_mass": 2 * masses[m]} if some[m] else {},
                {"platform_com": coms[m]},
            ]
            platforms[m] = replace(platforms[m], **changes[k])
            u = (1 + 0.1 * k) * inputs[m]
            times = np.array([k * STEP, (k + 1) * STEP])
            expected[m] = trajectory(platforms[m], x, lambda _t, u=u: u, times)[-1]  # type: ignore[misc]
    results = plant.results()
    assert np.abs(results[:, STATES] - np.array(expected)).max() < 1e-8
    np.testing.assert_allclose(plant.signals(), results[:, :24], rtol=1e-13, atol=1e-14)
    for m, platform in enumerate(platforms):  # the rest follows from the state
        model = gs.SteppingModel(platform)
        model.set_many(dict(zip(STATE._fields, expected[m].reshape(4, 3), strict=True)))
        model.set_inputs(1.3 * inputs[m])
        for name, value in zip(plant.columns, results[m], strict=True):
            assert value == pytest.approx(model.get(name), rel=1e-6, abs=1e-6), name


def test_the_largest_error_of_any_step_of_a_run_is_kept() -> None:
    """Expected: the largest distance of a step from the exact one, which starts in the same state."""
    n, size = 2, 8e-3
    platforms, starts, inputs = members(n)
    platforms = [replace(each, leg_coulomb_friction=3.0, leg_friction_velocity=2e-2) for each in platforms]
    plant, largest, before = BatchPlant(platforms, starts, substeps=1), np.zeros(n), np.zeros(n)
    for k in range(12):
        forces = inputs.copy()
        forces[:, :6] *= 1 + 0.3 * np.sin(1.7 * k + np.arange(6)) * (k % 7 == 5)
        begun = plant.signals()[:, STATES].copy()
        plant.set_inputs(forces)
        plant.do_step(k * size, size)
        for m in range(n):
            start = gs.State(*begun[m].reshape(4, 3))
            off = distance(plant.signals()[m, STATES], exact_end(platforms[m], start, forces[m], size))
            largest[m] = max(largest[m], off)
        assert (plant.integration_error >= before).all()
        before = plant.integration_error.copy()
    ratio = before / largest
    assert (largest > 1e-9).all()
    assert (ratio > 0.5).all(), ratio
    assert (ratio < 2).all(), ratio


def test_a_member_that_needs_too_many_steps_says_so_and_others_go_on() -> None:
    """Expected: after 10,000 internal steps of one plant step: the cause in words; the others as without it."""
    hopeless = replace(UNEVEN, leg_coulomb_friction=5e3, leg_friction_velocity=1e-7)
    plant, free = (BatchPlant(each, [STATE] * len(each), tolerance=1e-12) for each in ([UNEVEN, hopeless], [UNEVEN]))
    plant.set_inputs(np.stack([HELD + U] * 2))
    free.set_inputs((HELD + U)[None])
    ((k, error),) = failures_of(plant, 0.0, STEP).items()
    free.do_step(0.0, STEP)
    assert (k, error.quantity, error.value) == (1, "internal steps", 10_000)
    assert 0 <= error.time < STEP
    assert "too many for one plant step at tolerance 1e-12; forces too large, leg_friction_velocity" in str(error)
    np.testing.assert_array_equal(plant.signals()[1, STATES], np.concatenate(list(STATE)))
    np.testing.assert_array_equal(plant.signals()[0], free.signals()[0])


QUANTITIES = {
    "pitch": "orientation[2]",
    "singular": "condition number of the leg Jacobian",
    "nan": "actuator_force[5]",
    "infinite": "external_force[2]",
}


def bad(kind: str) -> tuple[gs.State, FloatArray]:
    """The uneven platform on its way to a pose that no motion may pass, and its inputs."""
    u = HELD.copy()
    if kind == "pitch":  # passes 90° less 1e-3 rad after 0.2 ms
        return at_rest(UNEVEN, orientation=[0.0, 1.568, 0.0])._replace(angular_velocity=np.array([0, 4.0, 0])), u
    if kind == "singular":  # turned by a quarter and more, a way on which the legs lose hold
        return at_rest(UNEVEN)._replace(angular_velocity=np.array([0.0, 0.0, 900.0])), u
    u[{"nan": 4, "infinite": 7}[kind]] = {"nan": np.nan, "infinite": -np.inf}[kind]
    return at_rest(UNEVEN), u


@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize("kind", QUANTITIES)
def test_a_member_that_cannot_go_on_stays_as_it_was_and_others_go_on(kind: str, steps: dict[str, Any]) -> None:
    """Expected: an error with quantity and time of this member alone, once; the run of the others without it."""
    platforms, starts, inputs = members(N)
    platforms[5] = UNEVEN
    starts[5], inputs[5] = bad(kind)
    begin = np.concatenate(list(starts[5]))
    others = np.arange(N) != 5
    plant, again = (BatchPlant(platforms, starts, **steps) for _ in range(2))
    again.freeze(~others)
    plant.set_inputs(inputs)
    ((k, error),) = failures_of(plant, 0.0, STEP).items()
    assert (k, error.quantity) == (5, QUANTITIES[kind])
    if kind == "pitch":
        assert error.value == pytest.approx(1.568 + 4.0 * error.time, abs=1e-3)
        assert 0 < error.time <= STEP
    else:
        expected = {"nan": np.nan, "infinite": -np.inf}.get(kind, error.value)
        assert error.value == pytest.approx(expected, rel=1e-9, nan_ok=True)
        assert (error.time > 0) == (kind == "singular")
    np.testing.assert_array_equal(plant.signals()[5, STATES], begin)
    again.set_inputs(inputs)
    for time in (0.0, STEP):
        again.do_step(time, STEP)
    plant.do_step(STEP, STEP)
    np.testing.assert_array_equal(plant.results()[others], again.results()[others])
    np.testing.assert_array_equal(plant.signals()[5, STATES], begin)


def test_poses_are_refused_from_the_limits_on() -> None:
    """Expected: NumPy's condition numbers up to 1e8, beside det J = 0; a pitch near 90°; a leg by its length."""
    scale = np.repeat([1.0, np.sqrt((UNEVEN.platform_points**2).sum() / 6)], 3)

    def jacobian(yaw: float) -> FloatArray:
        return np.asarray(gs.leg_jacobian(UNEVEN, UNEVEN.home_position, np.array([0.0, 0.0, yaw])) / scale)

    singular = brentq(lambda yaw: np.linalg.det(jacobian(yaw)), 1.0, 2.5, xtol=1e-15)
    yaws = singular + np.concatenate([sign * np.geomspace(1e-11, 1e-2, 40) for sign in (-1, 1)])
    numbers = np.array([np.linalg.norm(J) * np.linalg.norm(np.linalg.inv(J)) for J in map(jacobian, yaws)])
    clear = np.abs(np.log10(numbers / 1e8)) > 0.01  # rounding decides at the limit itself
    starts = [at_rest(UNEVEN, orientation=[0.0, 0.0, yaw]) for yaw in yaws]
    failures = failures_of(BatchPlant([UNEVEN] * len(yaws), starts, substeps=1), 0.0, 1e-9)
    refused = np.isin(np.arange(len(yaws)), [k for k, error in failures.items() if error.time == 0])
    np.testing.assert_array_equal(refused[clear], (numbers >= 1e8)[clear])
    assert 5 < refused.sum() < 60
    far = np.pi / 2 - 1e-3
    pitches = [far - 1e-6, -far + 1e-6, far + 1e-6, -far - 1e-6]
    starts = [at_rest(UNEVEN, orientation=[0.0, pitch, 0.0]) for pitch in pitches]
    failures = failures_of(BatchPlant([UNEVEN] * 4, starts, substeps=1), 0.0, 1e-9)
    assert {k: (error.value, error.time) for k, error in failures.items()} == {k: (pitches[k], 0.0) for k in (2, 3)}
    joints = UNEVEN.base_points - UNEVEN.platform_points + np.array([3e-4, 0.0, 4e-4])
    starts = [at_rest(UNEVEN), *(at_rest(UNEVEN, joint, REST) for joint in joints)]
    failures = failures_of(BatchPlant([UNEVEN] * 7, starts, substeps=1), 0.0, 1e-6)
    assert {k: error.quantity for k, error in failures.items()} == {k: f"leg_length[{k}]" for k in range(1, 7)}
    assert [error.value for error in failures.values()] == pytest.approx([5e-4] * 6, rel=1e-9)


def test_members_that_restart_repeat_their_run_bit_by_bit(steps: dict[str, Any]) -> None:
    """Expected: the bits of the first run, of those that restart; of the others, those of a run without restarts."""
    platforms, starts, inputs = members(N)
    plant, other = (BatchPlant(platforms, starts, **steps) for _ in range(2))
    again, found, start = np.arange(N) % 3 > 0, [], plant.signals().copy()
    for each in (plant, other):
        each.set_inputs(inputs)
        for k in range(6):
            if k == 3 and each is plant:
                expected = np.where(again[:, None], start, plant.signals())
                plant.restart(again)
                np.testing.assert_array_equal(plant.signals(), expected)
            each.do_step(k * STEP, STEP)
            found.append(each.results())
    np.testing.assert_array_equal(found[5], np.where(again[:, None], found[2], found[11]))
    with pytest.raises(GoughStewartError, match=r"^platform_mass: is -1 kg; .* \(number 7 of the platforms\)$"):
        plant.set_parameters({"platform_mass": np.where(np.arange(N) == 7, -1.0, 5.0)})
    for values in (np.ones((N + 1, 3)), np.ones((N, 2)), 1.0):
        with pytest.raises(GoughStewartError, match=r"^platform_com: has shape"):
            plant.set_parameters({"platform_com": values})


STEPS = 14


def breaking_loose(platform: gs.Platform) -> FloatArray:
    """Inputs (STEPS, 12) under which each leg sticks, breaks away and reverses at times of its own."""
    k, legs = np.arange(STEPS)[:, None], np.arange(6)
    swing = (90.0 + 7 * legs) * np.sin(2 * np.pi * k / (7 + legs)) * (k > 1)
    return np.concatenate([platform.home_actuator_force + swing, np.broadcast_to([3, -2, 4, 1, -1, 2], (STEPS, 6))], -1)


def machine(friction: str, springs: bool, k: int) -> tuple[gs.Platform, gs.State]:
    """Of two members: one at home at rest, the other in motion with another payload."""
    platform = real_platform(friction, springs, **({"platform_mass": 17.0, "leg_coulomb_friction": 20.0} if k else {}))
    return platform, (STATE if k else at_rest(platform))


def stepped(plant: Any, inputs: FloatArray) -> FloatArray:
    """Results (STEPS, ...) after each step of a millisecond; with another payload half way."""
    found = []
    for k, (time, after) in enumerate(pairwise(1e-3 * np.arange(STEPS + 1))):
        if k == STEPS // 2:
            plant.set("platform_mass", 13.0) if hasattr(plant, "set") else plant.set_parameters({"platform_mass": 13.0})
        plant.set_inputs(inputs[k])
        plant.do_step(time, after - time)
        found.append((plant.result_vector() if hasattr(plant, "result_vector") else plant.results()).copy())
    return np.array(found)


@pytest.mark.parametrize(
    ("friction", "springs"), [("elasto_plastic", False), ("smooth", True), ("elasto_plastic", True), ("lugre", True)]
)
def test_machines_move_as_the_stepping_model_does(friction: str, springs: bool) -> None:
    """Expected: poses within the tolerance, with a payload that comes in between; all results by name."""
    expected, inputs = [], []
    platforms, starts = zip(*(machine(friction, springs, k) for k in range(2)), strict=True)
    for platform, start in zip(platforms, starts, strict=True):
        model = gs.SteppingModel(platform, 1e-11, integrator="scipy")
        model.set_many(start._asdict())
        inputs.append(breaking_loose(platform))
        expected.append(stepped(model, inputs[-1]))
    plant = BatchPlant(platforms, starts, tolerance=1e-8)
    gap = np.abs(stepped(plant, np.stack(inputs, axis=1)) - np.stack(expected, axis=1))
    largest = dict(zip(plant.columns, (gap / (1 + np.abs(expected).max(axis=(0, 1)))).max(axis=(0, 1)), strict=True))
    kinds: dict[str, list[float]] = {}
    for name, value in largest.items():
        kinds.setdefault(name.partition("[")[0], []).append(value)
    for name, values in kinds.items():  # accelerations of stiff parts differ by their stiffness
        precise = ("position", "orientation", "leg_bristle", "motor_position")
        bound = 1e-8 if name in precise else 1e-6 if name in list(kinds)[:6] else 1e-3
        assert max(values) < bound, name
    assert 0 < plant.integration_error.max() < 1e-6
    # legs have moved by more than the bristles bend, or the springs stretch
    assert np.abs(np.array(expected)[..., LENGTHS] - np.array(expected)[:, :1, LENGTHS]).max() > 1e-3


STICKING, GIVING = real_platform("elasto_plastic"), real_platform("elasto_plastic", True)
WRONG: list[tuple[list[gs.Platform], int, dict[str, Any], str]] = [
    ([], 0, {}, "^0 platforms and 0 starts; expected at least one platform, and a start for each$"),
    ([UNEVEN] * 2, 1, {}, "^2 platforms and 1 starts; expected at least one platform"),
    *(([UNEVEN], 1, {"substeps": k}, f"^substeps is {k}; expected a whole number from 1 to") for k in (0, 1025, 2.0)),
    ([UNEVEN], 1, {"tolerance": 0}, "^tolerance is 0; expected 1e-13 to"),
    ([UNEVEN, UNEVEN, STICKING], 3, {}, "leg_friction_model: gives platform 2 other states: it has stiction"),
    ([STICKING, STICKING, GIVING], 3, {}, "leg_stiffness: gives platform 2 other states: it has stiction"),
    ([STICKING], 1, {"substeps": 8}, "with stiction and rigid legs has no steps of a fixed"),
]


@pytest.mark.parametrize(("platforms", "starts", "options", "message"), WRONG)
def test_platforms_that_do_not_fit_together_are_refused(
    platforms: list[gs.Platform], starts: int, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(gs.GoughStewartError, match=message):
        BatchPlant(platforms, [STATE] * starts, **options)


def test_short_legs_are_told_of_members_that_start_only() -> None:
    """Expected: of three with a leg too short for their parts, the two that are not frozen; 1 % longer is enough."""
    low = at_rest(UNEVEN, [0.0, 0.0, 0.6], [0.0, 0.0, 0.3])
    shortest = float(gs.leg_geometry(UNEVEN, low.position, low.orientation).length.min())
    lower, upper = (f"leg_{part}_com" for part in ("lower", "upper"))
    parts: list[dict[str, Any]] = [{lower: 1.01 * shortest}, {}, {upper: 2.1}, {lower: 2.0}]
    parts += [{name: 0.99 * shortest} for name in (lower, upper)]
    platforms = [replace(UNEVEN, **part) for part in parts]
    plant = BatchPlant(platforms, [low, at_rest(UNEVEN), low, low, low, low], substeps=1)
    plant.freeze(np.arange(6) == 3)
    failures = failures_of(plant, 0.0, 1e-6)
    found = {k: (error.quantity, error.value, error.time) for k, error in failures.items()}
    assert found == {0: (lower, 1.01 * shortest, 0.0), 2: (upper, 2.1, 0.0)}
    told = f"expected between 0 and the shortest leg of the start pose, {shortest:g} m"
    assert str(failures[2]) == f"leg_upper_com = 2.1 at time 0 s: is 2.1 m from the platform joint; {told}"
    plant.do_step(1e-6, 1e-6)  # once the first step is done there is no such check


def test_motors_follow_a_payload_at_the_start_and_stay_later() -> None:
    """Closed form: where the springs carry it, F/k by the platform's statics."""
    platform, heavy = real_platform("elasto_plastic", True), real_platform("elasto_plastic", True, platform_mass=30.0)
    plant = BatchPlant([platform] * 2, [at_rest(platform)] * 2)
    plant.set_parameters_of(np.array([True, False]), {"platform_mass": 30.0})
    first = plant.columns.index("motor_position[1]")
    motors = slice(first, first + 6)
    for found, each in zip(plant.results(), (heavy, platform), strict=True):
        stretch = np.asarray(each.home_actuator_force) / each.leg_stiffness
        np.testing.assert_allclose(found[motors], found[LENGTHS] + stretch, rtol=1e-12)
    plant.do_step(0.0, 1e-3)
    before = plant.results()[:, motors].copy()
    plant.set_parameters({"platform_mass": 40.0, "leg_static_friction": 33.0})
    np.testing.assert_array_equal(plant.results()[:, motors], before)
    with pytest.raises(gs.GoughStewartError, match="leg_stiffness: cannot be set during a run"):
        plant.set_parameters({"leg_stiffness": 1e6})
