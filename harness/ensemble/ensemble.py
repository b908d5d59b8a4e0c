"""Run an ensemble: chunks on cores or on a cluster, combined to a table of members, bands, and metadata."""

import errno
import hashlib
import json
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from functools import partial
from io import BytesIO
from math import ceil
from pathlib import Path
from typing import Any
from zipfile import BadZipFile
from zlib import crc32

import numpy as np
import polars

from gough_stewart.harness.ensemble.chunk import SIZE, results_of_nobody
from gough_stewart.harness.ensemble.ensemble_report import Ensemble, read_ensemble
from gough_stewart.harness.ensemble.member_table import BANDS, MEMBERS, METADATA, SAMPLES, SHORT
from gough_stewart.harness.ensemble.workers import (
    Workers,
    chunks_here,
    chunks_there,
    cores,
    difference,
    exact_versions,
    processes_for,
)
from gough_stewart.harness.errors import EnsembleError, ExperimentError, RecordError
from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.experiment.members import Members, decisive, varying_members
from gough_stewart.harness.experiment.overrides import Settings
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.report.quantities import fineness_of
from gough_stewart.harness.results.bands import MOST_KEPT, BandSamples, band_tables
from gough_stewart.harness.table_file import scan_parquet, write_to
from gough_stewart.model.errors import ArgumentError, OutputError
from gough_stewart.model.interface import nearest
from gough_stewart.model.process.files import check_output_folder, reserved, write_whole
from gough_stewart.model.process.installed import versions
from gough_stewart.model.process.progress import StepProgress

PLAN, CHUNKS = "plan.json", "chunks"
_ROWS_A_GROUP = 65_536
_MOST_CAUSES = 50
# Called with the number of finished members, and the total.
MembersProgress = Callable[[int, int], None]


