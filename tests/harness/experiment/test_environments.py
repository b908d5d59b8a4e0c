"""Environments for learning: episodes are the experiment's runs, restart one by one, and follow Gymnasium's rules."""

import warnings
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import gough_stewart as gs
from tests.support.arrays import FloatArray

# Nothing of a loop is ideal: limits that act, a delay, slow drives, coarse and noisy sensors, two plant steps a sample.
UNEVEN: dict[str, Any] = {
    "loop.duration": 0.12,
    "loop.sample_time": 0.002,
    "loop.plant_step": 0.001,
    "loop.delay": 2,
    "reference.at": 0.02,
    "actuators.force_limit": 4500,
    "actuators.rate_limit": 200000,
    "actuators.lag": 0.003,
    "sensors.noise.leg_length": 3e-6,
    "sensors.noise.leg_velocity": 1e-4,
}
VARIED = {"ensemble.platform_mass": {"factor": {"normal": [1, 0.1]}}, "ensemble.seed": 5, "ensemble.tolerance": 1e-10}
PID = {"controller.type": "pid", "controller.integral_time": 0.3, "controller.anti_windup_time": 0.05}


def forces_at(j: int) -> FloatArray:
    """Uneven forces beside the feedforward, which leave the force limit [N]."""
    return np.asarray(np.array([300, -200, 900, 100, -400, 50.0]) * np.sin(0.2 * j + np.arange(6)))


HOME = gs.load_preset("motion_base")
HOME_POSE = np.r_[HOME.home_position, HOME.home_orientation]


def episode(env: Any, actions: FloatArray, seed: int | None = None) -> list[FloatArray]:
    """Observations and rewards of a vector environment under actions (m, 6) of all members."""
    observations = [env.reset(seed=seed)[0]]
    rewards = []
    for action in actions:
        observation, reward, *_ = env.step(np.tile(action, (env.num_envs, 1)))
        observations.append(observation)
        rewards.append(reward)
    return [np.array(observations), np.array(rewards)]


DIFFER: dict[str, Any] = {
    **{"loop.sample_time": 0.012, "loop.plant_step": 0.006, "plant.fixed_step_size": 0.006, "loop.duration": 0.36},
    "ensemble.platform": {"platform_mass": {"factor": {"uniform": [0.8, 1.2]}}},
    "ensemble.loop": {"delay": {"choice": [0, 1, 3]}},
    "injection": {"type": "chirp", "leg": 2, "amplitude": 300, "band": [10, 30], "period": 0.12},
    "reference": {"type": "sine", "orientation_amplitude": [0.01, 0, 0.005], "frequency": 1},
}


