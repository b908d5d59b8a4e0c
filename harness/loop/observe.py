"""The sampled loop: a controller in discrete time around the plant, as it would run on the machine.

A run has N members, N >= 1, which run in parallel; arrays have a leading member axis.
"""

from collections.abc import Callable

import numpy as np

from gough_stewart.harness.control.faults import CUT, N_FAULTS, Cut, NoCoefficients
from gough_stewart.harness.control.laws_of_members import Law, LawFrom, LinearLaw, LinearLaws
from gough_stewart.harness.errors import ControllerError, PlantError
from gough_stewart.harness.loop.actuators import Drives
from gough_stewart.harness.loop.compiled import run_compiled
from gough_stewart.harness.loop.law_library import compiled_form
from gough_stewart.harness.loop.loop import Change, Loop
from gough_stewart.harness.loop.outcomes import Outcome, Outcomes
from gough_stewart.harness.loop.rows import CHECKED, Observer
from gough_stewart.harness.loop.sampler import Sampler
from gough_stewart.harness.loop.sensors import Encoders
from gough_stewart.harness.loop.watch import Watch
from gough_stewart.harness.plants import members
from gough_stewart.harness.plants.lanes import LanesPlant
from gough_stewart.harness.plants.plant import Plant, PlantOfOne, seen
from gough_stewart.harness.plants.signals import MOTORS
from gough_stewart.model import interface
from gough_stewart.model.errors import MembersError, StepError
from gough_stewart.model.process.progress import TimeProgress
from gough_stewart.model.vectors import FloatArray

_ROWS_A_REPORT = 64


