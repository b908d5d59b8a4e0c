"""Linear analysis of an experiment: gains, loop transfer, closed-loop modes, margins, figures."""

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.harness.control.controllers import PD, PID, ControllerChoice
from gough_stewart.harness.control.laws import LinearController, linear_of
from gough_stewart.harness.control.linear import modes
from gough_stewart.harness.control.loop_transfer import MOST_STATES, feedback_part, held_plant, loop_transfer
from gough_stewart.harness.control.margins import Margins, closed_loop, is_stable, loop_margins
from gough_stewart.harness.control.python.makers import Maker
from gough_stewart.harness.control.state_space import StateSpace
from gough_stewart.harness.control.structure import Structure, structural_modes, structure_of
from gough_stewart.harness.errors import ControllerError, UnstableLoopError
from gough_stewart.harness.experiment.file import experiment_of
from gough_stewart.harness.experiment.margins_report import FRAIL, LoopMargins
from gough_stewart.harness.experiment.overrides import Settings
from gough_stewart.harness.experiment.preparation import Prepared, prepare
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.results.run_report import Robustness
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.platform import Platform
from gough_stewart.model.variant import RIGID

# Of an eigenvalue, and the largest exponent of a growth that is told.
_ROUNDING, _MOST = 1e-7, 300.0


def margins(experiment: Experiment | Path | str, settings: Settings = (), *, controller: Any = None) -> LoopMargins:
    """Gains, closed-loop modes and stability margins of an experiment's loop, on the linear model.

    The loop that runs: the machine under the controller that is designed on the believed platform, linearised at the
    first pose of the reference; sampled, delayed and lagged as in the experiment, with the sensors' own clock and
    jitter as their worst delay. For each leg with the others closed, and for one change of all legs: gain, phase [rad]
    and delay [s]; for independent changes of all legs the disk margin.

    Parameters
    ----------
    experiment
        A TOML file, the name of a shipped experiment, or an `Experiment`.
    settings
        Keys of the experiment to change, as in `load_experiment`.
    controller
        Replaces the experiment's: a discrete python-control system, or a `LinearController`.

    Returns
    -------
    LoopMargins
        `legs` and `disk`, the margins of each leg and of all at once; peaks of S and T; `gains`, `modes` and the `loop`
        transfer as a python-control system.

    Raises
    ------
    ControllerError
        The controller is not linear, or there is none.
    UnstableLoopError
        The loop is unstable in the linear model.
    ExperimentError, ReachError
        As `run`.

    Examples
    --------
    >>> found = gs.margins("heave_step", {"loop.delay": 2})
    >>> found.disk.alpha, min(leg.phase for leg in found.legs)
    """
    chosen = experiment_of(experiment, settings)
    # the loop at rest has its margins however fast its reference is
    prepared = prepare(experiment_of(chosen, {"limits.reference": "warn"}), controller)
    linear = linear_of(prepared.controller)
    if linear is None:
        what = "an open loop has no margins" if prepared.controller is None else "a function has no transfer function"
        raise ControllerError(f"{chosen.where}: controller: {what}; choose an experiment with a linear controller")
    actuators, machine, believed = prepared.loop.actuators, prepared.machine, prepared.platform
    choice = chosen.controller if controller is None else None
    other, warnings = None, tuple[str, ...]()
    if machine != believed:
        try:
            other = judged(prepared, believed, linear).margins
        except UnstableLoopError:
            warnings = ("with the believed platform as machine the loop would be unstable",)
    try:
        L, of_machine, doubt, warning = judged(prepared, machine, linear)
    except UnstableLoopError as error:
        moved = _what_moved_it(prepared, linear, choice)
        if other is not None:
            moved.append(
                f"it is stable with the believed platform as machine, with a disk margin of {other.disk.alpha:.3g}"
            )
        raise UnstableLoopError("; ".join([str(error), *moved]), error.eigenvalue) from None
    return LoopMargins(
        **vars(of_machine),
        title=chosen.title,
        sample_time=prepared.loop.timing.sample_time,
        delay=actuators.delay,
        lag=actuators.lag,
        gains=chosen.controller.gains(believed) if controller is None else None,
        modes=tuple(modes(closed_loop(L))),
        transfer=L,
        changed=chosen.changed,
        structure=_structure(prepared, L, choice),
        late=0.0 if doubt else prepared.loop.worst_delay,
        doubt=doubt,
        believed=other,
        warnings=(*warnings, *([warning] if doubt else [])),
    )


