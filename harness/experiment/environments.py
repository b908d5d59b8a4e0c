"""An experiment as an environment for learning, by the interface of Gymnasium 1."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.experiment.overrides import Settings
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.model.errors import NotInstalledError

if TYPE_CHECKING:
    from gough_stewart.harness.experiment.gymnasium_classes import ExperimentEnv, ExperimentVectorEnv, Reward

SIGNALS = ("leg_length", "leg_velocity")
Actions = Literal["force", "pose"]
METRIC = "tracking.position.norm_rms"


def vector_env(
    experiment: Experiment | Path | str,
    n: int,
    settings: Settings = (),
    *,
    actions: Actions = "force",
    observations: Sequence[str] = SIGNALS,
    reward: "str | Reward" = METRIC,
    hold: int = 1,
    autoreset: Literal["next_step", "disabled"] = "next_step",
) -> "ExperimentVectorEnv":
    """A vector environment of Gymnasium with n members of an experiment, on one compiled plant.

    An episode is the experiment's run, with its sensors, force limit, delay and drives. It terminates where the run
    would end, at a pose, stroke or position error that is too large, and is truncated at its duration.

    Parameters
    ----------
    experiment, settings
        As in `run`. With an `[ensemble]` each member has a machine of its own, drawn by `reset(seed=...)`.
    n
        Number of members.
    actions
        "force": six forces [N] that replace the controller's, added to the experiment's feedforward. "pose": position
        [m] and orientation [rad] that the experiment's own controller follows.
    observations
        Names of measured signals, and of the reference's, such as "reference.leg_length"; in this order.
    reward
        The path of a metric: minus the square of its error, so that the mean over an episode is minus the metric's
        square, and an early end counts its last error for all the rest. Or a function of arrays of all members
        (N, ...): `time`, `state`, `reference`, `action`, `force`, `terminated`; it returns (N,).
    hold
        How many samples of the loop an action is held: the length of a step.
    autoreset
        "next_step", as `metadata` says: the step after an episode's end begins the next. Or "disabled", for
        `reset(options={"reset_mask": ...})`.

    Returns
    -------
    ExperimentVectorEnv
        A `gymnasium.vector.VectorEnv`.

    Raises
    ------
    ExperimentError
        The experiment cannot run as written, or has changes, disturbances, faults, jitter or slower sensors.
    ArgumentError
        An unknown observation, metric, or mode.
    NotInstalledError
        Gymnasium is not installed.

    See Also
    --------
    env, ensemble

    Examples
    --------
    >>> machines = gs.vector_env("heave_step", 3, {"loop.duration": 0.1})
    >>> machines.reset(seed=0)[0].shape[0]
    3
    """
    chosen = load_experiment(experiment, settings)
    try:
        from gough_stewart.harness.experiment.gymnasium_classes import ExperimentVectorEnv
    except ModuleNotFoundError as error:
        if error.name != "gymnasium":
            raise
        text = (
            "not installed: gymnasium (environments for learning); install the extra: pip install 'gough-stewart[gym]'"
        )
        raise NotInstalledError(text) from None
    return ExperimentVectorEnv(chosen, n, actions, observations, reward, hold, autoreset)


def env(
    experiment: Experiment | Path | str,
    settings: Settings = (),
    *,
    actions: Actions = "force",
    observations: Sequence[str] = SIGNALS,
    reward: "str | Reward" = METRIC,
    hold: int = 1,
) -> "ExperimentEnv":
    """One experiment as an environment of Gymnasium: the first member of `vector_env` with the same arguments and seed.

    Parameters
    ----------
    experiment, settings, actions, observations, reward, hold
        As in `vector_env`; a function as `reward` gets arrays of one member.

    Returns
    -------
    ExperimentEnv
        A `gymnasium.Env`.

    Raises
    ------
    ExperimentError, ArgumentError, NotInstalledError
        As `vector_env`.

    See Also
    --------
    vector_env, run

    Examples
    --------
    >>> loop = gs.env("heave_step", {"loop.duration": 0.1})
    >>> observation, info = loop.reset(seed=0)
    >>> observation, reward, terminated, truncated, info = loop.step(loop.action_space.sample())
    """
    options: Any = {"actions": actions, "observations": observations, "reward": reward, "hold": hold}
    members = vector_env(experiment, 1, settings, **options, autoreset="disabled")
    from gough_stewart.harness.experiment.gymnasium_classes import ExperimentEnv  # which `vector_env` has imported

    return ExperimentEnv(members)
