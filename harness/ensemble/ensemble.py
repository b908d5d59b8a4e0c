"""Run an ensemble: chunks on cores or on a cluster, combined to a table of members, bands, and metadata."""

import errno
import json
import tempfile
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from dataclasses import replace
from math import ceil
from pathlib import Path
from typing import Any

from gough_stewart.harness.ensemble.assembly import BANDS, MEMBERS, METADATA, SAMPLES, assemble, read_ensemble
from gough_stewart.harness.ensemble.chunk import SIZE, check_names
from gough_stewart.harness.ensemble.chunk_files import FOLDER, ChunkBytes, ChunkFiles
from gough_stewart.harness.ensemble.cluster import chunks_there
from gough_stewart.harness.ensemble.exact_versions import difference, exact_versions
from gough_stewart.harness.ensemble.local import Range, Workers, chunks_here, cores, processes_for
from gough_stewart.harness.ensemble.result import Ensemble
from gough_stewart.harness.errors import EnsembleError
from gough_stewart.harness.experiment.file import experiment_of
from gough_stewart.harness.experiment.overrides import Settings
from gough_stewart.harness.experiment.plan import EnsemblePlan, plan_from, plan_of
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.model.errors import OutputError
from gough_stewart.model.process.files import check_output_folder, remove_leftovers, reserved, write_whole
from gough_stewart.model.process.progress import StepProgress

PLAN = "plan.json"
# Called with the number of finished members, and the total.
MembersProgress = Callable[[int, int], None]


def ensemble(
    experiment: Experiment | Path | str,
    settings: Settings = (),
    *,
    controller: Any = None,
    members: int | None = None,
    seed: int | None = None,
    out: Path | str | None = None,
    resume: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: MembersProgress | None = None,
    status: StepProgress | None = None,
) -> Ensemble:
    """Run the members of an experiment's `[ensemble]`; member k has the same numbers for any count and on any machine.

    Parameters
    ----------
    experiment
        A TOML file, the name of a shipped experiment, or an `Experiment`.
    settings
        Keys of the experiment to change, as in `load_experiment`.
    controller
        Replaces the experiment's, as in `run`: each member gets a fresh one, called once at each of its samples. A
        function, which all members share, must have no memory. Workers in other processes get it as a pickle.
    members, seed
        Replace the experiment's.
    out
        A folder for members.parquet, bands.parquet, samples.parquet and ensemble.json, and for finished chunks during
        the run; by default nothing is kept.
    resume
        Continue an interrupted run in that folder.
    workers
        Processes on this machine; by default threads, or processes where these save time, one per core.
    scheduler
        The address of a dask.distributed scheduler, whose workers compute instead of processes here.
    progress
        Called with the number of finished members, and the total.
    status
        Called with the present action before the run.

    Returns
    -------
    Ensemble
        `members`, a row of metrics for each member, in their order; `bands`, quantiles over time; `metadata`.

    Raises
    ------
    ExperimentError
        The variation does not match the experiment.
    ControllerError
        A controller that cannot be copied, pickled for workers or made with its parameters, or a function with memory.
    EnsembleError
        A folder with results of another experiment, a scheduler that does not answer, workers with other versions.
    OutputError, OSError
        The files cannot be written; finished chunks are kept.

    Examples
    --------
    >>> found = gs.ensemble("heave_tolerances", {"loop.duration": 0.1}, members=16, workers=1)
    >>> found.members["outcome"].value_counts(), found.values("tracking.position.norm_peak").max()
    """
    chosen = _with(experiment_of(experiment, settings), members, seed)
    if workers is not None and workers < 1:
        raise EnsembleError(f"workers is {workers}; expected at least 1")
    if out is None:
        with tempfile.TemporaryDirectory(prefix="gough-stewart-") as folder:
            return _run(chosen, controller, Path(folder), False, workers, scheduler, progress, status)
    with reserved(Path(out)):
        check_output_folder(Path(out), (MEMBERS, BANDS, SAMPLES, METADATA, PLAN))
        remove_leftovers(ChunkFiles(Path(out)).folder)
        return _run(chosen, controller, Path(out), resume, workers, scheduler, progress, status)


def _with(experiment: Experiment, members: int | None, seed: int | None) -> Experiment:
    found = {"ensemble.members": members, "ensemble.seed": seed}
    return experiment_of(experiment, {key: value for key, value in found.items() if value is not None})


def _run(
    experiment: Experiment,
    controller: Any,
    folder: Path,
    resume: bool,
    workers: int | None,
    scheduler: str | None,
    progress: MembersProgress | None,
    status: StepProgress | None,
) -> Ensemble:
    say = status or (lambda _: None)
    say("planning")
    with _begun_workers(experiment, controller, resume, workers, scheduler) as begun:
        return _computed(experiment, controller, folder, resume, begun, scheduler, progress, say)