class Judged(NamedTuple):
    """A stable loop."""

    transfer: StateSpace
    margins: Margins
    doubt: str = ""  # what the margins leave out, so that a requirement on them cannot be told
    warning: str = ""  # that, and why


def judged(prepared: Prepared, plant: Platform, controller: LinearController) -> Judged:
    """The margins of an experiment's loop around a plant, which is its machine or another.

    With the worst delay of the sensors' own clock and of jitter, by which the loop is never later. If it is unstable
    with that, although it is not by its eigenvalues over a period of both clocks, margins are of the loop without.

    Raises
    ------
    ControllerError
        Too many states.
    UnstableLoopError
        The loop is unstable.
    """
    late = prepared.loop.worst_delay
    try:
        L = transfer_of(prepared, plant, controller)
        return Judged(L, loop_margins(L))
    except (UnstableLoopError, ControllerError) as error:
        if not late:
            raise
        why = "the loop is unstable" if isinstance(error, UnstableLoopError) else str(error)
    radius = radius_of(prepared, plant, controller)
    if radius >= 1:
        raise UnstableLoopError(
            f"the closed loop is unstable (|z| = {radius:.6g} at a sample, expected below 1)", radius
        )
    L = transfer_of(prepared, plant, controller, late=0.0)
    left_out = f"without up to {1e3 * late:.4g} ms of delay by the sensors' clock and jitter"
    return Judged(L, loop_margins(L), left_out, f"the margins are {left_out}: with it, {why}")


def radius_of(prepared: Prepared, plant: Platform, controller: LinearController) -> float:
    """The largest |z| of a sample of an experiment's loop, with the sensors' own clock, exactly, and without jitter.

    Lifted: x⁺ = M x over the least common multiple of both clocks; the root of M's largest |eigenvalue| for as many
    samples as there are.

    Raises
    ------
    ControllerError
        Too many states.
    """
    loop, motion, own = prepared.loop, prepared.motion, prepared.loop.sensors.sample_time
    assert motion is not None  # as in `transfer_of`
    timing, where = loop.timing, (motion.position[0], motion.orientation[0])
    a_sample = timing.steps_a_sample
    a_reading = a_sample if own is None else timing.steps_in(own, "the sensors' sample_time")
    step, period = math.gcd(a_sample, a_reading), math.lcm(a_sample, a_reading)
    P = held_plant(plant, controller, step * timing.plant_step, loop.actuators.lag, *where, side=loop.sensors.side)
    K = feedback_part(prepared.platform, controller, *where)
    sizes = P.nstates, P.noutputs, K.nstates, *[6] * (loop.actuators.delay + 1)
    if sum(sizes) > MOST_STATES:
        raise ControllerError(
            f"the loop over a period of both clocks has {sum(sizes)} states; expected at most {MOST_STATES}"
        )
    x, reading, memory, *forces = np.split(np.eye(sum(sizes)), np.cumsum(sizes)[:-1])
    for k in range(0, period, step):
        if k % a_reading == 0:
            reading = P.C @ x
        if k % a_sample == 0:
            forces = [*forces[1:], -(K.C @ memory + K.D @ reading)]
            memory = K.A @ memory + K.B @ reading
        x = P.A @ x + P.B @ forces[0]
    M = np.concatenate([x, reading, memory, *forces])
    return float(np.abs(np.linalg.eigvals(M)).max()) ** (a_sample / period) if np.isfinite(M).all() else math.inf


def growing_of(prepared: Prepared) -> tuple[str, ...]:
    """One sentence if the loop of a run is unstable in the linear model, however slowly it grows."""
    if isinstance(prepared.controller, Maker):  # a factory is asked once, for the run itself
        return ()
    try:
        controller = linear_of(prepared.controller)
        if controller is None:
            return ()
        radius = radius_of(prepared, prepared.machine, controller)
    except GoughStewartError:  # no linear loop
        return ()
    if radius < 1 + _ROUNDING:
        return ()
    timing = prepared.loop.timing
    times = math.exp(min(math.log(radius) * timing.duration / timing.sample_time, _MOST))
    return (
        f"the linear loop, without Coulomb friction and limits, is unstable: errors grow to {times:.3g} times their "
        f"size in {timing.duration:g} s; `gough-stewart margins` shows what the loop allows",
    )


