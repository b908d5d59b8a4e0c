"""The sampled loop: a controller in discrete time around the plant, as it would run on the machine.

A run has N members, N >= 1, which run in parallel; arrays have a leading member axis.
"""

import numpy as np

from gough_stewart.harness.control.laws_of_members import LawFrom
from gough_stewart.harness.errors import ControllerError, PlantError, SharedMemoryError
from gough_stewart.harness.loop.actuators import Drives
from gough_stewart.harness.loop.loop import LENGTHS, Change, Limits, Loop
from gough_stewart.harness.loop.observing import Observer, Row
from gough_stewart.harness.loop.outcomes import Outcome, Outcomes
from gough_stewart.harness.loop.sampler import Sampler
from gough_stewart.harness.plants import members
from gough_stewart.harness.plants.alone import Alone, signals_of
from gough_stewart.harness.plants.plant import BoolArray, Plant
from gough_stewart.model import interface
from gough_stewart.model.errors import MembersError, StepError
from gough_stewart.model.progress import TimeProgress
from gough_stewart.model.vectors import FloatArray

_ROWS_A_REPORT = 64


def observe(
    plant: Plant, law_from: LawFrom | None, loop: Loop, observer: Observer, progress: TimeProgress | None = None
) -> tuple[Outcome, ...]:
    """Run the loop until it ends or cannot continue; either is an outcome of each member, not an error.

    At each sample: measure, compute, and hold the forces (`actuators.delay` samples later). At each plant step: apply
    changes, advance the drives, call the observer, step the plant. Members that have ended stay frozen while the others
    continue.

    Parameters
    ----------
    plant
        Of N members; a plant of one platform is a member alone.
    law_from
        Makes the controllers of all members, see `laws_of` and `law_of`; None for feedforward alone.
    loop
        With the plant's shape, or one loop for all members.
    progress
        Called with the time [s] from time to time.

    Raises
    ------
    ControllerError
        The controller of a plant of one platform gave no forces at its first sample, otherwise an outcome; or wrong
        loop shape.
    SharedMemoryError
        Members share a controller with memory.
    PlantError
        The plant refuses a request before the first row; later this ends the run.
    """
    shape: tuple[int, ...] = getattr(plant, "shape", ())
    if loop.shape not in ((), shape):
        raise ControllerError(f"a loop of shape {loop.shape} with a plant of shape {shape}; expected the same shape")
    is_alone = not shape
    outcomes = Outcomes(shape or (1,))
    try:
        # members that have ended may compute NaN, which is not used; in a run of one, warnings are of the user's code
        with np.errstate(over="ignore") if is_alone else np.errstate(all="ignore"):
            _run(Alone(plant) if is_alone else plant, law_from, loop, observer, outcomes, progress)
    except (StepError, ControllerError, PlantError) as error:
        if outcomes.time is None or isinstance(error, SharedMemoryError):
            raise
        outcomes.end(True, "diverged" if isinstance(error, StepError) else "stopped", str(error), counts=False)
    except KeyboardInterrupt:
        if outcomes.time is None:
            raise
        outcomes.end(True, "interrupted", "interrupted by the user", counts=False)
    return outcomes.at_last(float(loop.timing.times[-1]))


def observe_all(plant: Plant, law_from: LawFrom | None, loop: Loop, observer: Observer) -> tuple[Outcome, ...]:
    """Run many members to their ends as `observe`; after Ctrl-C what ran so far is dropped, and the interrupt goes on.

    Raises
    ------
    ControllerError, PlantError
        As of `observe`.
    KeyboardInterrupt
        The run was interrupted.
    """
    outcomes = observe(plant, law_from, loop, observer)
    if any(outcome.status == "interrupted" for outcome in outcomes):
        raise KeyboardInterrupt
    return outcomes


