"""The benefit of an identification: an experiment with the nominal and with the identified platform, compared."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gough_stewart.harness.control.laws import linear_of
from gough_stewart.harness.errors import UnstableLoopError
from gough_stewart.harness.experiment.file import experiment_of
from gough_stewart.harness.experiment.margins import judged
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.experiment.run import run
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.report.document import Number
from gough_stewart.harness.report.quantities import ANGLE, DECIBEL, FORCE, FREQUENCY, NOTHING, NUMBER, Quantity
from gough_stewart.harness.report.table import Cell, Column, Table, Value
from gough_stewart.harness.report.terminal import tables_text
from gough_stewart.harness.results.metrics import metrics
from gough_stewart.harness.results.record import Record, plain
from gough_stewart.harness.results.run_report import run_numbers
from gough_stewart.model.parameters import TABLE
from gough_stewart.model.platform import Platform

# The errors after an identification are below a micrometre.
_MICROMETRE = Quantity("m", "µm", 1e6)
# Errors and feedback of a run, and margins of the loop with the machine, with their units.
_MEASURES = {
    "position error, RMS": _MICROMETRE,
    "position error, peak": _MICROMETRE,
    "orientation error, RMS": ANGLE,
    "leg length error, RMS": _MICROMETRE,
    "feedback's share of the force, RMS": FORCE,
}
_MARGINS = {
    "disk margin α": replace(NUMBER, digits=3),
    "gain of each leg, up or down": DECIBEL,
    "phase of each leg, either way": ANGLE,
    "crossover": FREQUENCY,
}


@dataclass(frozen=True, eq=False, repr=False)
class Compared:
    """An experiment before and after: the machine is the same, the nominal model changes."""

    before: Record
    after: Record
    experiments: tuple[Experiment, Experiment]

    def __repr__(self) -> str:
        """The table, as text."""
        return tables_text([self.table])

    @property
    def numbers(self) -> tuple[Number, ...]:
        """The metrics of the run after the identification."""
        return run_numbers(metrics(self.after))

    @property
    def table(self) -> Table:
        """Errors, feedback and margins side by side."""
        errors = [_errors(record) for record in (self.before, self.after)]
        margins = [_margins(experiment) for experiment in self.experiments]
        rows: list[tuple[Cell, ...]] = [
            (name, *(Value(values[name], quantity) for values in errors)) for name, quantity in _MEASURES.items()
        ]
        for name, quantity in _MARGINS.items():
            rows.append((name, *(m if isinstance(m, str) else Value(m[name], quantity) for m in margins)))
        title = f"{self.experiments[0].title}: before and after"
        return Table(title, (Column(""), Column("before"), Column("after")), tuple(rows))


def before_and_after(experiment: Experiment | Path | str, nominal: Platform, found: Platform) -> Compared:
    """Run an experiment designed with the nominal platform, then designed with the identified one.

    The machine is the same in both: `[plant]` of the experiment with the nominal platform. Margins are those of the
    real loop: the controller from each design, with the linear model of the machine.

    Parameters
    ----------
    experiment
        A TOML file, the name of a shipped experiment, or an `Experiment`.
    nominal, found
        The nominal and the identified platform.

    Returns
    -------
    Compared
        `before` and `after`, the records of both runs, and their `experiments`; displays errors, feedback forces and
        margins side by side.

    Raises
    ------
    ExperimentError, ReachError
        As `run`.

    See Also
    --------
    identify, run, margins

    Examples
    --------
    >>> nominal = gs.load_preset("liu2000")
    >>> from dataclasses import replace
    >>> heavier = replace(nominal, platform_mass=14.0)
    >>> experiment = gs.load_experiment("heave_step", {"loop.duration": 0.3, "plant.parameters.platform_mass": 14.0})
    >>> gs.before_and_after(experiment, nominal, heavier).after["position"].shape
    (301, 3)
    """
    chosen = experiment_of(experiment)

    def designed(**platforms: Platform) -> Experiment:
        """The experiment with these platforms as nominal model and as machine."""
        numbers = {
            f"{key}.parameters": {name: value for name, value in plain(platform).items() if name in TABLE}
            for key, platform in platforms.items()
        }
        return experiment_of(chosen, numbers)

    machine = prepare(designed(platform=nominal)).machine
    before, after = (designed(platform=platform, plant=machine) for platform in (nominal, found))
    return Compared(run(before), run(after), (before, after))


def _errors(record: Record) -> dict[str, float]:
    """Errors and feedback of a run, by their names."""
    position, feedback = record["error.position"], record["controller.force"] - record["controller.feedforward"]

    def rms(values: np.ndarray) -> float:
        return float(np.sqrt((values**2).sum(axis=1).mean()))

    peak = float(np.linalg.norm(position, axis=1).max())
    turned, lengths = rms(record["error.orientation"]), rms(record["error.leg_length"])
    return dict(zip(_MEASURES, (rms(position), peak, turned, lengths, rms(feedback)), strict=True))


def _margins(experiment: Experiment) -> dict[str, float] | str:
    """The margins by their names; in words if there are none."""
    prepared = prepare(experiment)
    controller = linear_of(prepared.controller)
    if controller is None:
        return NOTHING
    try:
        loop = judged(prepared, prepared.machine, controller)
    except UnstableLoopError:
        return "unstable"
    if loop.doubt:
        return "inconclusive"
    disk, crossover = loop.margins.disk, max(leg.crossover for leg in loop.margins.legs)
    # the two gains of a disk margin are inverse to each other
    numbers = (disk.alpha, float(20 * np.log10(disk.gain[1])), float(disk.phase), crossover)
    return dict(zip(_MARGINS, numbers, strict=True))