def _structure(prepared: Prepared, L: StateSpace, choice: ControllerChoice | None) -> Structure | None:
    """The structural modes of the machine, and the bandwidth that keeps a usual disk margin."""
    machine, sample_time, motion = prepared.machine, prepared.loop.timing.sample_time, prepared.motion
    assert motion is not None  # as in `transfer_of`
    family = None
    if isinstance(choice, PD | PID) and choice.bandwidth is not None:

        def with_bandwidth(bandwidth: float, choice: PD | PID = choice) -> StateSpace:
            other = choice.model_copy(update={"bandwidth": bandwidth}).controller(prepared.platform, sample_time)
            return transfer_of(prepared, machine, other)

        family = choice.bandwidth, with_bandwidth
    return structure_of(machine, L, family, FRAIL, motion.position[0], motion.orientation[0])


def robustness_of(experiment: Experiment) -> Robustness | None:
    """The disk margin of an experiment's loop as `margins` has it: 0 of an unstable loop, None if it has none."""
    try:
        of_loop = margins(experiment)
    except UnstableLoopError:
        return Robustness(0.0, math.nan, (1.0, 1.0))
    except ControllerError:
        return None
    return Robustness(of_loop.disk.alpha, of_loop.disk.frequency, of_loop.disk.gain, of_loop.doubt)


def transfer_of(prepared: Prepared, plant: Platform, controller: LinearController, **other: Any) -> StateSpace:
    """L(z) of an experiment's loop around a plant, its platform or a machine, with a controller for its platform.

    In the first pose of the reference, or with `other` arguments of `loop_transfer`, `sample_time` among them.
    """
    loop, motion = prepared.loop, prepared.motion
    assert motion is not None  # a controller has a reference
    own = {
        "sample_time": loop.timing.sample_time,
        "delay": loop.actuators.delay,
        "lag": loop.actuators.lag,
        "late": loop.worst_delay,
        "position": motion.position[0],
        "orientation": motion.orientation[0],
    }
    return loop_transfer(plant, controller, believed=prepared.platform, side=loop.sensors.side, **own | other)


def _what_moved_it(prepared: Prepared, controller: LinearController, choice: ControllerChoice | None) -> list[str]:
    """Other changes that would stabilise a loop, each alone: rigid legs, no delay, no lag, a shorter sample time."""
    machine, sample_time = prepared.machine, prepared.loop.timing.sample_time
    delay, lag, late = prepared.loop.actuators.delay, prepared.loop.actuators.lag, prepared.loop.worst_delay

    def is_stable_with(plant: Platform = machine, law: LinearController = controller, **other: Any) -> bool:
        try:
            return is_stable(transfer_of(prepared, plant, law, **other))
        except ControllerError:  # too many states
            return False

    remedies = []
    if machine.leg_stiffness > 0 and is_stable_with(machine.with_parameters(RIGID)):
        assert prepared.motion is not None  # as in `transfer_of`
        free, _ = structural_modes(machine, prepared.motion.position[0], prepared.motion.orientation[0])
        first = f", whose first structural mode is at {free[0].frequency:.3g} Hz" if free else ""
        remedies.append(
            f"it is stable on rigid legs: those of {machine.leg_stiffness:g} N/m{first}, limit the bandwidth"
        )
    if delay and is_stable_with(delay=0):
        remedies.append(f"it is stable without the delay of {delay} samples")
    if lag and is_stable_with(lag=0.0):
        remedies.append(f"it is stable without the actuators' lag of {lag:g} s")
    if late and is_stable_with(late=0.0):
        remedies.append(f"it is stable without the delay of up to {1e3 * late:.4g} ms by the sensors' clock and jitter")
    for part in (2, 4, 8, 16):
        # a controller from a file is made for its own sample time
        shorter = sample_time / part
        faster = choice.controller(prepared.platform, shorter) if isinstance(choice, PD | PID) else None
        if isinstance(faster, LinearController) and is_stable_with(law=faster, sample_time=shorter):
            remedies.append(f"it is stable at a sample_time of {shorter:g} s")
            break
    return remedies