def _run(
    plant: Plant,
    law_from: LawFrom | None,
    loop: Loop,
    observer: Observer,
    outcomes: Outcomes,
    progress: TimeProgress | None,
) -> None:
    timing, shape, is_alone = loop.timing, outcomes.going.shape, isinstance(plant, Alone)
    n, plant_step = timing.steps, timing.plant_step
    acting = members.zeros(shape, interface.size_of(interface.INPUTS))
    forces = acting[..., :6]  # a view
    forces[...] = loop.start_force
    drives = Drives(loop.actuators, forces, timing.sample_time, plant_step)
    sampler, changes = Sampler(loop, law_from, drives, outcomes), _by_row(loop)
    read_signals = signals_of(plant)
    wanted = None if loop.reference is None else loop.reference[..., :3]
    for k, time in enumerate(timing.times.tolist()):
        for change in changes.get(k, ()):
            _apply(change, plant, acting)
        now = read_signals()
        sampled, rate_limited = None, drives.none
        if k < n:
            sampled = sampler.at_row(k, time, now)
            if not outcomes.all_go and not outcomes.running.any():
                # all controllers have failed: this row does not count
                if is_alone and outcomes.time is None:
                    raise sampler.failures[0]
                return
            drive, rate_limited = drives.step()
            if outcomes.all_go:
                forces[...] = drive
            else:
                np.copyto(forces, drive, where=outcomes.going[..., None])
                rate_limited = rate_limited & outcomes.going[..., None]
        plant.set_inputs(acting)
        reference = None if loop.reference is None else loop.reference[k]
        observer.row(
            Row(
                k,
                time,
                now,
                acting,
                reference,
                sampler.command,
                sampler.force_limited,
                rate_limited,
                outcomes.running,
                sampled,
            )
        )
        outcomes.time = time
        _check(loop.limits, now, None if wanted is None else wanted[k], outcomes)
        ended = outcomes.end_of_row()
        if ended is not None:
            if not outcomes.going.any():
                return
            plant.freeze(ended)
        if k < n:
            _step(plant, time, plant_step, outcomes)
            if not outcomes.all_go and not outcomes.going.any():
                return
        if progress is not None and k % _ROWS_A_REPORT == 0:
            progress(time)


def _step(plant: Plant, time: float, step: float, outcomes: Outcomes) -> None:
    """Step the plant; members that it cannot step end at their last row."""
    try:
        plant.do_step(time, step)
    except MembersError as error:
        for member, failure in error.failures.items():
            outcomes.end(outcomes.only(member), "diverged", str(failure), counts=False)
        outcomes.end_of_row()  # the plant has already frozen them


def _apply(change: Change, plant: Plant, acting: FloatArray) -> None:
    """Pass parameters to the plant, and the wrench to the inputs (*shape, 12)."""
    if change.parameters:
        if change.members is None:
            plant.set_parameters(change.parameters)
        else:
            plant.set_parameters_of(change.members, change.parameters)
    if change.external_wrench is not None:
        concerned = True if change.members is None else change.members[..., None]
        np.copyto(acting[..., 6:], change.external_wrench, where=concerned)


def _check(limits: Limits, now: FloatArray, wanted: FloatArray | None, outcomes: Outcomes) -> None:
    """End members that have reached a limit; `wanted` are positions (3,) or (N, 3) [m]."""
    if limits.on_stroke == "stop":
        beyond = limits.beyond_stroke(now[..., LENGTHS])
        if beyond.any():
            outcomes.end(beyond.any(axis=-1), "stopped", lambda k: _beyond_stroke(limits, now[..., LENGTHS], beyond, k))
    if wanted is None:
        return
    bound = limits.largest_position_error
    gap = (wanted - now[:, :3]).T
    if members.all_below(gap, members.smallest(bound)):
        return
    x, y, z = gap
    error = np.sqrt(x * x + y * y + z * z)
    outcomes.end(
        ~np.less_equal(error, bound),  # also true for NaN
        "diverged",
        lambda k: (
            f"the platform is {members.of(error, k):.3g} m from its reference; the limit is {members.of(bound, k):g} m"
        ),
    )


def _beyond_stroke(limits: Limits, lengths: FloatArray, beyond: BoolArray, k: int) -> str:
    """The message for a member's first leg beyond its stroke."""
    leg = int(beyond.reshape(-1, 6)[k].argmax())
    low, high = (members.of(each, k) for each in limits.stroke)
    return f"leg {leg + 1} is {lengths.reshape(-1, 6)[k, leg]:.6g} m long; its stroke is {low:g} to {high:g} m"


def _by_row(loop: Loop) -> dict[int, list[Change]]:
    rows: dict[int, list[Change]] = {}
    for change in loop.changes:
        rows.setdefault(loop.timing.row(change.time, "a change"), []).append(change)
    return rows
