"""Runs of the sampled loop: a controller in discrete time around the plant, as it would run on the machine.

A run has N members, N >= 1, which run in parallel; arrays have a leading member axis.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.laws_of_members import LawFrom, SeparateLaws
from gough_stewart.harness.errors import ControllerError, PlantError
from gough_stewart.harness.loop.host import LoopHost
from gough_stewart.harness.loop.libraries import compiled_together
from gough_stewart.harness.loop.loop import LENGTHS, Loop, ScheduledChanges
from gough_stewart.harness.loop.rows import AllRows, Observer, Outcome, RowMonitor
from gough_stewart.harness.plants.plant import BoolArray, Plant, PlantOfOne
from gough_stewart.model.errors import StepError
from gough_stewart.model.process.progress import TimeProgress
from gough_stewart.model.vectors import FloatArray


def observe(
    plant: Plant,  # of N members; a plant of one platform is a member alone
    law_from: LawFrom | None,  # makes the controllers of all members, see `laws_of`; None for feedforward alone
    loop: Loop,  # with the plant's shape, or one loop for all members
    observer: Observer,
    progress: TimeProgress | None = None,  # called with the time [s] from time to time
    threads: int = 1,  # for machine code, at the most; results do not depend on their number
    *,
    keeps_interrupted: bool = True,  # whether an interrupt is an outcome, with the rows so far; else it goes on
) -> tuple[Outcome, ...]:
    """Run the loop until it ends or cannot continue; either is an outcome of each member, not an error.

    At each sample: measure, compute, and hold the forces (`actuators.delay` samples later). At each plant step: apply
    changes, advance the drives, call the observer, step the plant. Members that have ended stay frozen while the others
    continue.

    Raises
    ------
    ControllerError
        The controller of a plant of one platform gave no forces at its first sample, otherwise an outcome; or wrong
        loop shape; or a factory gave two members the same controller.
    PlantError
        The plant refuses a request before the first row; later this ends the run.
    KeyboardInterrupt
        The run was interrupted before the first row, or is not to be kept.
    """
    shape: tuple[int, ...] = getattr(plant, "shape", ())
    if loop.shape not in ((), shape):
        raise ControllerError(f"a loop of shape {loop.shape} with a plant of shape {shape}; expected the same shape")
    if law_from is not None and loop.reference is None:
        raise ControllerError("a controller without a reference; expected the reference signals for it to follow")
    several, reference = plant if shape else PlantOfOne(plant), loop.reference
    monitor = RowMonitor(loop, several, observer)
    try:
        # members that have ended may compute NaN, which is not used; in a run of one, warnings are of the user's code
        with np.errstate(all="ignore") if shape else np.errstate(over="ignore"):
            # the controllers, at the first sample
            changes = ScheduledChanges(loop, several)
            changes.apply(0)
            host, law = LoopHost(several, loop), None
            if law_from is not None and reference is not None:
                law = law_from(reference[0], host.reading)
                for member, error in law.failures.items():
                    monitor.end(member, 0, "stopped", str(error))
                if isinstance(monitor.rows, AllRows):
                    monitor.rows.used = law.used
                    monitor.rows.state = np.zeros((len(monitor.rows.measured), *law.state.shape))
            # functions of CasADi in machine code, if they have the same operations
            traced = compiled_together(law.traced) if isinstance(law, SeparateLaws) and law.traced is not None else None
            host.control(traced or law)
            host.run(monitor, changes, progress, threads)
    except (StepError, ControllerError, PlantError) as error:
        if not monitor.n_rows:
            raise
        monitor.end(slice(None), monitor.n_rows, "diverged" if isinstance(error, StepError) else "stopped", str(error))
    except KeyboardInterrupt:
        if not monitor.n_rows or not keeps_interrupted:
            raise
        monitor.end(slice(None), monitor.n_rows, "interrupted", "stopped by the user")
    monitor.pass_on()
    completed = Outcome("completed", float(loop.timing.times[-1]), None)
    return tuple(monitor.outcomes.get(member, completed) for member in range(len(monitor.going)))


@dataclass(frozen=True)
class Run:
    """The history of a run of one member up to its end, by row; the controller's by sample."""

    time: FloatArray  # (n,)
    results: FloatArray  # (n, N_RESULTS)
    inputs: FloatArray  # (n, 12)
    rate_limited: BoolArray  # (n, 6)
    stroke_exceeded: BoolArray  # (n, 6)
    sample_of_row: NDArray[np.intp]  # (n,), the last sample at or before each row
    measured: FloatArray  # (m, 24); of many members only the signals that controllers use
    command: FloatArray  # (m, 6), before limits
    controller_state: FloatArray  # (m, n_states), before the command was computed
    force_limited: BoolArray  # (m, 6)
    outcome: Outcome
    used: tuple[str, ...]  # the measured signals that controllers use
    host: str  # what ran the loop, see `RowBlock`


def simulate(plant: Plant, law_from: LawFrom | None, loop: Loop, progress: TimeProgress | None = None) -> list[Run]:
    """`observe` with the complete history of each member."""
    rows, timing = AllRows(), loop.timing
    outcomes = observe(plant, law_from, loop, rows, progress)
    exceeded = loop.limits.beyond_stroke(np.moveaxis(rows.results[1:, LENGTHS], 1, 2))
    runs, sample_of_row = list[Run](), np.broadcast_to(timing.sample_of_row.T, (len(outcomes), timing.steps + 1))
    for k, outcome in enumerate(outcomes):
        # one row, at rest, of a member of many that never had a controller
        n = min(max(int(rows.counting[k]), 1), int(rows.counting.max()))
        history = Run(
            time=timing.times[:n],
            results=np.ascontiguousarray(rows.results[1 : n + 1, :, k]),
            inputs=rows.inputs[1 : n + 1, :, k],
            rate_limited=rows.rate_limited[1 : n + 1, :, k],
            stroke_exceeded=exceeded[:n, k],
            sample_of_row=sample_of_row[k, :n],
            measured=rows.measured[:, :, k],
            command=rows.command[:, :, k],
            controller_state=rows.state[:, :, k],
            force_limited=rows.limited[:, :, k],
            outcome=outcome,
            used=rows.used,
            host=rows.host,
        )
        runs.append(history)
    return runs
