"""Episodes of an experiment as Gymnasium's environments; imports Gymnasium, which is an extra."""

from typing import Any, ClassVar

import numpy as np
from gymnasium import Env
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from gough_stewart.harness.experiment.episodes import Episodes
from gough_stewart.model.errors import ArgumentError
from gough_stewart.model.vectors import FloatArray

Flags = NDArray[np.bool_]


class ExperimentVectorEnv(VectorEnv[FloatArray, FloatArray, NDArray[Any]]):
    """N members of an experiment as a `gymnasium.vector.VectorEnv`, stepped together.

    Information of a step has `cause`, why a member terminated, where any has.
    """

    def __init__(self, episodes: Episodes, autoreset: AutoresetMode) -> None:
        self._episodes, self.num_envs = episodes, episodes.n
        self.metadata = {"autoreset_mode": autoreset, "render_modes": []}
        self.single_observation_space, self.single_action_space = spaces_of(episodes)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Begin new episodes of all members, or of those of `options["reset_mask"]` (N,).

        Parameters
        ----------
        seed
            Of the machines of an `[ensemble]` and of noise, whose streams otherwise go on.

        Raises
        ------
        ArgumentError
            Another kind of mask, or a mask with a seed.
        """
        mask = (options or {}).get("reset_mask")
        everyone = np.ones(self.num_envs, dtype=bool)
        members = everyone if mask is None else np.asarray(mask)
        if members.shape != everyone.shape or members.dtype != bool or (mask is not None and seed is not None):
            raise ArgumentError(
                f"reset_mask has shape {members.shape} and type {members.dtype}, the seed is {seed}; expected "
                f"{self.num_envs} times True or False, and no seed"
            )
        is_first = self._np_random_seed is None
        super().reset(seed=seed)
        if seed is not None or is_first:
            self._episodes.seed(self.np_random_seed or 0)
        self._episodes.restart(members)
        return self._episodes.observe(), {}

    def step(self, actions: FloatArray) -> tuple[FloatArray, FloatArray, Flags, Flags, dict[str, Any]]:
        """Take actions (N, 6); those whose episode ended in the last step begin a new one, without an action."""
        episodes, restarting = self._episodes, self._episodes.ended
        rewards, terminated, truncated = episodes.step(actions)
        if self.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP and restarting.any():
            episodes.restart(restarting)
        infos: dict[str, Any] = {}
        if terminated.any():
            infos = {"cause": np.where(terminated, episodes.causes, None), "_cause": terminated.copy()}
        return episodes.observe(), rewards, terminated, truncated, infos


class ExperimentEnv(Env[FloatArray, FloatArray]):
    """One member of an experiment as a `gymnasium.Env`: the first of the vector environment with the same seed."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}

    def __init__(self, episodes: Episodes) -> None:
        self._episodes = episodes
        self.observation_space, self.action_space = spaces_of(episodes)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Begin a new episode; a seed as of `ExperimentVectorEnv`."""
        is_first = self._np_random_seed is None
        super().reset(seed=seed, options=options)
        if seed is not None or is_first:
            self._episodes.seed(self.np_random_seed)
        self._episodes.restart(np.ones(1, dtype=bool))
        return self._episodes.observe()[0], {}

    def step(self, action: FloatArray) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Take an action (6,)."""
        rewards, (terminated,), (truncated,) = self._episodes.step(np.asarray(action)[None])
        info = {"cause": self._episodes.causes[0]} if terminated else {}
        return self._episodes.observe()[0], float(rewards[0]), bool(terminated), bool(truncated), info


def spaces_of(episodes: Episodes) -> tuple[Box, Box]:
    """What one member observes, and its actions."""
    low, high = episodes.action_bounds
    shape = (episodes.observation_size,)
    return Box(-np.inf, np.inf, shape, dtype=np.float64), Box(low, high, dtype=np.float64)