def _begun_workers(
    experiment: Experiment, controller: Any, resume: bool, workers: int | None, scheduler: str | None
) -> AbstractContextManager[Workers | int]:
    """Processes that import while the run is planned; only their number where it may turn out that none is needed."""
    number, members = workers or cores(), experiment.ensemble.members if experiment.ensemble else None
    chunks = ceil((members or 0) / SIZE)
    useful = min(workers, chunks) if workers else processes_for(chunks, number, experiment, controller)
    return nullcontext(number) if resume or scheduler is not None or useful < 2 else Workers(useful)


def _computed(
    experiment: Experiment,
    controller: Any,
    folder: Path,
    resume: bool,
    workers: Workers | int,
    scheduler: str | None,
    progress: MembersProgress | None,
    say: StepProgress,
) -> Ensemble:
    files = ChunkFiles(folder)
    plan = _planned(experiment, controller, folder, files, resume)
    if plan is None:
        return read_ensemble(folder)
    ranges = [(k, min(k + SIZE, plan.members)) for k in range(0, plan.members, SIZE)]
    say("checking finished chunks" if resume else "running")
    features = {each: files.features(each[0]) for each in ranges} if resume else {}
    left = [each for each in ranges if features.get(each) is None]
    done = plan.members - sum(last - first for first, last in left)
    say("running")
    with _kept(folder, files):
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / PLAN, json.dumps({"plan": plan.text, "made_with": exact_versions()}, indent=1).encode())
        with closing(_source(plan, left, workers, scheduler)) as source:
            for (first, last), content in source:
                files.write(first, content)
                features[first, last] = content.features
                done += last - first
                if progress is not None:
                    progress(done, plan.members)
        say("tables")
        found = assemble(plan, files, ranges, sorted({each for each in features.values() if each}), folder)
    files.remove()
    (folder / PLAN).unlink(missing_ok=True)
    return found


def _source(
    plan: EnsemblePlan, left: Sequence[Range], workers: Workers | int, scheduler: str | None
) -> Generator[tuple[Range, ChunkBytes], None, None]:
    if not left:
        return
    if scheduler is None:
        yield from chunks_here(plan, left, workers)
    else:
        yield from chunks_there(plan, left, scheduler)


def _planned(
    experiment: Experiment, controller: Any, folder: Path, files: ChunkFiles, resume: bool
) -> EnsemblePlan | None:
    """The plan of this run, continuing the one in the folder if there is one; None if that is complete.

    Raises
    ------
    EnsembleError
        The folder has another experiment, or an unfinished one that would be lost.
    """
    begun = _begun(folder)
    if not resume:
        if begun is not None and files.count():
            raise EnsembleError(
                f"{folder} has finished chunks of an incomplete ensemble; continue it with --resume, or remove "
                f"{folder / FOLDER}, or choose another --out"
            )
        return _new_plan(experiment, controller)
    requested = plan_of(experiment, controller)
    if begun is None:
        return _new_plan(experiment, controller)
    plan, versions, is_finished = begun
    if requested.hash != plan.hash:
        found = list(_different(requested.decisive, plan.decisive, ""))
        # without values that also appear in the experiment
        differs = [each for each in found if not any(other.endswith(f".{each}") for other in found)]
        raise EnsembleError(
            f"{folder} has results of another experiment: {'; '.join(differs[:3])}; choose another --out, or omit "
            "--resume"
        )
    if others := difference(exact_versions(), versions):
        raise EnsembleError(f"{folder} has results of other versions: {others}; omit --resume")
    return None if is_finished else replace(plan, given=requested.given)


def _new_plan(experiment: Experiment, controller: Any) -> EnsemblePlan:
    plan = plan_of(experiment, controller)
    plan.prepared.possible()
    check_names(plan)
    return plan


def _begun(folder: Path) -> tuple[EnsemblePlan, dict[str, str], bool] | None:
    """The plan of a folder's results, the versions that made them, and whether they are complete."""
    for name in (PLAN, METADATA):
        try:
            found = json.loads((folder / name).read_bytes())
            return plan_from(found["plan"]), dict(found["made_with"]), name == METADATA
        except FileNotFoundError:
            continue
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise EnsembleError(f"{folder / name} is not the plan of an ensemble: {error}; remove it") from error
    return None


def _different(here: Any, there: Any, at: str) -> Iterator[str]:
    """The differences between two trees of plain values."""
    if isinstance(here, dict) and isinstance(there, dict):
        for key in sorted({*here, *there}):
            yield from _different(
                here.get(key), there.get(key), f"{at}.{key}".removeprefix(".").removeprefix("experiment.")
            )
    elif here != there:
        yield f"{at} is {here!r} here and {there!r} there"


def _finished(n: int) -> str:
    return "1 finished chunk is" if n == 1 else f"{n} finished chunks are"


@contextmanager
def _kept(folder: Path, files: ChunkFiles) -> Iterator[None]:
    """Add to an error that finished chunks are kept, and how to continue."""
    try:
        yield
    except BaseException as error:
        n = files.count()
        if n:
            error.add_note(f"{_finished(n)} kept in {folder}; continue with --resume")
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise OutputError(
                f"{error.filename or folder}: no space left on the disk; {_finished(n)} kept in {folder}: "
                "free some space, then continue with --resume"
            ) from error
        raise