@pytest.mark.parametrize(("hold", "steps", "more"), [(1, 60, {}), (3, 10, DIFFER)], ids=["each sample", "held"])
def test_forces_act_as_those_of_a_controller_in_a_run(hold: int, steps: int, more: dict[str, Any]) -> None:
    """Expected: what `gs.run` has of each member of the ensemble with the environment's seed."""
    experiment = gs.load_experiment("heave_step", {**UNEVEN, **VARIED, **more})
    names = {"leg_length": slice(0, 6), "leg_velocity": slice(6, 12), "reference.orientation": slice(12, 15)}
    env = gs.vector_env(experiment, 3, observations=[*names], reward="tracking.orientation.norm_rms", hold=hold)
    observed, rewards = episode(env, np.array([forces_at(j) for j in range(steps)]), seed=5)
    for k in range(3):
        record = gs.run(experiment, member=k, controller=lambda sample: forces_at(sample.index // hold))
        for name, at in names.items():
            rows = record[name if "." in name else f"measured.{name}"][: -1 : 2 * hold]
            np.testing.assert_allclose(observed[:steps, k, at], rows, rtol=0, atol=1e-9)
        squares = np.square(record["error.orientation"][2 * hold :: 2 * hold]).sum(axis=1)
        np.testing.assert_allclose(-rewards[:, k], squares, rtol=1e-6)
    assert np.abs(observed[:, 2] - observed[:, 1]).max() > 1e-3  # another machine


@pytest.mark.parametrize(
    "settings",
    [{}, {"controller.space": "task"}, PID, {"controller.feedforward": "none", "controller.derivative_on": "error"}],
    ids=["leg", "task", "pid", "no feedforward"],
)
def test_the_own_controller_follows_poses_as_its_reference(settings: dict[str, Any]) -> None:
    """Expected: the run of `gs.run` from beside its reference; the mean reward is −(its metric)², but for row 0."""
    quiet = {key: value for key, value in UNEVEN.items() if "noise" not in key}
    quiet |= {"loop.duration": 0.4, "loop.plant_step": 0.002}
    del quiet["reference.at"]
    wanted = (HOME.home_position + np.array([0, 0, 0.05])).tolist()
    quiet["reference"] = {"type": "hold", "position": wanted}
    start = {"start.position": HOME.home_position.tolist(), "start.velocity": [0, 0.1, 0]}
    experiment = gs.load_experiment("heave_step", {**quiet, **start, **settings})
    record, pose = gs.run(experiment), HOME_POSE + np.array([0, 0, 0.05, 0, 0, 0])
    observed, rewards = episode(gs.vector_env(experiment, 2, actions="pose"), np.tile(pose, (200, 1)))
    np.testing.assert_allclose(observed[:-1, 1, :6], record["measured.leg_length"][:-1], rtol=0, atol=1e-9)
    squares = gs.metrics(record)["tracking"]["position"]["norm_rms"] ** 2 * 201 - 0.05**2
    np.testing.assert_allclose(-rewards[:, 0].sum(), squares, rtol=1e-9)


@pytest.mark.parametrize("actions", ["force", "pose"])
def test_a_member_restarts_alone_and_forgets_everything(actions: Any) -> None:
    """Expected: after its end a step with reward 0 to the start, then its first episode again; others as alone."""
    settings = {key: value for key, value in UNEVEN.items() if "noise" not in key} | PID
    settings |= {"limits.position_error": 0.06, "loop.duration": 0.4}
    settings["controller.space"] = "task" if actions == "pose" else "leg"
    if actions == "force":  # several internal steps, which begin with the size that the last one proposed
        settings |= {"loop.sample_time": 0.012, "loop.plant_step": 0.012, "loop.duration": 0.48}
    experiment = gs.load_experiment("heave_step", settings)
    env = gs.vector_env(experiment, 3, actions=actions, observations=["position", "velocity", "leg_velocity"])
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    home = np.tile(HOME_POSE, (3, 1)) if actions == "pose" else np.zeros((3, 6))
    action = home.copy()
    action[1] += np.array([0.3, 0, 0.2, 0, 0, 0.1]) if actions == "pose" else np.array([900.0] * 3 + [-900] * 3)
    kept, dones = [env.reset(seed=3)[0]], []
    for _ in range(400):
        observation, rewards, terminated, truncated, info = env.step(action)
        kept.append(observation)
        dones.append(terminated | truncated)
        if len(dones) > 1:
            assert ((rewards == 0) == dones[-2]).all() or (rewards[~dones[-2]] <= 0).all()
            assert (rewards[dones[-2]] == 0).all()
        assert terminated[1] == (terminated.any() and "too far" in info["cause"][1])
    rows, ends = np.array(kept), np.flatnonzero(np.array(dones)[:, 1])
    first = ends[0] + 1  # rows of its first episode are 0 to `first`
    assert len(ends) > 2
    assert 3 < first < 180
    second = rows[first + 1 : 2 * first + 2, 1]
    np.testing.assert_array_equal(second, rows[: first + 1, 1])
    alone = gs.vector_env(experiment, 1, actions=actions, observations=["position", "velocity", "leg_velocity"])
    alone.reset(seed=3)
    others = np.array([alone.step(home[:1])[0][0] for _ in range(400)])
    np.testing.assert_array_equal(rows[1:, 2], others)


def test_a_member_that_ends_while_its_action_is_held_stays_there() -> None:
    """Expected: its last observation of steps of one sample; a pose beyond numbers ends it for its forces."""
    settings = {key: value for key, value in UNEVEN.items() if "noise" not in key}
    last = []
    for hold in (1, 7):
        env, is_over = gs.vector_env("heave_step", 1, settings, observations=["position"], hold=hold), False
        env.reset(seed=3)
        while not is_over:
            observation, _, _, (is_over,), _ = env.step(np.array([[900.0] * 3 + [-900] * 3]))
        last.append(observation)
    assert np.array_equal(last[0], last[1])
    env = gs.vector_env("heave_step", 1, settings | {"controller.feedforward": "none"}, actions="pose")
    env.reset(seed=3)
    assert env.step(np.full((1, 6), 1e29))[4]["cause"][0] == "the controller's forces are too large"


def test_a_single_environment_is_the_first_member_and_passes_the_checker() -> None:
    """Expected: Gymnasium's checker; and the bits of the vector environment with the same seed, noise included."""
    env = gs.env("heave_step", UNEVEN)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it would have spaces scaled and bounded
        check_env(env)
    vector = gs.vector_env("heave_step", 4, UNEVEN)
    first, (many, _) = env.reset(seed=9)[0], vector.reset(seed=9)
    np.testing.assert_array_equal(first, many[0])
    assert not np.array_equal(many[0], many[1])
    for j in range(20):
        one, batch = env.step(forces_at(j)), vector.step(np.tile(forces_at(j), (4, 1)))
        np.testing.assert_array_equal(one[0], batch[0][0])
        assert one[1] == batch[1][0]
    assert not np.array_equal(env.reset()[0], env.reset(seed=9)[0])  # the noise had gone on
    np.testing.assert_array_equal(env.reset(seed=9)[0], first)


@pytest.mark.parametrize(
    ("settings", "forces", "hold", "cause"),
    [
        ({"limits.stroke": "stop", "controller.feedforward": "none"}, np.zeros(6), 5, "beyond its stroke"),
        ({"limits.position_error": 0.01, "controller.feedforward": "none"}, np.zeros(6), 1, "too far"),
        ({}, np.array([5, -5, -5, -5, -5, 5.0]) * 1e3, 1, ""),
    ],
    ids=["stroke", "error", "pose"],
)
def test_an_episode_terminates_where_the_run_ends(settings: Any, forces: FloatArray, hold: int, cause: str) -> None:
    """Expected: the time of the outcome of `gs.run`; the last error counts for all that remains."""
    experiment = gs.load_experiment("heave_step", {"loop.duration": 2, **settings})
    outcome = gs.run(experiment, controller=lambda _: forces).metadata["outcome"]
    env, steps, terminated, truncated, reward = gs.env(experiment, hold=hold), 0, False, False, 0.0
    env.reset(seed=0)
    while not (terminated or truncated):
        before = reward
        _, reward, terminated, truncated, info = env.step(forces)
        steps += 1
    assert (terminated, truncated) == (True, False)
    assert cause in info["cause"]
    assert steps == pytest.approx(outcome["time"] / (0.001 * hold), abs=1)
    assert reward / before == pytest.approx(1 + 2000 / hold - steps, rel=0.1)


def test_time_is_up_at_the_duration_and_a_held_action_is_a_longer_step() -> None:
    """Expected: by counting, 20 samples of 1 ms, 7 to a step; a function of the batch is the reward as it is."""
    seen = []

    def reward(after: Any) -> FloatArray:
        seen.append((after.time.copy(), after.force.shape, sorted(after.state) == sorted(after.reference)))
        return np.asarray(after.action[:, 0])

    env = gs.vector_env("hold_against_gravity", 2, {"loop.duration": 0.02}, reward=reward, hold=7, autoreset="disabled")
    env.reset(seed=1)
    steps = [env.step(np.full((2, 6), 3.0)) for _ in range(4)]
    assert [bool(step[3].all()) for step in steps] == [False, False, True, False]
    assert [step[1].tolist() for step in steps] == [[3, 3], [3, 3], [3, 3], [0, 0]]
    np.testing.assert_allclose([time for time, *_ in seen], np.repeat([[0.007], [0.014], [0.02], [0.02]], 2, axis=1))
    assert {shape for _, shape, _ in seen} == {(2, 6)}
    env.reset(options={"reset_mask": np.array([False, True])})
    assert env.step(np.full((2, 6), 3.0))[1].tolist() == [0, 3]


REFUSED: list[tuple[str, dict[str, Any], str]] = [
    ("heave_step", {"n": 0}, "n is 0"),
    ("heave_step", {"actions": "torque"}, "expected 'force' or 'pose'"),
    ("heave_step", {"observations": ["leg_lenght"]}, "leg_length"),
    ("heave_step", {"observations": []}, "observations is"),
    ("heave_step", {"reward": "force.peak"}, "tracking.position.norm_rms"),
    ("heave_step", {"autoreset": "same_step"}, "next_step"),
    ("impulse", {}, "disturbance"),
    ("heave_step", {"settings": {"loop.jitter": 0.0004, "loop.plant_step": 0.0002}}, "jitter"),
    ("heave_step", {"settings": {"fault": [{"at": 0, "cut": [1]}]}}, "fault: has a time"),
    ("heave_step", {"settings": {"change": [{"at": 1, "factors": {"platform_mass": 2}}]}}, "change: has a time"),
    ("heave_step", {"settings": {"sensors.sample_time": 0.002}}, "sensors.sample_time: has a time"),
    ("heave_step", {"settings": {"ensemble.platform.platform_mass": {"normal": 9}}, "actions": "pose"}, "nominal pla"),
    ("paper_open_loop", {"observations": ["reference.position"]}, "has no reference; add one"),
    ("paper_open_loop", {"actions": "pose"}, "controller"),
]


@pytest.mark.parametrize(("name", "options", "words"), REFUSED)
def test_what_cannot_be_an_environment_is_refused(name: str, options: dict[str, Any], words: str) -> None:
    """Expected: the value found, and what is possible."""
    with pytest.raises(gs.GoughStewartError, match=words):
        gs.vector_env(name, **{"n": 2, **options})


@pytest.mark.parametrize("ends", [{}, {"leg_length_min": None, "leg_length_max": None}])
def test_actions_are_bounded_by_forces_or_by_poses_about_home(ends: dict[str, None]) -> None:
    """Expected: each leg's limit [N]; half the stroke, else a tenth of a leg [m], and as far at a joint's radius."""
    limits = np.arange(4100.0, 4700, 100)
    settings: Any = {"platform.parameters": {"actuator_force_max": limits, **ends}, "actuators.force_limit": "platform"}
    kinds: Any = ("force", "pose")
    forces, poses = list[Any](gs.vector_env("heave_step", 2, settings, actions=kind).action_space for kind in kinds)
    np.testing.assert_array_equal([forces.low, forces.high], [[-limits] * 2, [limits] * 2])
    legs = gs.leg_geometry(HOME, HOME.home_position, HOME.home_orientation).length
    reach = 0.1 * np.mean(legs) if ends else np.asarray(HOME.stroke) / 2
    size = reach / np.repeat([1, np.linalg.norm(HOME.platform_points, axis=1).max()], 3)
    np.testing.assert_allclose([poses.low[1], poses.high[1]], [HOME_POSE - size, HOME_POSE + size], rtol=1e-12)


def test_actions_rewards_and_masks_of_other_shapes_are_refused() -> None:
    env = gs.vector_env("heave_step", 2, reward=lambda _: np.zeros(3))
    wrong = (np.zeros((3, 6)), "2 x 6"), (np.full((2, 6), np.nan), "nan"), (np.zeros((2, 6)), r"\(3,\)")
    for actions, words in wrong:
        with pytest.raises(gs.GoughStewartError, match=words):
            env.step(actions)
    for seed, mask in ((None, [1, 0]), (3, [True, False])):
        with pytest.raises(gs.GoughStewartError, match="True or False"):
            env.reset(seed=seed, options={"reset_mask": mask})