def observe(
    plant: Plant,
    law_from: LawFrom | None,
    loop: Loop,
    observer: Observer,
    progress: TimeProgress | None = None,
    threads: int = 1,
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
    threads
        For loops in machine code, at the most; results do not depend on their number.

    Raises
    ------
    ControllerError
        The controller of a plant of one platform gave no forces at its first sample, otherwise an outcome; or wrong
        loop shape; or a factory gave two members the same controller.
    PlantError
        The plant refuses a request before the first row; later this ends the run.
    """
    shape: tuple[int, ...] = getattr(plant, "shape", ())
    if loop.shape not in ((), shape):
        raise ControllerError(f"a loop of shape {loop.shape} with a plant of shape {shape}; expected the same shape")
    is_alone = not shape
    several = PlantOfOne(plant) if is_alone else plant
    (n_members,) = several.shape
    outcomes = Outcomes(n_members, loop.timing.times)
    rows = observer.start(loop.timing, several, n_members)
    watch = Watch(loop, rows, observer, outcomes)
    try:
        # members that have ended may compute NaN, which is not used; in a run of one, warnings are of the user's code
        with np.errstate(over="ignore") if is_alone else np.errstate(all="ignore"):
            _run(several, law_from, loop, watch, progress, threads)
    except (StepError, ControllerError, PlantError) as error:
        if not outcomes.rows:
            raise
        watch.check()
        outcomes.end(True, "diverged" if isinstance(error, StepError) else "stopped", str(error))
    except KeyboardInterrupt:
        if not outcomes.rows:
            raise
        watch.check()
        outcomes.end(True, "interrupted", "interrupted by the user")
    watch.finish()
    return outcomes.at_last()


def observe_all(
    plant: Plant, law_from: LawFrom | None, loop: Loop, observer: Observer, threads: int = 1
) -> tuple[Outcome, ...]:
    """Run many members to their ends as `observe`; after Ctrl-C what ran so far is dropped, and the interrupt goes on.

    Raises
    ------
    ControllerError, PlantError
        As of `observe`.
    KeyboardInterrupt
        The run was interrupted.
    """
    outcomes = observe(plant, law_from, loop, observer, threads=threads)
    if any(outcome.status == "interrupted" for outcome in outcomes):
        raise KeyboardInterrupt
    return outcomes


def _run(
    plant: Plant, law_from: LawFrom | None, loop: Loop, watch: Watch, progress: TimeProgress | None, threads: int
) -> None:
    """Run the loop in machine code if plant and controllers allow it, else row by row."""
    if law_from is not None and loop.reference is None:
        raise ControllerError("a controller without a reference; expected the reference signals for it to follow")
    shape = watch.outcomes.going.shape
    acting = members.zeros(shape, interface.size_of(interface.INPUTS))
    acting[..., :6] = loop.start_force
    faults = members.zeros(shape, N_FAULTS)
    changes = by_row(loop)

    def changed(row: int) -> FloatArray:
        for change in changes.get(row, ()):
            change_plant(change, plant, acting, faults)
        return acting

    changed(0)
    if isinstance(plant, LanesPlant) and plant.loop_run is not None:
        encoders = Encoders(loop.sensors, None, *shape)
        if isinstance(law_from, LinearLaws):
            encoders.only(law_from.used)
        reading = encoders(0, seen(plant, loop.sensors.side), 0)
        law = None if law_from is None or loop.reference is None else law_from(loop.reference[0], reading)
        own = law if law is None or isinstance(law, LinearLaw) else compiled_form(law)
        if law is None or own is not None:
            for member, error in ({} if law is None else law.failures).items():
                watch.outcomes.end(watch.outcomes.only(member), "stopped", str(error))
            run_compiled(plant, own, reading, loop, watch, acting, faults, changed, changes, progress, threads)
            return
        law_from = _already(law)
    _run_rows(plant, law_from, loop, watch, acting, faults, changed, progress)


def _already(law: Law) -> LawFrom:
    return lambda _reference, _measured: law


def _run_rows(
    plant: Plant,
    law_from: LawFrom | None,
    loop: Loop,
    watch: Watch,
    acting: FloatArray,
    faults: FloatArray,
    changed: Callable[[int], FloatArray],
    progress: TimeProgress | None,
) -> None:
    outcomes, timing, is_alone = watch.outcomes, loop.timing, isinstance(plant, PlantOfOne)
    n, plant_step = timing.steps, timing.plant_step
    forces = acting[..., :6]  # a view
    failing = faults if loop.has_faults else None
    drives = Drives(loop.actuators, forces, timing.sample_time, plant_step)
    sampler = Sampler(loop, law_from, drives, outcomes, watch.rows, failing)
    has_motors = MOTORS in plant.columns
    for k, time in enumerate(timing.times.tolist()):
        if k:
            changed(k)
        # what ends and is recorded is where the platform is
        now = plant.signals()
        at_motors = seen(plant, "motor") if has_motors else now
        watch.plant_at(now, at_motors)
        rate_limited = drives.none
        if k < n:
            sampler.at_row(k, at_motors if loop.sensors.side == "motor" else now)
            if not outcomes.all_go and not (outcomes.counting > k).any():
                # all controllers have failed: this row does not count
                if is_alone and not k:
                    raise sampler.failures[0]
                return
            drive, rate_limited = drives.step()
            if outcomes.all_go:
                forces[...] = drive
            else:
                np.copyto(forces, drive, where=outcomes.going[..., None])
                rate_limited = rate_limited & outcomes.going[..., None]
        if failing is not None:
            _, (left,) = Cut.step(NoCoefficients(), (), (forces, failing[..., CUT]))
            np.copyto(forces, left, where=outcomes.going[..., None])
        plant.set_inputs(acting)
        watch.row(now, acting, sampler.force_limited, rate_limited)
        if not k and plant.may_overrun and sampler.may_overrun:
            watch.every = CHECKED
        if progress is not None and k % _ROWS_A_REPORT == 0:
            progress(time)
        if k == n or not _step(plant, time, plant_step, outcomes):
            return


def _step(plant: Plant, time: float, step: float, outcomes: Outcomes) -> bool:
    """Step the plant; members that it cannot step end at their last row. False if no member is left."""
    if outcomes.ended_now:
        outcomes.ended_now = False
        if not outcomes.going.any():
            return False
        plant.freeze(~outcomes.going)
    try:
        plant.do_step(time, step)
    except MembersError as error:
        for member, failure in error.failures.items():
            outcomes.end(outcomes.only(member), "diverged", str(failure))
        outcomes.ended_now = False  # the plant has already frozen them
        return bool(outcomes.going.any())
    return True


def change_plant(change: Change, plant: Plant, acting: FloatArray, faults: FloatArray) -> None:
    """Pass parameters to the plant, the wrench to the inputs (*shape, 12), and what fails to the flags (*shape, 30)."""
    if change.parameters:
        if change.members is None:
            plant.set_parameters(change.parameters)
        else:
            plant.set_parameters_of(change.members, change.parameters)
    concerned = True if change.members is None else change.members[..., None]
    if change.external_wrench is not None:
        np.copyto(acting[..., 6:], change.external_wrench, where=concerned)
    if change.faults is not None:
        np.copyto(faults, change.faults, where=concerned)


def by_row(loop: Loop) -> dict[int, list[Change]]:
    rows: dict[int, list[Change]] = {}
    for change in loop.changes:
        rows.setdefault(loop.timing.row(change.time, "a change"), []).append(change)
    return rows
