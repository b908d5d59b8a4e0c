"""Run an experiment: prepare it, open its plant, simulate the loop, make the record and its files; also members."""

import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from types import FunctionType
from typing import Any, get_args

import numpy as np
import polars
from numpy.typing import NDArray

from gough_stewart.harness.control.component import CUT, FROZEN, N_FAULTS
from gough_stewart.harness.control.laws_of_members import LawFrom
from gough_stewart.harness.control.linear_controller import LinearController
from gough_stewart.harness.control.makers import name_of
from gough_stewart.harness.errors import ExperimentError, PlantError
from gough_stewart.harness.experiment.file import digests, load_experiment
from gough_stewart.harness.experiment.margins import radius_of
from gough_stewart.harness.experiment.members import Members, fingerprint, varying_members
from gough_stewart.harness.experiment.overrides import Settings, experiment_with
from gough_stewart.harness.experiment.preparation import Batch, Injection, Prepared, prepare
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.loop.folds import ERRORS, error_between
from gough_stewart.harness.loop.libraries import are_compiled, loop_kernel
from gough_stewart.harness.loop.loop import LENGTHS, as_numbers
from gough_stewart.harness.loop.run import Run, simulate
from gough_stewart.harness.plants import PlantKind, signals
from gough_stewart.harness.plants.lanes import BatchPlant
from gough_stewart.harness.plants.open import open_plant
from gough_stewart.harness.plants.plant import Plant
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.harness.report.document import Note, Number, Report
from gough_stewart.harness.report.quantities import LENGTH, exactly
from gough_stewart.harness.report.requirements import Required, with_requirements
from gough_stewart.harness.results.metric_folds import METRICS
from gough_stewart.harness.results.metrics import metrics
from gough_stewart.harness.results.oscillation import FAULTS, MANUAL
from gough_stewart.harness.results.record import Record, platform_of
from gough_stewart.harness.results.run_report import Robustness
from gough_stewart.harness.section import plain, readable_json
from gough_stewart.model import interface
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.interface import Variant
from gough_stewart.model.process.files import Content, check_output_folder, file_set
from gough_stewart.model.process.installed import versions
from gough_stewart.model.process.progress import StepProgress, TimeProgress
from gough_stewart.model.vectors import FloatArray

FORMAT = 1
_OF_PLANTS = ("set_inputs", "set_parameters", "results", "do_step")
_INPUT_COLUMNS = [name for v in interface.INPUTS for name in v.scalar_names]
_REFERENCE = (*signals.NAMES[:4], "acceleration", "angular_acceleration", "leg_length", "leg_velocity")

# Of the groups of charts that a run shows at first, in their order.
_FIGURES = [f"{name}.{kind}" for name in ("errors", "pose", "actuators", "legs") for kind in ("pdf", "png", "svg")]
# The record is written first, beginning with its smallest complete form.
_FILES = ["record.parquet", "record.csv", "metadata.json", "metrics.json"]

# The last part of a run, in which a platform at rest moves less than this share of its error.
_LAST_PART = 0.2
_AT_REST = 0.02
# A noticeable error, as a share of the mean leg length.
_NOTICEABLE = 1e-4
# Of |z| of a sample, beyond rounding; and the largest exponent of a growth.
_ROUNDING, _MOST = 1e-7, 300.0


