"""An experiment's members as environments of Gymnasium, an extra: loops whose forces or poses come from outside.

Sensors, limits, delay, drives and the machine act as in a run; arrays have members last, and members restart one by
one.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from gymnasium import Env
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.random import SeedSequence
from numpy.typing import ArrayLike, NDArray

from gough_stewart.fmu_build.plant.layout import MemberFailure as Failure
from gough_stewart.harness.control.laws_of_members import LinearLaw, laws_of
from gough_stewart.harness.control.linear_controller import LinearController
from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.overrides import Values
from gough_stewart.harness.experiment.preparation import Preparation
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.loop.folds import AT, error_between
from gough_stewart.harness.loop.host import LoopHost, streams_of
from gough_stewart.harness.loop.libraries import loop_kernel
from gough_stewart.harness.loop.loop import LENGTHS, Limits, members_last
from gough_stewart.harness.plants.lanes import BatchPlant
from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.harness.plants.signals import N_LEGS, NAMES, VARIABLES, of_legs
from gough_stewart.model import interface
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.errors import ArgumentError, MembersError
from gough_stewart.model.interface import Variant, nearest
from gough_stewart.model.kinematics import leg_geometry, leg_jacobian
from gough_stewart.model.platform import LARGEST_NUMBER
from gough_stewart.model.vectors import FloatArray

# Poses reach this share of the mean leg length where the platform states no stroke.
_REACH = 0.1
_REFERENCE = "reference."
# What the loop remembers of an episode, see c/loop/loop.h.
_OF_EPISODES = (
    *("memory", "pose", "lengths", "command", "excess", "limited", "planned", "delayed"),
    *("target", "driven", "acting"),
)
# Metrics that are means of squares over rows, by the signal whose error they are of.
_SQUARES = {f"tracking.{name}.norm_rms": name for name in ("position", "orientation")}


class Transition(NamedTuple):
    """What a reward may depend on, after a step: the truth, not measurements; arrays (N, ...) valid during the call."""

    time: FloatArray  # since the episode's start (N,) [s]
    state: Mapping[str, FloatArray]  # signals by name, such as "position" (N, 3)
    reference: Mapping[str, FloatArray]  # the same of the experiment's reference; empty without one
    action: FloatArray  # (N, 6)
    force: FloatArray  # mean actuator forces of the last plant step (N, 6) [N]
    terminated: BoolArray  # (N,)


Reward = Callable[[Transition], ArrayLike]


class ExperimentVectorEnv(VectorEnv[FloatArray, FloatArray, NDArray[Any]]):
    """N members of an experiment as a `gymnasium.vector.VectorEnv`; arguments and errors are those of `vector_env`.

    Information of a step has `cause`, why a member terminated, where any has.
    """

    def __init__(
        self,
        experiment: Experiment,
        n: int,
        actions: str,
        observations: Sequence[str],
        reward: str | Reward,
        hold: int,
        autoreset: str,
    ) -> None:
        modes = [mode.name.lower() for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED)]
        for name, value, is_one, expected in (
            ("n", n, n >= 1, "at least 1"),
            ("hold", hold, hold >= 1, "at least 1"),
            ("actions", actions, actions in ("force", "pose"), "'force' or 'pose'"),
            ("autoreset", autoreset, autoreset in modes, " or ".join(map(repr, modes))),
            ("observations", observations, len(observations) > 0, "one or more signals, such as 'leg_length'"),
        ):
            if not is_one:
                raise ArgumentError(f"{name} is {value!r}; expected {expected}")
        for name, is_there in (
            *((name, bool(getattr(experiment, name))) for name in ("change", "disturbance", "fault")),
            ("loop.jitter", bool(experiment.loop.jitter)),
            ("sensors.sample_time", experiment.sensors.sample_time is not None),
        ):
            if is_there:
                text = "has a time of its own, which steps of episodes that restart one by one do not have; remove it"
                raise ExperimentError(experiment.where, name, text)
        self.metadata = {"autoreset_mode": AutoresetMode[autoreset.upper()], "render_modes": []}
        self.num_envs, self._experiment, self._hold, self._follows_poses = n, experiment, hold, actions == "pose"
        self._prepare(None)

        # what is observed: measured or of the reference, and its elements
        self._observed = list[tuple[str, slice]]()
        for name in observations:
            signal = name.removeprefix(_REFERENCE)
            if signal not in AT:
                raise ArgumentError(f"observations has {name!r}{nearest(signal, NAMES)}")
            if signal != name and self._reference is None:
                raise ArgumentError(
                    f"observations has {name!r}, and the experiment has no reference; add one, or remove it"
                )
            self._observed.append(("measured" if signal == name else "reference", AT[signal]))
        self._reward: Reward
        if not isinstance(reward, str):
            self._reward = reward
        elif reward not in _SQUARES or self._reference is None:
            raise ArgumentError(
                f"reward is {reward!r}; expected a function, or of an experiment with a reference one of "
                f"{', '.join(_SQUARES)}"
            )
        else:
            name, a_step = _SQUARES[reward], self._every * hold

            def minus_square(after: Transition) -> FloatArray:
                # what terminates counts its last error for all the rest of the episode, so that an early end is no gain
                error = error_between(name, after.reference[name].T, after.state[name].T)
                square = np.add.reduce(error * error, axis=0)
                left = np.where(after.terminated, (self._steps - self._row) // a_step, 0)
                return np.asarray(-square * (1 + left))

            self._reward = minus_square
        self._sense(None)
        self._observe()

        # the least and largest actions: force limits [N], or home ± half the stroke [m], angles as far [rad]
        limit, platform = self._loop.actuators.force_limit, self._platform
        bound = np.full(N_LEGS, np.inf) if limit is None else np.broadcast_to(of_legs(limit).max(axis=1), N_LEGS)
        low, high = -bound, bound
        if self._follows_poses:
            stroke, legs = platform.stroke, leg_geometry(platform, platform.home_position, platform.home_orientation)
            reach = _REACH * float(legs.length.mean()) if stroke is None else stroke / 2
            radius = float(np.linalg.norm(platform.platform_points, axis=1).max())
            home, size = np.r_[platform.home_position, platform.home_orientation], np.repeat([reach, reach / radius], 3)
            low, high = home - size, home + size
        n_observed = sum(at.stop - at.start for _, at in self._observed)
        self.single_observation_space = Box(-np.inf, np.inf, (n_observed,), dtype=np.float64)
        self.single_action_space = Box(low, high, dtype=np.float64)
        self.observation_space = batch_space(self.single_observation_space, n)
        self.action_space = batch_space(self.single_action_space, n)

    def _prepare(self, seed: int | None) -> None:
        """Members, with the draws of the `[ensemble]` of a seed; of none those of the experiment's own."""
        experiment, n = self._experiment, self.num_envs
        choice, tolerance = experiment.ensemble, experiment.plant.tolerance
        values: Sequence[Values] = [{}] * n
        if choice is not None:
            tolerance = choice.tolerance
            drawn = choice.model_copy(update={"members": n} if seed is None else {"members": n, "seed": seed})
            limits = experiment.limits.model_copy(update={"stroke": "warn"})  # of no concern for the draws
            values = Members(experiment.model_copy(update={"ensemble": drawn, "limits": limits})).draws(0, n).values
        batch = Preparation(experiment).members(values)
        for error in batch.errors.values():
            raise error
        self._loop, self._timing, self._platform = batch.loop, batch.timing, batch.setups[0].platform
        self._every, self._steps = self._timing.steps_a_sample, self._timing.steps
        fixed = experiment.plant.fixed_step_size
        self._plant = BatchPlant(
            batch.machines,
            [setup.start for setup in batch.setups],
            substeps=max(1, round(self._timing.plant_step / fixed)) if fixed else None,
            tolerance=tolerance,
            kernel=loop_kernel(Variant.of(batch.machines[0])),
        )
        for failure in self._plant.begin().values():
            raise failure
        self._reference = members_last(self._loop.reference)
        planned = np.zeros((len(self._timing.samples), N_LEGS)) if self._follows_poses else self._loop.feedforward
        self._known: Any = members_last(planned)
        injection: Any = members_last(self._loop.injection)  # each of both may be common to all members
        if injection is not None:
            self._known = self._known + injection
        # of each member its row, and whether and why its episode has ended; samples and readings so far
        self._row, self._samples, self._readings = np.zeros(n, dtype=np.intp), 0, 0
        self._ended, self._causes = np.zeros(n, dtype=bool), np.full(n, "", dtype=object)
        self._inputs, self._members = np.zeros((n, interface.N_INPUTS)), np.arange(n)
        # the loop's machine code, whose tables have one row, that of now: references and forces known in advance
        self._wanted, self._added = np.zeros((1, 30, n)), np.zeros((1, N_LEGS, n))
        loop = replace(
            self._loop,
            reference=np.moveaxis(self._wanted, 1, 2),
            feedforward=np.moveaxis(self._added, 1, 2),
            injection=None,
            limits=Limits(),
        )
        if self._loop.reference is not None:
            self._wanted[0] = self._reference_now()
        # the controllers of all, with the memory of rest in the start state
        self._law: LinearLaw | None = None
        if self._follows_poses:
            controllers, where = [setup.controller for setup in batch.setups], experiment.where
            if not all(isinstance(controller, LinearController) for controller in controllers):
                text = "follows no poses; expected a linear one, such as type = 'pd', or actions of forces"
                raise ExperimentError(where, "controller", text)
            if any(setup.platform is not self._platform for setup in batch.setups):
                raise ExperimentError(where, "ensemble", "varies the nominal platform, by which all poses are followed")
            jacobians = np.stack([setup.jacobians[:1] for setup in batch.setups], axis=1)
            make = laws_of(
                [controller for controller in controllers if controller is not None],
                self._timing.sample_time,
                jacobians,
            )
            silent = LoopHost(self._plant, replace(loop, sensors=replace(loop.sensors, noise={})))
            law = make(self._wanted[0].T, silent.reading)
            assert isinstance(law, LinearLaw)
            self._law = law
        self._host = host = LoopHost(self._plant, loop)
        host.control(self._law)
        c = host.structure
        for table in (c.reference, c.feedforward, c.sampled, c.jacobian, c.inverse):
            table.row = 0
        c.last, c.farthest.at, self._sampled = np.iinfo(np.int64).max, None, host.arrays[c.sampled.at]
        self._acting = c.size, c.used
        self._start = {name: host.memory[name].copy() for name in _OF_EPISODES}

    def _sense(self, seed: int | None) -> None:
        """Sensors with the noise of a seed, from their first reading on."""
        common, c = self._experiment.sensors.seed if seed is None else seed, self._host.structure
        used = {name for name in NAMES for kind, at in self._observed if kind == "measured" and AT[name] == at}
        used |= set(() if self._law is None else self._law.used)
        self._host.sense(sorted(used))
        seeds = tuple(SeedSequence(common, spawn_key=(k,)) for k in range(self.num_envs))
        self._host.memory["streams"].view(np.int64)[:, : self.num_envs] = streams_of(seeds)
        self._reading, self._readings = (c.size, c.used), 0

    def _observe(self) -> FloatArray:
        """Read the sensors once more, also of members that have ended: observations (N, size)."""
        host, c, n, running = self._host, self._host.structure, self.num_envs, self._plant.batch.running
        host.memory["signals"][:, :n] = self._plant.signals().T
        row, are_running = self._readings * self._every, running.copy()
        running[:n], self._sampled[...] = -1, row
        c.size, c.used = self._reading
        host.read(row)
        c.size, c.used = self._acting
        running[...], self._readings = are_running, self._readings + 1
        parts = {"measured": host.memory["measured"][:, :n], "reference": self._reference_now()}
        return np.ascontiguousarray(np.concatenate([parts[kind][at] for kind, at in self._observed]).T)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Begin new episodes of all members, or of those of `options["reset_mask"]` (N,).

        A seed draws the machines of `[ensemble]` and the noise, of member k from its stream k; else noise goes on.

        Raises
        ------
        ArgumentError
            Another kind of mask, or a mask with a seed.
        """
        mask = (options or {}).get("reset_mask")
        members = np.ones(self.num_envs, dtype=bool) if mask is None else np.asarray(mask)
        if members.shape != (self.num_envs,) or members.dtype != bool or (mask is not None and seed is not None):
            raise ArgumentError(
                f"reset_mask has shape {members.shape} and type {members.dtype}, the seed is {seed}; expected "
                f"{self.num_envs} times True or False, and no seed"
            )
        is_first = self._np_random_seed is None
        super().reset(seed=seed)
        if seed is not None or is_first:
            if self._experiment.ensemble is not None:
                self._prepare(self.np_random_seed)
            self._sense(self.np_random_seed or 0)
        self._restart(members)
        return self._observe(), {}

    def _restart(self, members: BoolArray) -> None:
        """Begin a new episode of these members (N,), in the start state of the experiment."""
        self._plant.restart(members)
        self._row[members], self._ended[members] = 0, False
        for name, start in self._start.items():
            np.copyto(self._host.memory[name][:, : self.num_envs], start[:, : self.num_envs], where=members)

    def step(  # noqa: PLR0912, PLR0915 - one road, in sections
        self, actions: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray, BoolArray, dict[str, Any]]:
        """Take actions (N, 6); members whose episode had ended begin the next, or stay, with reward 0.

        Raises
        ------
        ArgumentError
            Actions of another shape, or that are no numbers.
        """
        actions, n, law = np.asarray(actions, dtype=float), self.num_envs, self._law
        if actions.shape != (n, N_LEGS) or not (np.abs(actions) <= LARGEST_NUMBER).all():
            raise ArgumentError(
                f"actions have shape {actions.shape} and values up to {np.abs(actions).max(initial=0.0):g}; expected "
                f"{n} x {N_LEGS} numbers up to {LARGEST_NUMBER:g}"
            )
        waiting = self._ended
        going, terminated = ~waiting, np.zeros(n, dtype=bool)
        if waiting.any():
            self._plant.freeze(waiting)

        # forces, or references at rest in the poses with the feedforward that holds them
        host, added = self._host, actions.T
        if law is not None:
            position, orientation = actions[:, :3], actions[:, 3:]
            self._wanted[0], self._wanted[0, :6] = 0.0, actions.T
            self._wanted[0, LENGTHS] = leg_geometry(self._platform, position, orientation).length.T
            if law.jacobians is not None and law.inverses is not None:
                J = leg_jacobian(self._platform, position, orientation)
                law.jacobians[0], law.inverses[0] = (np.moveaxis(M, 0, -1) for M in (J, np.linalg.inv(J)))
            added = np.zeros((N_LEGS, 1))
            if self._experiment.controller.feedforward != "none":
                added = static_leg_forces(self._platform, position, orientation).T

        for sample in range(self._hold):
            if sample:
                self._observe()
            self._added[0] = self._at(self._known, np.minimum(self._row, self._steps - 1) // self._every) + added
            first, self._samples = self._samples * self._every, self._samples + 1
            self._sampled[...] = first
            for row in range(first, first + self._every):
                host.act(row)
                # the plant, and who ends there
                ended, step = self._plant.batch.failure[:n] == Failure.COMMAND, self._timing.plant_step
                self._causes[ended] = "the controller's forces are too large"
                self._plant.batch.failure[:n][ended] = Failure.GOES_ON
                self._inputs[:, :N_LEGS] = host.memory["acting"][:, :n].T
                self._plant.set_inputs(self._inputs)
                try:
                    self._plant.do_step(row * step, step)
                except MembersError as error:
                    for member, failure in error.failures.items():
                        ended[member], self._causes[member] = True, str(failure)
                self._row += going
                now, limits = self._plant.signals(), self._loop.limits
                if limits.on_stroke == "stop":
                    beyond = limits.beyond_stroke(now[:, LENGTHS]).any(axis=1) & going
                    ended |= beyond
                    self._causes[beyond] = "a leg is beyond its stroke"
                if self._reference is not None and np.min(limits.largest_position_error) < np.inf:
                    gap = self._reference_now()[:3] - now.T[:3]
                    away = ~(np.add.reduce(gap * gap, axis=0) <= np.square(limits.largest_position_error)) & going
                    ended |= away
                    self._causes[away] = "the platform is too far from its reference"
                terminated |= ended
                ended |= self._row == self._steps
                if ended.any():
                    going &= ~ended
                    self._plant.freeze(ended)

        self._ended = ~going
        truncated = self._ended & ~waiting & ~terminated
        by_name, known = interface.unpack, dict[str, FloatArray]()
        if self._reference is not None:
            known = by_name(VARIABLES, self._reference_now()[: AT[NAMES[-1]].stop].T)
        state, time = by_name(VARIABLES, self._plant.signals()), np.asarray(self._row * self._timing.plant_step)
        after = Transition(time, state, known, actions, self._inputs[:, :N_LEGS], terminated)
        rewards = np.array(self._reward(after), dtype=float)
        if rewards.shape != (n,):
            raise ArgumentError(f"rewards have shape {rewards.shape}; expected one for each member, ({n},)")
        rewards[waiting] = 0.0
        infos = {"cause": self._causes.copy(), "_cause": terminated.copy()} if terminated.any() else {}
        if self.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP and waiting.any():
            self._restart(waiting)
        return self._observe(), rewards, terminated, truncated, infos

    def _reference_now(self) -> Any:
        """The reference at each member's row (30, N)."""
        return None if self._reference is None else self._at(self._reference, self._row)

    def _at(self, table: FloatArray, rows: NDArray[np.intp]) -> FloatArray:
        """Of a table (rows, size, N or 1) each member's row (size, N)."""
        return table[rows, :, self._members if table.shape[2] > 1 else 0].T


class ExperimentEnv(Env[FloatArray, FloatArray]):
    """One member of an experiment as a `gymnasium.Env`: the first of the vector environment with the same seed."""

    def __init__(self, members: ExperimentVectorEnv) -> None:
        self._members = members
        self.observation_space, self.action_space = members.single_observation_space, members.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Begin a new episode; a seed as of `ExperimentVectorEnv`."""
        super().reset(seed=seed, options=options)
        return self._members.reset(seed=seed)[0][0], {}

    def step(self, action: FloatArray) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Take an action (6,)."""
        observed, rewards, terminated, truncated, infos = self._members.step(np.asarray(action)[None])
        info = {"cause": infos["cause"][0]} if infos else {}
        return observed[0], float(rewards[0]), bool(terminated[0]), bool(truncated[0]), info
