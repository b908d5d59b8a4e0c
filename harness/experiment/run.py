"""Run an experiment: prepare it, open its plant, simulate the loop, keep the record."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from gough_stewart.harness.errors import ExperimentError, PlantError
from gough_stewart.harness.experiment.file import Settings, experiment_of
from gough_stewart.harness.experiment.parts import Injection
from gough_stewart.harness.experiment.preparation import Prepared, prepare
from gough_stewart.harness.experiment.recording import record_of
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.loop.run import simulate
from gough_stewart.harness.plants.kinds import PlantKind
from gough_stewart.harness.plants.open import open_plant
from gough_stewart.harness.plants.plant import Plant
from gough_stewart.harness.results.record import Record
from gough_stewart.model.progress import StepProgress, TimeProgress


def run(
    experiment: Experiment | Path | str,
    settings: Settings = (),
    *,
    plant: PlantKind | Plant | None = None,
    fmu: Path | str | None = None,
    controller: Any = None,
    injection: Injection | None = None,
    member: int | None = None,
    progress: TimeProgress | None = None,
    status: StepProgress | None = None,
    warn: Callable[[str], None] | None = None,
) -> Record:
    """Run an experiment; a loop that diverges or is interrupted leaves a record that says so in its outcome.

    Parameters
    ----------
    experiment
        A TOML file, the name of a shipped experiment, or an `Experiment`.
    settings
        Keys of the experiment to set anew, as `load_experiment` takes them.
    plant, fmu
        In the place of the experiment's: "model", "fmu2" or "fmu3", and the file of an FMU, built if there is none; or
        an object that keeps the rules of `Plant`, in its start state. Whoever gives an object closes it.
    controller
        In the place of the experiment's: a discrete python-control system, a `LinearController`, or a function of a
        `Sample` that gives six forces [N], beside which feedforward stays as it is; or the path of an FMU, as
        `gough-stewart export` makes them, which has its reference and feedforward inside.
    injection
        In the place of the experiment's: a function of the time of a sample [s] that gives six forces [N], added to
        the command to excite the loop.
    member
        The number of a member of the experiment's `[ensemble]`, which is run with the very numbers that it has there;
        with a plant, its machine is simulated by that.
    progress
        Called with the time [s] of the run.
    status
        Called with what is being done before, while an FMU is built.
    warn
        Called before the run with every limit that the reference passes and, by `limits.reference = "warn"`, may; the
        record's metadata have the same as `warnings`.

    Raises
    ------
    ExperimentError, ReachError
        The experiment cannot be run as it is written, or its reference leads out of the platform's reach.
    PlantError, BuildError
        The plant cannot be had.

    Examples
    --------
    >>> record = gs.run("heave_step", {"loop.duration": 0.3, "controller.bandwidth": 3})
    >>> record["position"][-1], record["error.leg_length"].shape
    """
    chosen = experiment_of(experiment, settings)
    if member is not None:
        if controller is not None or injection is not None:
            raise ExperimentError(chosen.where, "member", "has its own controller; expected no other, and no injection")
        from gough_stewart.harness.experiment.member_records import member_of, records_of
        from gough_stewart.harness.experiment.plan import plan_of

        plan = plan_of(chosen)
        if plant is None and fmu is None:
            return records_of(plan, [member], progress)[0]
        own, prepared = member_of(plan, member)
        return run_prepared(own, prepared, plant=plant, fmu=fmu, progress=progress, status=status)
    prepared = prepare(chosen, controller, injection)
    if warn is not None:
        for text in prepared.warnings:
            warn(text)
    return run_prepared(chosen, prepared, plant=plant, fmu=fmu, progress=progress, status=status)


def run_prepared(
    experiment: Experiment,
    prepared: Prepared,
    *,
    plant: PlantKind | Plant | None = None,
    fmu: Path | str | None = None,
    progress: TimeProgress | None = None,
    status: StepProgress | None = None,
) -> Record:
    """`run` of an experiment that is prepared already."""
    choice = experiment.plant
    if plant is None or isinstance(plant, str):
        kind: PlantKind = plant or choice.kind
        name: str = kind
        if fmu is None and choice.fmu is not None and kind == choice.kind:
            fmu = experiment.folder / choice.fmu
        opening: AbstractContextManager[Plant] = open_plant(
            kind,
            prepared.machine,
            prepared.start,
            tolerance=choice.tolerance,
            fixed_step_size=choice.fixed_step_size,
            fmu=fmu,
            progress=status,
        )
    else:
        _check_plant(plant, fmu)
        name, opening = type(plant).__name__, nullcontext(plant)
    with opening as opened, prepared.law_in_a_run() as law_from:
        done = simulate(opened, law_from, prepared.loop, progress)
    circumstances = {"title": experiment.title, "plant": name, "experiment": experiment.model_dump(mode="json")}
    return record_of(done, prepared, circumstances)


def _check_plant(plant: object, fmu: object) -> None:
    """Refuse an object that is no plant, or a plant beside an FMU."""
    missing = [name for name in ("set_inputs", "set_parameters", "results", "do_step") if not hasattr(plant, name)]
    if missing:
        raise PlantError(
            f"plant is {plant!r}, without {', '.join(missing)}; expected 'model', 'fmu2', 'fmu3', or an object that "
            "keeps the rules of gough_stewart.harness.plants.plant.Plant"
        )
    if fmu is not None:
        raise PlantError(f"plant is {plant!r}, and fmu is {fmu!r}; expected one of both")