def ensemble(  # noqa: PLR0912, PLR0915 - one road, in sections
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
    """Run the members of an experiment's `[ensemble]`; member k is the same for any number of members, on any computer.

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
        the run; by default nothing is written.
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
    ArgumentError
        `resume` without the folder `out`.
    ExperimentError
        The variation does not match the experiment.
    ControllerError
        A controller that cannot be copied, pickled for workers or made with its parameters, or a function with memory.
    EnsembleError
        A folder with results of another experiment, a scheduler that does not answer, workers with other versions.
    OutputError, OSError
        The files cannot be written; finished chunks are kept.

    See Also
    --------
    run, tune, read_ensemble

    Examples
    --------
    >>> results = gs.ensemble("heave_tolerances", {"loop.duration": 0.1}, members=16, workers=1)
    >>> results.members["outcome"].value_counts(), results.values("tracking.position.norm_peak").max()
    """
    numbers = {"ensemble.members": members, "ensemble.seed": seed}
    nominal = load_experiment(experiment, settings)
    nominal = load_experiment(nominal, {key: value for key, value in numbers.items() if value is not None})
    if workers is not None and workers < 1:
        raise EnsembleError(f"workers is {workers}; expected at least 1")
    if resume and out is None:
        raise ArgumentError("resume is True and out is None; expected the interrupted run's folder: give it as out")
    say = status or (lambda _: None)
    with ExitStack() as stack:
        if out is None:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="gough-stewart-")))
        else:
            folder = Path(out)
            stack.enter_context(reserved(folder))
            check_output_folder(folder, (MEMBERS, BANDS, SAMPLES, METADATA, PLAN))
            check_output_folder(folder / CHUNKS, ())

        # processes import while this one plans; only their number where it may turn out that none is needed
        say("planning")
        number, asked = workers or cores(), nominal.ensemble.members if nominal.ensemble else None
        chunks = ceil((asked or 0) / SIZE)
        useful = min(workers, chunks) if workers else processes_for(chunks, number, nominal, controller)
        alone = resume or scheduler is not None or useful < 2
        processes: Workers | int = number if alone else stack.enter_context(closing(Workers(useful)))

        # the folder may have members already, to go on with or to be kept: their plan, versions, whether all are there
        begun: tuple[dict[str, Any], dict[str, str], bool] | None = None
        for name in (PLAN, METADATA):
            try:
                content = json.loads((folder / name).read_bytes())
                begun = decisive(json.loads(content["plan"])), dict(content["made_with"]), name == METADATA
                break
            except FileNotFoundError:
                continue
            except (OSError, ValueError, KeyError, TypeError) as error:
                raise EnsembleError(f"{folder / name} is not the plan of an ensemble: {error}; remove it") from error
        if not resume and begun is not None and any((folder / CHUNKS).glob("*.npz")):
            raise EnsembleError(
                f"{folder} has finished chunks of an incomplete ensemble; continue it with --resume, or remove "
                f"{folder / CHUNKS}, or choose another --out"
            )
        varying = varying_members(nominal, controller)
        if not resume or begun is None:
            varying.possible()
            # unknown names are refused before anything runs
            by = varying.choice.worst_by
            try:
                columns, _ = results_of_nobody(varying)
            except RecordError as error:
                raise ExperimentError(nominal.where, "ensemble.signals", str(error)) from None
            if by is not None and SHORT.get(by, by) not in columns:
                raise ExperimentError(nominal.where, "ensemble.worst_by", f"no metric '{by}'{nearest(by, columns)}")
        else:
            plan_there, made_with, is_finished = begun
            plan_here = json.loads(json.dumps(decisive(varying.plan)))
            if plan_here != plan_there:
                differences = list(_different(plan_here, plan_there, ""))
                # without values that also appear in the experiment
                differs = [text for text in differences if not any(other.endswith(f".{text}") for other in differences)]
                raise EnsembleError(
                    f"{folder} has results of another experiment: {'; '.join(differs[:3])}; choose another --out, or "
                    "omit --resume"
                )
            if differing := difference(exact_versions(), made_with):
                raise EnsembleError(f"{folder} has results of other versions: {differing}; omit --resume")
            if is_finished:
                return read_ensemble(folder)

        # a chunk from member k on has k.parquet, and k.npz, which is written last
        ranges = [(k, min(k + SIZE, varying.count)) for k in range(0, varying.count, SIZE)]
        files = {part: folder / CHUNKS / f"{part[0]:08d}.parquet" for part in ranges}
        say("checking finished chunks" if resume else "running")
        features = {part: _features(files[part]) for part in ranges} if resume else {}
        missing = [part for part in ranges if features.get(part) is None]
        finished = varying.count - sum(last - first for first, last in missing)

        # run; whatever ends it, finished chunks are kept
        say("running")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            plan = {"plan": varying.text, "made_with": exact_versions()}
            write_whole(folder / PLAN, json.dumps(plan, indent=1).encode())
            if missing:
                source = (
                    chunks_here(varying, missing, processes)
                    if scheduler is None
                    else chunks_there(varying, missing, scheduler)
                )
                with closing(source):
                    for part, content in source:
                        files[part].parent.mkdir(exist_ok=True)
                        write_whole(files[part], content.rows)
                        write_whole(files[part].with_suffix(".npz"), content.bands)
                        features[part] = content.features
                        finished += part[1] - part[0]
                        if progress is not None:
                            progress(finished, varying.count)
            say("tables")
            result = _assembled(varying, [*files.values()], sorted(set(filter(None, features.values()))), folder)
        except BaseException as error:
            n = len(list((folder / CHUNKS).glob("*.npz")))
            are_kept = f"{'1 finished chunk is' if n == 1 else f'{n} finished chunks are'} kept in {folder}"
            if n:
                error.add_note(f"{are_kept}; continue with --resume")
            if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
                raise OutputError(
                    f"{error.filename or folder}: no space left on the disk; {are_kept}: free some space, then "
                    "continue with --resume"
                ) from error
            raise
        shutil.rmtree(folder / CHUNKS, ignore_errors=True)
        (folder / PLAN).unlink(missing_ok=True)
        return result


