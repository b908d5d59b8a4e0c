"""The sampled loop: a controller in discrete time around the plant, as it would run on the machine.

The same loop serves one run and many in parallel: arrays have the plant's shape as leading axes, () or (N,).
"""

import math
from collections.abc import Callable
from contextlib import nullcontext

import numpy as np

from gough_stewart.harness.errors import ControllerError, PlantError, SharedMemoryError
from gough_stewart.harness.loop.actuators import Drives
from gough_stewart.harness.loop.loop import LENGTHS, Change, LawFrom, Limits, Loop
from gough_stewart.harness.loop.observing import Observer, Row
from gough_stewart.harness.loop.outcomes import Outcome, Outcomes
from gough_stewart.harness.loop.sampler import Sampler
from gough_stewart.harness.plants import members, signals
from gough_stewart.harness.plants.members import PerMember
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
    continue; a single run has one outcome, too.

    Parameters
    ----------
    law_from
        Makes the control law from references (30,) and signals (24,) of the first sample; None for feedforward alone.
        For many members, use `laws_together`.
    loop
        With the plant's shape, or one loop for all members.
    progress
        Called with the time [s] from time to time.

    Raises
    ------
    ControllerError
        The controller gave no forces at its first sample (for one of many members an outcome), or wrong loop shape.
    SharedMemoryError
        Members share a controller with memory.
    PlantError
        The plant refuses a request before the first row; later this ends the run.
    """
    shape: tuple[int, ...] = getattr(plant, "shape", ())
    if loop.shape not in ((), shape):
        raise ControllerError(f"a loop of shape {loop.shape} with a plant of shape {shape}; expected the same shape")
    outcomes = Outcomes(shape)
    try:
        # members that have ended may compute NaN, which is not used
        with np.errstate(all="ignore") if shape else nullcontext():
            _run(plant, law_from, loop, observer, outcomes, progress)
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
    timing, shape = loop.timing, outcomes.going.shape
    n, plant_step = timing.steps, timing.plant_step
    acting = members.zeros(shape, interface.size_of(interface.INPUTS))
    forces = acting[..., :6]  # a view
    forces[...] = loop.start_force
    drives = Drives(loop.actuators, forces, timing.sample_time, plant_step)
    sampler, changes = Sampler(loop, law_from, drives, outcomes, shape), _by_row(loop)
    read_signals = _signals_of(plant)
    for k, time in enumerate(timing.times.tolist()):
        for change in changes.get(k, ()):
            _apply(change, plant, acting)
        now = read_signals()
        sampled, rate_limited = None, drives.none
        if k < n:
            sampled = sampler.at_row(k, time, now)
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
        _check(loop.limits, now, reference, outcomes)
        ended = outcomes.end_of_row()
        if ended is not None:
            if not outcomes.going.any():
                return
            plant.freeze(ended)
        if k < n:
            try:
                plant.do_step(time, plant_step)
            except MembersError as error:
                for member, failure in error.failures.items():
                    outcomes.end(outcomes.only(member), "diverged", str(failure), counts=False)
                outcomes.end_of_row()  # the plant has already frozen them
                if not outcomes.going.any():
                    return
        if progress is not None and k % _ROWS_A_REPORT == 0:
            progress(time)


def _signals_of(plant: Plant) -> Callable[[], FloatArray]:
    """The function that reads them; a plant that does not inherit from `Plant` may lack `signals`."""
    return plant.signals if hasattr(plant, "signals") else lambda: plant.results()[..., : signals.SIZE]


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


def _check(limits: Limits, now: FloatArray, reference: FloatArray | None, outcomes: Outcomes) -> None:
    """End members that have reached a limit."""
    if limits.on_stroke == "stop":
        beyond = limits.beyond_stroke(now[..., LENGTHS])
        if beyond.any():
            outcomes.end(beyond.any(axis=-1), "stopped", lambda k: _beyond_stroke(limits, now[..., LENGTHS], beyond, k))
    if reference is None:
        return
    bound = limits.largest_position_error
    if now.ndim == 1:
        gap = reference[:3] - now[:3]
        error: PerMember = math.sqrt(gap.dot(gap))  # faster than @
        if error <= bound:
            return
    else:
        gap = reference[..., :3] - now[..., :3]
        if members.all_below(gap, members.smallest(bound)):
            return
        x, y, z = gap.T
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
