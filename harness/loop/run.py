"""Runs of the sampled loop: a controller in discrete time around the plant, as it would run on the machine.

A run has N members, N >= 1, which run in parallel; arrays have a leading member axis.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.laws_of_members import Law, LawFrom, LinearLaw, SeparateLaws
from gough_stewart.harness.errors import ControllerError, PlantError
from gough_stewart.harness.loop.compiled_host import CompiledHost
from gough_stewart.harness.loop.libraries import CompiledLaw, compiled_together
from gough_stewart.harness.loop.loop import LENGTHS, Loop, ScheduledChanges, Timing
from gough_stewart.harness.loop.python_host import SensorReadings, run_in_python
from gough_stewart.harness.loop.rows import AllRows, Observer, Outcome, RowMonitor
from gough_stewart.harness.plants.lanes import BatchPlant
from gough_stewart.harness.plants.plant import BoolArray, Plant, PlantOfOne, seen
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
            readings = SensorReadings(loop, len(monitor.going), changes.faults)
            reading = readings.read(0, seen(several, loop.sensors.side))
            law: Law | None = None
            if law_from is not None and reference is not None:
                law = law_from(reference[0], reading)
                if isinstance(monitor.rows, AllRows):
                    monitor.rows.used = law.used
                    monitor.rows.state = np.zeros((len(monitor.rows.measured), *law.state.T.shape))

            # in machine code if they and the plant can, else in Python; for it linear controllers are data
            lanes = several if isinstance(several, BatchPlant) and several.loop_run is not None else None
            form: LinearLaw | CompiledLaw | None = law if isinstance(law, LinearLaw) else None
            if lanes is not None and isinstance(law, SeparateLaws) and law.traced is not None:
                form = compiled_together(law.traced)
            if lanes is not None and (law is None or form is not None):
                for member, error in ({} if law is None else law.failures).items():
                    monitor.end(member, 0, "stopped", str(error))
                CompiledHost(lanes, form, loop, reading).run(monitor, changes, progress, threads)
            else:
                run_in_python(several, law, loop, readings, monitor, changes, progress)
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
    """The history of a run up to its end, by row; the controller's by sample.

    With many members, arrays have the member axis after that of time, such as (n, N, 12). After a member has ended,
    its rows repeat the last state.
    """

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
    outcomes: tuple[Outcome, ...]  # one per member
    used: tuple[str, ...] = ()  # the measured signals that controllers use
    host: str = "Python"  # what ran the loop, see `RowBlock`

    def of_member(self, member: int) -> "Run":
        """The history of one of many members, up to its end."""
        outcome = self.outcomes[member]
        # half a row later than its end, since times are rounded
        rows = np.searchsorted(self.time, outcome.time + (self.time[1] if len(self.time) > 1 else 1.0) / 2)
        samples = self.sample_of_row if self.sample_of_row.ndim == 1 else self.sample_of_row[:, member]
        by_row = {name: getattr(self, name)[:rows, member] for name in ("inputs", "rate_limited", "stroke_exceeded")}
        of_samples = ("measured", "command", "controller_state", "force_limited")
        return replace(
            self,
            time=self.time[:rows],
            results=np.ascontiguousarray(self.results[:rows, member]),
            sample_of_row=samples[:rows],
            outcomes=(outcome,),
            **by_row,
            **{name: getattr(self, name)[:, member] for name in of_samples},
        )


def simulate(plant: Plant, law_from: LawFrom | None, loop: Loop, progress: TimeProgress | None = None) -> Run:
    """`observe` with a complete history."""
    rows = AllRows()
    outcomes = observe(plant, law_from, loop, rows, progress)
    n = int(rows.counting.max())
    # members before elements
    results = np.moveaxis(rows.results[1 : n + 1], 1, 2)
    run = Run(
        time=loop.timing.times[:n],
        results=results,
        inputs=np.moveaxis(rows.inputs[1 : n + 1], 1, 2),
        rate_limited=np.moveaxis(rows.rate_limited[1 : n + 1], 1, 2),
        stroke_exceeded=loop.limits.beyond_stroke(results[..., LENGTHS]),
        sample_of_row=samples_of_rows(loop.timing)[:n],
        measured=np.moveaxis(rows.measured, 1, 2),
        command=np.moveaxis(rows.command, 1, 2),
        controller_state=np.moveaxis(rows.state, 1, 2),
        force_limited=np.moveaxis(rows.limited, 1, 2),
        outcomes=outcomes,
        used=rows.used,
        host=rows.host,
    )
    return run if getattr(plant, "shape", ()) else run.of_member(0)


def samples_of_rows(timing: Timing) -> NDArray[np.intp]:
    """The last sample at or before each row (n,), or (n, N) where members differ."""
    rows, all_rows = timing.rows_of_samples, np.arange(timing.steps + 1)
    if rows.ndim == 1:
        return np.searchsorted(rows, all_rows, side="right") - 1
    return np.stack([np.searchsorted(of_member, all_rows, side="right") - 1 for of_member in rows.T], axis=-1)