def _different(here: Any, there: Any, at: str) -> Iterator[str]:
    """The differences between two trees of plain values."""
    if isinstance(here, dict) and isinstance(there, dict):
        for key in sorted({*here, *there}):
            yield from _different(
                here.get(key), there.get(key), f"{at}.{key}".removeprefix(".").removeprefix("experiment.")
            )
    elif here != there:
        yield f"{at} is {here!r} here and {there!r} there"


def _bands(rows: Path) -> dict[str, Any]:
    """What is beside the rows of a chunk: samples over time, features of its machine code, a checksum of the rows."""
    with np.load(BytesIO(rows.with_suffix(".npz").read_bytes())) as arrays:
        return {**arrays, "columns": tuple(arrays["columns"].tolist())}


def _features(rows: Path) -> str | None:
    """The processor features of a chunk's machine code; None if the chunk is missing or incomplete."""
    try:
        arrays = _bands(rows)  # of which numpy checks the checksums
        return str(arrays["features"]) if crc32(rows.read_bytes()) == int(arrays["checksum"]) else None
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return None


def _assembled(varying: Members, files: Sequence[Path], features: Sequence[str], folder: Path) -> Ensemble:
    """Write the tables and ensemble.json from the rows of the chunks; the last one marks completion."""
    rows = polars.concat(map(scan_parquet, files), how="diagonal")
    options: dict[str, Any] = {"row_group_size": _ROWS_A_GROUP, "maintain_order": True, "statistics": False}
    write_whole(folder / MEMBERS, lambda path: write_to(path, lambda place: rows.sink_parquet(place, **options)))
    members = scan_parquet(folder / MEMBERS)
    chunks = [BandSamples(*(fields[name] for name in BandSamples._fields)) for fields in map(_bands, files)]
    ran = members.filter(polars.col("outcome") != "impossible").select("member").head(MOST_KEPT).collect()
    bands, samples = band_tables(chunks, ran["member"].to_list())
    for name, frame in ((BANDS, bands), (SAMPLES, samples)):
        write_whole(folder / name, partial(write_to, write=partial(frame.write_parquet, statistics=False)))

    # how often each outcome and cause is there: outcomes in alphabetical order, the most frequent causes first
    counts = {}
    for name in ("outcome", "oscillation", "cause"):
        groups = members.group_by(name).len().drop_nulls().sort(name)
        if name == "cause":
            groups = groups.sort("len", descending=True, maintain_order=True).head(_MOST_CAUSES)
        counts[name] = dict(groups.collect().iter_rows())

    # metadata depend only on the results: no times, and no names of workers
    metadata = {
        "title": varying.nominal.title,
        "experiment": varying.nominal.model_dump(mode="json"),
        "settings": varying.nominal.changed,
        "fineness": fineness_of(varying.platforms[1]),
        "members": varying.count,
        "seed": varying.seed,
        "sampling": varying.choice.sampling,
        "combinations": varying.combinations,
        "groups": [[name for k in group for name in varying.inputs[k].columns] for group in varying.groups],
        "outside": [varied.outside for varied in varying.inputs if varied.outside],
        "outcomes": counts["outcome"],
        "oscillations": counts["oscillation"],
        "causes": counts["cause"],
        **varying.stepping._asdict(),
        "integration_error": members.select(polars.col("integration_error").max()).collect().item(),
        # one text means the same bits from all workers; several mean agreement to 1e-9
        "features": list(features),
        "hash": hashlib.sha256(json.dumps(decisive(varying.plan), sort_keys=True).encode()).hexdigest(),
        "plan": varying.text,
        "made_with": exact_versions(),
        "versions": versions(),
    }
    write_whole(folder / METADATA, json.dumps(metadata, indent=1).encode())
    return read_ensemble(folder)
