"""Run an experiment: prepare it, open its plant, simulate the loop, keep the record."""

from pathlib import Path
from typing import Any

from gough_stewart.harness.experiment.file import Settings, experiment_of
from gough_stewart.harness.experiment.preparation import Prepared, prepare
from gough_stewart.harness.experiment.recording import record_of
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.loop.loop import simulate
from gough_stewart.harness.plants.kinds import PlantKind
from gough_stewart.harness.plants.open import open_plant
from gough_stewart.harness.results.record import Record
from gough_stewart.model.progress import StepProgress, TimeProgress


def run(
    experiment: Experiment | Path | str,
    settings: Settings = (),
    *,
    plant: PlantKind | None = None,
    fmu: Path | str | None = None,
    controller: Any = None,
    progress: TimeProgress | None = None,
    told: StepProgress | None = None,
) -> Record:
    """Run an experiment; a loop that diverges or is interrupted leaves a record that says so in its outcome.

    Parameters
    ----------
    experiment
        A TOML file, the name of a shipped experiment, or an `Experiment`.
    settings
        Keys of the experiment to set anew, as `load_experiment` takes them.
    plant, fmu
        In the place of the experiment's: "model", "fmu2" or "fmu3", and the file of an FMU; built if there is none.
    controller
        In the place of the experiment's: a discrete python-control system, a `LinearController`, or a function of a
        `Sample` that gives six forces [N]. Feedforward stays as it is.
    progress
        Called with the time [s] of the run.
    told
        Called with what is being done before, while an FMU is built.

    Raises
    ------
    ExperimentError, ReachError
        The experiment cannot be run as it is written, or its reference leads out of the platform's reach.
    PlantError, BuildError
        The plant cannot be had.

    Examples
    --------
    >>> record = gs.run("heave_step", {"loop.duration": 1}, plant="fmu3")
    >>> record["position"][-1], record["error.leg_length"].shape
    """
    chosen = experiment_of(experiment, settings)
    return run_prepared(chosen, prepare(chosen, controller), plant=plant, fmu=fmu, progress=progress, told=told)


def run_prepared(
    experiment: Experiment,
    prepared: Prepared,
    *,
    plant: PlantKind | None = None,
    fmu: Path | str | None = None,
    progress: TimeProgress | None = None,
    told: StepProgress | None = None,
) -> Record:
    """`run` of an experiment that is prepared already."""
    choice = experiment.plant
    kind = plant or choice.kind
    if fmu is None and choice.fmu is not None and plant in (None, choice.kind):
        fmu = experiment.folder / choice.fmu
    with open_plant(
        kind,
        prepared.platform,
        prepared.start,
        tolerance=choice.tolerance,
        fixed_step_size=choice.fixed_step_size,
        fmu=fmu,
        progress=told,
    ) as opened:
        done = simulate(opened, None if prepared.controller is None else prepared.law, prepared.loop, progress)
    circumstances = {"title": experiment.title, "plant": kind, "experiment": experiment.model_dump(mode="json")}
    return record_of(done, prepared, circumstances)