def run(  # noqa: PLR0912, PLR0915 - one road, in sections
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
        Replace the experiment's: "model" (compiled), "scipy" (an independent check), "fmu2" or "fmu3", and an
        FMU file, built if missing; or an object that follows the rules of `Plant`, in its start state, which the caller
        closes.
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
        Called with warnings: before the run, every limit that the reference exceeds under `limits.reference = "warn"`,
        and a loop that is unstable in the linear model, which may grow too slowly for the run to show; after it,
        remarks of an FMU, and a controller function that keeps memory, with which another run would go on. They are
        also `warnings` in the metadata.

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

    See Also
    --------
    load_experiment, metrics, margins, ensemble, view

    Examples
    --------
    >>> record = gs.run("heave_step", {"loop.duration": 0.3, "controller.bandwidth": 3})
    >>> record["position"][-1], record["error.leg_length"].shape
    """
    # read and prepare; a member of an ensemble has the values, noise and jitter of its number
    chosen, members = load_experiment(experiment, settings), None
    replaced = [name for name, value in (("controller", controller), ("injection", injection)) if value is not None]
    before = fingerprint(controller) if isinstance(controller, FunctionType) else ""
    if member is None:
        prepared = prepare(chosen, controller, injection)
    elif injection is not None:
        raise ExperimentError(chosen.where, "member", "has the experiment's injection; remove injection")
    else:
        members = varying_members(chosen, controller)
        (chosen,), batch = _members_of(members, [member])
        prepared = batch.member(0, hints_at=chosen)

    # what is to be said before; a maker is asked for its controller once, for the run itself
    said_before, growing, timing = [*prepared.warnings], list[str](), prepared.loop.timing
    if isinstance(prepared.controller, LinearController):
        with suppress(GoughStewartError):  # no linear loop
            radius = radius_of(prepared, prepared.machine, prepared.controller)
            if radius >= 1 + _ROUNDING:
                times = math.exp(min(math.log(radius) * timing.duration / timing.sample_time, _MOST))
                growing.append(
                    f"the linear loop, without Coulomb friction and limits, is unstable: errors grow to {times:.3g} "
                    f"times their size in {timing.duration:g} s; `gough-stewart margins` shows what the loop allows"
                )
    said_before += growing
    if warn is not None:
        for text in said_before:
            warn(text)

    # the plant: of a member by itself its ensemble's, else the experiment's, or the one that replaces it
    choice, loop = chosen.plant, prepared.loop
    opening: AbstractContextManager[Plant]
    opening_law: AbstractContextManager[LawFrom | None] = prepared.law_in_a_run()
    in_batch = members is not None and plant is None and fmu is None
    if members is not None and in_batch:
        running = batch.in_parallel(members.stepping)
        name, opening, loop, opening_law = "lanes", running.plant, running.loop, nullcontext(running.law_from)
    elif plant is None or isinstance(plant, str):
        kind: PlantKind = plant or choice.kind
        name = kind
        if choice.fmu is not None and fmu is None and kind == choice.kind:
            fmu = chosen.folder / choice.fmu
        # a chain that is compiled whole runs with its plant; one that calls back into Python steps the plant here
        is_whole = kind == "model" and fmu is None and not choice.fixed_step_size
        if is_whole and are_compiled([prepared.controller]):
            kernel = loop_kernel(Variant.of(prepared.machine))
            opening = BatchPlant([prepared.machine], [prepared.start], tolerance=choice.tolerance, kernel=kernel)
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
        missing = [name for name in _OF_PLANTS if not hasattr(plant, name)]
        if missing:
            raise PlantError(
                f"plant is {plant!r}, without {', '.join(missing)}; expected "
                f"{', '.join(map(repr, get_args(PlantKind)))}, or an object that follows the rules of "
                "gough_stewart.harness.plants.plant.Plant"
            )
        if fmu is not None:
            raise PlantError(f"plant is {plant!r}, and fmu is {fmu!r}; expected only one of them")
        name, opening = type(plant).__name__, nullcontext(plant)

    # simulate
    with opening as opened, opening_law as law_from:
        history = simulate(opened, law_from, loop, progress)[0]
        remarks = opened.remarks() if hasattr(opened, "remarks") else ""
    record = record_of(history, prepared, chosen, name, replaced, member if in_batch else None)

    # what is to be said afterwards
    warnings = [*filter(None, [remarks]), *growing]
    if before and fingerprint(controller) != before:
        warnings.append(
            f"the function {name_of(controller)} keeps memory, which the run has changed, and another run goes on from "
            "there; use a class or factory"
        )
    if warnings:
        record.metadata.setdefault("warnings", []).extend(warnings)
    if warn is not None:
        for text in record.metadata.get("warnings", []):
            if text not in said_before:
                warn(text)
    return record


def _members_of(members: Members, numbers: Sequence[int | None]) -> tuple[list[Experiment], Batch]:
    """The experiments of members, and the same prepared; None is the nominal machine."""
    nominal = members.nominal
    for number in numbers:
        if number is not None and not 0 <= number < members.count:
            raise ExperimentError(nominal.where, "member", f"is {number}; expected 0 to {members.count - 1}")
    values = [{} if number is None else members.draws(number, number + 1).values[0] for number in numbers]
    names = ["nominal machine" if number is None else f"member {number}" for number in numbers]
    batch = members.preparation.members(values, numbers)
    for k, reason in batch.reasons.items():
        raise ExperimentError(nominal.where, names[k], f"is impossible: {reason}")
    experiments = [
        experiment_with(nominal, drawn).model_copy(update={"title": f"{nominal.title}, {name}"})
        for drawn, name in zip(values, names, strict=True)
    ]
    return experiments, batch


def records_of(members: Members, numbers: Sequence[int | None]) -> list[Record]:
    """The records of members, which run in parallel; None is the nominal machine, with the experiment's own seed."""
    experiments, batch = _members_of(members, numbers)
    running = batch.in_parallel(members.stepping)
    with running.plant:
        runs = simulate(running.plant, running.law_from, running.loop)
    replaced = [] if members.controller is None else ["controller"]
    return [
        record_of(runs[k], batch.member(k, hints_at=experiment), experiment, "lanes", replaced, numbers[k])
        for k, experiment in enumerate(experiments)
    ]


def record_of(
    run: Run,
    prepared: Prepared,
    experiment: Experiment,
    plant: str,
    replaced: Sequence[str] = (),  # tables of the experiment that objects stood in for
    member: int | None = None,  # its number if it ran in its ensemble's plant
) -> Record:
    """The table of a run, and its metadata."""
    n, at = len(run.time), run.sample_of_row
    parts: list[tuple[str | list[str], Any]] = [  # a vector by its name, or scalars by theirs
        (["time"], run.time[:, None]),
        (list(Variant.of(prepared.machine).columns[: run.results.shape[1]]), run.results),
        (_INPUT_COLUMNS, run.inputs),
    ]
    if prepared.motion is not None and prepared.legs is not None:
        actual, errors = interface.unpack(interface.RESULTS, run.results), list[tuple[str | list[str], Any]]()
        for name, values in zip(_REFERENCE, (*prepared.motion, *prepared.legs), strict=True):
            parts.append((f"reference.{name}", values[:n]))
            if f"error.{name}" in ERRORS:
                errors.append((f"error.{name}", error_between(name, values[:n].T, actual[name].T).T))
        parts += errors
    if run.used:
        names = [f"measured.{name}" for name in signals.column_names(run.used)]
        parts.append((names, run.measured[at][:, signals.positions(run.used)]))
    parts.append(("controller.force", run.command[at]))
    parts.append(("controller.feedforward", prepared.loop.feedforward[at]))
    parts.append(("controller.state", run.controller_state[at]))
    parts += acting_columns(prepared, at)
    parts.append(("flag.force_limited", run.force_limited[at]))
    parts.append(("flag.rate_limited", run.rate_limited))
    parts.append(("flag.stroke_exceeded", run.stroke_exceeded))
    columns = dict[str, Any]()
    for part, values in parts:
        for k in range(values.shape[1]):  # what acts on the loop may have been recorded already
            columns.setdefault(f"{part}[{k + 1}]" if isinstance(part, str) else part[k], values[:, k])
    table = polars.DataFrame(columns)
    timing, files = prepared.loop.timing, digests(experiment)
    metadata = {
        "format": FORMAT,
        "title": experiment.title,
        "plant": plant,
        **({} if member is None else {"member": member}),
        "experiment": experiment.model_dump(mode="json"),
        **({"settings": experiment.changed} if experiment.changed else {}),
        **({"files": files} if files else {}),
        **({"replaced": list(replaced)} if replaced else {}),
        **({"warnings": list(prepared.warnings)} if prepared.warnings else {}),
        "host": run.host,
        "rows": len(run.time),
        "outcome": run.outcome._asdict(),
        "duration": timing.duration,
        "sample_time": timing.sample_time,
        "plant_step": timing.plant_step,
        "seed": as_numbers(prepared.loop.sensors.seed),
        "force_limit": None if (most := prepared.loop.actuators.force_limit) is None else np.squeeze(most).tolist(),
        "platform": plain(prepared.platform.as_dict()),
        "machine": plain(prepared.machine.as_dict()),
        "versions": versions(),
    }
    return Record(table, metadata)


def acting_columns(prepared: Prepared, sample_of_row: NDArray[np.intp]) -> list[tuple[str | list[str], Any]]:
    """All that acts on a loop from outside, over the rows of these samples (n,): columns (n, k), named as a record's.

    A name stands for a vector with its elements, a list for scalars.
    """
    loop, n = prepared.loop, len(sample_of_row)

    def over_time(start: object, changed: Iterable[object]) -> FloatArray:
        values = np.tile(np.ravel(np.asarray(start, dtype=float)), (n, 1))
        for change, value in zip(loop.changes, changed, strict=True):
            if value is not None:
                values[loop.timing.row(change.time, "a change") :] = np.ravel(np.asarray(value))
        return values

    parts: list[tuple[str | list[str], Any]] = []
    if loop.reference is not None:
        parts.append(("reference.leg_length", loop.reference[:n, LENGTHS]))
    if loop.injection is not None:
        parts.append(("controller.injection", loop.injection[sample_of_row]))
    parts.append((_INPUT_COLUMNS[6:], over_time(np.zeros(6), (change.external_wrench for change in loop.changes))))
    for variable in Variant.of(prepared.machine).tunable:
        changed = [change.parameters.get(variable.name) for change in loop.changes]
        if any(value is not None for value in changed):
            values = over_time(getattr(prepared.machine, variable.name), changed)
            parts.append((list(variable.scalar_names), values))
    if loop.has_switch:
        manual = over_time(np.zeros(2 * N_LEGS), (change.manual for change in loop.changes))
        parts.append(([MANUAL], manual[:, :1] > 0))
    faults = over_time(np.zeros(N_FAULTS), (change.faults for change in loop.changes))
    frozen = (FROZEN.start + signals.positions([name]) for name in signals.NAMES)
    for name, at in zip(FAULTS, (np.arange(N_FAULTS)[CUT], *frozen), strict=True):
        if faults[:, at].any():
            parts.append((name, faults[:, at] > 0))
    return parts


def names_of_files(page: bool = True, figures: bool = True) -> list[str]:
    """The files that `write_results` may write."""
    from gough_stewart.harness.report.page import PAGE  # slow, and a run alone does not need it

    return [*_FILES, *(_FIGURES if figures else ()), *([PAGE] if page else ())]


def write_results(
    record: Record,
    folder: Path,
    *,
    page: bool = False,
    figures: bool = False,
    charts: bool = False,
    requirements: Sequence[Required] = (),
    notes: Sequence[Note] = (),
    robustness: Robustness | None = None,
) -> tuple[list[str], Report]:
    """Write all files of a run as one set, optionally with page and figures; their names, and the report.

    If something fails, the files before it are complete, beginning with the record, and no file of an older run
    remains; see `file_set`. `charts` are in the report for other uses than these files.
    """
    with (
        file_set(folder, names_of_files(page, figures), names_of_files()) as files,
        ThreadPoolExecutor(1) as aside,  # polars releases the GIL
    ):
        first: dict[str, Content] = {
            "record.parquet": record.write_parquet,
            "record.csv": record.write_csv,
            "metadata.json": record.to_metadata(),
        }
        measured = metrics(record)
        written = [aside.submit(files.add, first)]
        written.append(aside.submit(files.add, {"metrics.json": readable_json(measured)}))
        report = record.report(measured=measured, robustness=robustness, charts=page or figures or charts)
        report = replace(report, notes=(*report.notes, *notes))
        if requirements:
            # also metrics that this run does not have, such as a settling time without a step
            required, present = ({number.path for number in numbers} for numbers in (requirements, report.numbers))
            missing = [Number(m.path, m.text, None, m.quantity) for m in METRICS if m.path in required - present]
            report = replace(report, numbers=(*report.numbers, *missing))
            report = with_requirements(report, requirements)
        more: dict[str, Content] = {}
        if figures:
            from gough_stewart.harness.report.figures import figures as drawn

            more |= drawn(report)
        if page:
            from gough_stewart.harness.report.page import PAGE, page_of

            more[PAGE] = page_of(report)
        for part in written:
            part.result()
        files.add(more)
    return files.names, report


def save_record(record: Record, folder: Path | str, report: bool = False, figures: bool = False) -> list[Path]:
    """Write all files of a run as `gough-stewart run` does; `read_record` and `view` accept the folder.

    Parameters
    ----------
    record
        From `run`.
    folder
        Created if needed. Gets record.csv, record.parquet, metadata.json, metrics.json.
    report
        Also write report.html, the HTML page.
    figures
        Also draw errors, pose, forces and legs, each as PDF, PNG and SVG.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    OutputError, OSError
        The files cannot be written there.

    See Also
    --------
    read_record, metrics, view

    Examples
    --------
    >>> record = gs.run("heave_step", {"loop.duration": 0.1})
    >>> files = gs.save_record(record, "results/heave", report=True)
    """
    folder = Path(folder)
    check_output_folder(folder, names_of_files())
    names, _ = write_results(record, folder, page=report, figures=figures)
    return [folder / name for name in names]


def warnings_of(record: Record) -> list[str]:
    """Limits that a run exceeded, and a static error at its end; a stroke that it was to ignore is left out."""
    warnings, choice = list[str](), record.metadata["experiment"]["controller"]
    # a platform that rests off its reference: a PD acts as a spring, F = kp e, so the error is what the load takes
    if choice.get("type") == "pd" and choice.get("feedforward", "none") == "none" and "error.position" in record:
        first = int((1 - _LAST_PART) * record.table.height)
        error, reference = record["error.position"][first:], record["reference.position"][first:]
        if len(error) > 1 and not np.ptp(reference, axis=0).any() and np.isfinite(error).all():
            mean, scale = error.mean(axis=0), float(record["leg_length"][0].mean())
            distance = float(np.linalg.norm(mean))
            if distance >= _NOTICEABLE * scale and np.abs(error - mean).max() <= _AT_REST * distance:
                gravity, size = platform_of(record).gravity, exactly(LENGTH, distance, 3)
                # e = reference − position points against gravity where the platform hangs below
                along = -float(mean @ gravity) / (distance * float(np.linalg.norm(gravity)) or 1.0)
                how = f"hangs {size} below" if along > 0.9 else f"rests {size} off"
                warnings.append(
                    f"the platform {how} its reference at the end: the load over the stiffness of its PD; "
                    "set controller.feedforward = 'gravity', or use a PID, whose integral takes it away"
                )
    feedforward, limit = np.abs(record["controller.feedforward"]), record.metadata["force_limit"]
    shares = feedforward / (np.inf if limit is None else limit)
    if shares.max() > 1:
        row, leg = (int(k) for k in np.unravel_index(shares.argmax(), feedforward.shape))
        warnings.append(
            f"feedforward requires {feedforward[row, leg]:.4g} N of leg {leg + 1} at {record['time'][row]:.6g} s; its "
            f"force limit is {np.broadcast_to(limit, 6)[leg]:.4g} N. Make the reference slower or smaller; if it is a "
            "noisy recording, smooth it"
        )
    exceeded = record["flag.stroke_exceeded"]
    if record.metadata["experiment"]["limits"]["stroke"] == "warn" and exceeded.any():
        row, leg = (int(k) for k in np.argwhere(exceeded)[0])
        length, time = record["leg_length"][row, leg], record["time"][row]
        warnings.append(
            f"leg {leg + 1} left its stroke at {time:.6g} s with a length of {length:.6g} m; see flag.stroke_exceeded"
        )
    return warnings
