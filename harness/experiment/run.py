"""Run an experiment: prepare it, open its plant, simulate the loop, make the record."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from types import FunctionType
from typing import Any, get_args

from gough_stewart.harness.control.python.makers import name_of
from gough_stewart.harness.errors import ExperimentError, PlantError
from gough_stewart.harness.experiment.analysis import growing_of
from gough_stewart.harness.experiment.batch import Prepared
from gough_stewart.harness.experiment.file import Settings, experiment_of
from gough_stewart.harness.experiment.fingerprint import fingerprint
from gough_stewart.harness.experiment.named_files import digests
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.experiment.recording import member_of, record_of, records_of
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.experiment.stages import Injection
from gough_stewart.harness.loop.run import simulate
from gough_stewart.harness.plants.kinds import PlantKind
from gough_stewart.harness.plants.lanes import lanes_plant
from gough_stewart.harness.plants.open import open_plant
from gough_stewart.harness.plants.plant import Plant
from gough_stewart.harness.results.record import Record
from gough_stewart.model.process.progress import StepProgress, TimeProgress


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
    """Run an experiment; if the loop diverges or is interrupted, the record's outcome states it.

    Parameters
    ----------
    experiment
        A TOML file, the name of a shipped experiment, or an `Experiment`.
    settings
        Keys of the experiment to change, as in `load_experiment`.
    plant, fmu
        Replace the experiment's: "model" (compiled), "scipy" (the judge of it), "fmu2" or "fmu3", and an FMU file,
        built if missing; or an object that follows the rules of `Plant`, in its start state, which the caller closes.
    controller
        Replaces the experiment's, with the feedforward unchanged: a discrete python-control system, a
        `LinearController`, a function of a `Sample` that returns six forces [N], or one with memory: a class or
        factory, called as `make(platform, sample_time, **parameters)` with the nominal model and the experiment's
        `[controller.parameters]`, or an object, which is copied. Or the path of an FMU, as made by
        `gough-stewart export`, which contains its reference and feedforward.
    injection
        Replaces the experiment's: a function from the time of a sample [s] to six forces [N] that are added to the
        command to excite the loop.
    member
        The number of a member of the experiment's `[ensemble]`, which runs with the same numbers as there; with a
        plant, that plant simulates its machine.
    progress
        Called with the time [s] of the run.
    status
        Called with the present action before the run, for example while an FMU is built.
    warn
        Called before the run for every limit that the reference exceeds with `limits.reference = "warn"`, and with a
        loop that is unstable in the linear model, which may grow too slowly for the run to show; after it for remarks
        of an FMU, and if a function that is the controller keeps memory, with which another run would go on; the
        record's metadata have the same as `warnings`.

    Returns
    -------
    Record
        A row at the start and after each plant step, with all variables, references, errors, measurements and forces in
        SI units; `metadata["outcome"]` tells how the run ended.

    Raises
    ------
    ExperimentError, ReachError
        The experiment cannot run as written, or its reference is out of the platform's reach.
    PlantError, BuildError
        The plant is not available.

    Examples
    --------
    >>> record = gs.run("heave_step", {"loop.duration": 0.3, "controller.bandwidth": 3})
    >>> record["position"][-1], record["error.leg_length"].shape
    """
    chosen = experiment_of(experiment, settings)
    replaced = [name for name, given in (("controller", controller), ("injection", injection)) if given is not None]
    before = fingerprint(controller) if isinstance(controller, FunctionType) else ""
    if member is None:
        own, prepared = chosen, prepare(chosen, controller, injection)
    elif injection is not None:
        raise ExperimentError(chosen.where, "member", "has the experiment's injection; remove injection")
    else:
        from gough_stewart.harness.experiment.plan import plan_of

        plan = plan_of(chosen, controller)
        own, prepared = member_of(plan, member)
    growing = growing_of(prepared)
    said_before = (*prepared.warnings, *growing)
    if warn is not None:
        for text in said_before:
            warn(text)
    if member is not None and plant is None and fmu is None:
        record = records_of(plan, [member], progress)[0]
    else:
        record = run_prepared(own, prepared, plant=plant, fmu=fmu, progress=progress, status=status, replaced=replaced)
    if growing:
        record.metadata.setdefault("warnings", []).extend(growing)
    if before and fingerprint(controller) != before:
        text = (
            f"the function {name_of(controller)} keeps memory, which the run has changed, and another run goes on from "
            "there; use a class or factory"
        )
        record.metadata.setdefault("warnings", []).append(text)
    if warn is not None:
        for text in record.metadata.get("warnings", []):
            if text not in said_before:
                warn(text)
    return record


def run_prepared(
    experiment: Experiment,
    prepared: Prepared,
    *,
    plant: PlantKind | Plant | None = None,
    fmu: Path | str | None = None,
    progress: TimeProgress | None = None,
    status: StepProgress | None = None,
    replaced: Sequence[str] = (),
) -> Record:
    """`run` for an experiment that is already prepared, with some of its tables replaced by objects."""
    choice = experiment.plant
    if plant is None or isinstance(plant, str):
        kind: PlantKind = plant or choice.kind
        name: str = kind
        if (own := choice.own_unit(plant, fmu)) is not None:
            fmu = experiment.folder / own
        opening: AbstractContextManager[Plant]
        # a chain that is compiled whole runs with its plant; one that calls back into Python steps the plant from here
        is_whole = kind == "model" and fmu is None and not choice.fixed_step_size
        if is_whole and (kernel := prepared.kernel) is not None:
            opening = lanes_plant([prepared.machine], [prepared.start], tolerance=choice.tolerance, kernel=kernel)
        else:
            opening = open_plant(
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
        done = done.of_member(0) if getattr(opened, "shape", ()) else done
        remarks = opened.remarks() if hasattr(opened, "remarks") else ""
    circumstances: dict[str, Any] = {
        "title": experiment.title,
        "plant": name,
        "experiment": experiment.model_dump(mode="json"),
    }
    if experiment.changed:
        circumstances["settings"] = experiment.changed
    if files := digests(experiment):
        circumstances["files"] = files
    if replaced:
        circumstances["replaced"] = list(replaced)
    record = record_of(done, prepared, circumstances)
    if remarks:
        record.metadata.setdefault("warnings", []).append(remarks)
    return record


def _check_plant(plant: object, fmu: object) -> None:
    """Refuse an object that is not a plant, or a plant object together with an FMU."""
    missing = [name for name in ("set_inputs", "set_parameters", "results", "do_step") if not hasattr(plant, name)]
    if missing:
        raise PlantError(
            f"plant is {plant!r}, without {', '.join(missing)}; expected {', '.join(map(repr, get_args(PlantKind)))}, "
            "or an object that follows the rules of gough_stewart.harness.plants.plant.Plant"
        )
    if fmu is not None:
        raise PlantError(f"plant is {plant!r}, and fmu is {fmu!r}; expected only one of them")
