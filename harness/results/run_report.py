"""What a run found, as a report: whether it follows its reference, what of the drives it uses, when it settles."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.report.document import (
    Cell,
    Column,
    Note,
    Number,
    Report,
    Section,
    Status,
    Table,
    Value,
    Verdict,
    settings_of,
)
from gough_stewart.harness.report.quantities import (
    ANGLE,
    DECIBEL,
    FORCE,
    LENGTH,
    NUMBER,
    SHARE,
    TIME,
    Quantity,
    about,
    at_least,
    at_most,
    fine,
    fineness_of,
    percent,
    plain_text,
    sentence,
)
from gough_stewart.harness.results.metric_folds import AXES, metric_of
from gough_stewart.harness.results.metrics import flattened, metrics, metrics_tables
from gough_stewart.harness.results.oscillation import Oscillation, outcome_text
from gough_stewart.harness.results.record_data import DRIVE_LIMITS, RecordData, faults_of, nearness_to_limits
from gough_stewart.harness.results.run_charts import FLAGS, run_charts, scenes, shown
from gough_stewart.model.parameters import TABLE
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import first_of_largest

# A drive that uses more than this of a limit, a disk margin below this, or a step that has not settled is marginal.
_NEAR, _FRAIL = 0.9, 0.4
# A reference that covers this share of its step within one row jumps. Turns are told if they move the joints by this
# share of the position error.
_JUMP, _SMALL = 0.5, 0.1
_LIMITED = {"leg_velocity_max": "speed", "actuator_force_max": "force", "actuator_power_max": "power"}
# Tables of an experiment, in the order of the table of a run.
_SECTIONS = (
    *("reference", "controller", "loop", "sensors", "actuators", "limits", "start", "change", "disturbance"),
    *("fault", "injection"),
)


class Robustness(NamedTuple):
    """The disk margin of a run's linear loop."""

    alpha: float
    frequency: float  # [Hz]
    gain: tuple[float, float]  # factors
    doubt: str = ""  # what it leaves out, so that a requirement on it is inconclusive

    @property
    def decibels(self) -> float:
        """By how much all gains may rise or fall, each independently [dB]."""
        return 20 * math.log10(self.gain[1]) if math.isfinite(self.gain[1]) and self.gain[1] > 0 else math.inf


class _VerdictPart(NamedTuple):
    """A part of the verdict, whether it is a reason to worry, and its number."""

    text: str
    is_marginal: bool = False
    number: Number | None = None


def run_verdict(  # noqa: PLR0912, PLR0915 - a section for each part of the sentence
    record: RecordData, measured: Mapping[str, Any], fineness: float, robustness: Robustness | None = None
) -> Verdict:
    """Whether the run follows its reference, what it uses of the drives, when it settles, how robust its loop is.

    `fineness` is that of the machine, see `quantities.fineness_of`.
    """
    outcome, metadata = measured["outcome"], record.metadata
    faults = [str(fault) for fault in faults_of(metadata) if fault.begin <= outcome["time"]]
    if outcome["status"] != "completed":
        planned = metadata.get("duration") or (metadata.get("experiment") or {}).get("loop", {}).get("duration")
        of_planned = f" of {planned:.4g} s" if planned else ""
        cause = f": {outcome['cause']}" if outcome.get("cause") else ""
        ended = f"{outcome['status']} at {outcome['time']:.4g} s{of_planned}{cause}"
        return Verdict(sentence([ended, *faults]), "bad")
    length, angle = fine(LENGTH, fineness), fine(ANGLE, fineness)
    tracking, steps, parts = measured["tracking"] or {}, measured["step_response"] or (), list[_VerdictPart]()

    # how far the platform is from its reference; of a run without one, how far it goes
    if "position" in tracking:
        kind, text = "norm_peak", "follows within {}"
        places = {axis: (signal, place) for axis, signal, place in AXES}
        for step in steps:
            signal, place = places[step["axis"]]
            changes = np.abs(np.diff(record[f"reference.{signal}"][:, place]))
            # of a jump, the error is the step itself at first: what is left at the end counts
            if changes.max(initial=0.0) >= _JUMP * abs(step["to"] - step["from"]):
                kind, text = "norm_final", "ends within {} of its reference after the step"
        position, orientation = tracking["position"][kind], tracking.get("orientation", {}).get(kind)
        metric = metric_of(f"tracking.position.{kind}")
        number = Number(metric.path, metric.text, position, metric.quantity)
        if position is None:
            parts.append(_VerdictPart("its error at the end is not known", True, number))
        else:
            size = at_most(length, position)
            # an angle matters by what it moves at the joints
            lever = float(np.linalg.norm(metadata["platform"]["platform_points"], axis=1).mean())
            if orientation is not None and orientation * lever > _SMALL * position:
                size += f" and {at_most(angle, orientation)}"
            parts.append(_VerdictPart(text.format(size), number=number))
    elif "position" in record and len(record["position"]):
        distance = float(np.linalg.norm(record["position"] - record["position"][0], axis=1).max())
        parts.append(_VerdictPart(f"open loop: the platform moves up to {at_most(length, distance)} from its start"))

    # the limit of which the legs use most; the forces if no limit is stated; what was saturated or left its stroke
    if measured["force"]:
        saturation, limits = measured["saturation"] or {}, measured["limits"] or {}
        shares = {
            limit: [share or 0.0 for share in limits[limit.name]["used"]]
            for limit in DRIVE_LIMITS
            if limit.name in limits
        }
        if force_limit := metadata.get("force_limit"):  # of the run's actuators, which may be less than the platform's
            force = next(limit for limit in DRIVE_LIMITS if limit.name == "actuator_force_max")
            most = np.broadcast_to(force_limit, 6).tolist()
            shares[force] = [(peak or 0.0) / limit for peak, limit in zip(measured["force"]["peak"], most, strict=True)]
        limited = {name: (saturation.get(name) or {}).get("any") for name in ("force_limited", "rate_limited")}
        if shares and not limited["force_limited"]:
            limit, of_legs = max(shares.items(), key=lambda used: max(used[1]))
            share, leg = max(of_legs), int(first_of_largest(np.array(of_legs))) + 1
            path, name = f"limits.{limit.name}.used", f"{limit.text}, of its limit"
            text = f"leg {leg} uses {percent(share)} of its {_LIMITED[limit.name]}"
            if limit.name == "actuator_force_max":
                text = f"forces {percent(share)} of what the drives have"
            number = Number(path, name, share, SHARE, limit=1.0, margin=1 - share)
            parts.append(_VerdictPart(text, share > _NEAR, number))
        elif not limited["force_limited"]:
            peak = max(force for force in measured["force"]["peak"] if force is not None)
            text = f"forces up to {at_most(FORCE, peak, 3)}; no limit of the drives is known"
            parts.append(_VerdictPart(text, number=Number("force.peak", "peak force", peak, FORCE)))
        for name, words in (("force_limited", "limit"), ("rate_limited", "rate limit")):
            if share_of_time := limited[name]:
                text = f"forces at the drives' {words} for {percent(share_of_time)} of the time"
                parts.append(_VerdictPart(text, True))
        margin = (measured["stroke"] or {}).get("margin")
        if margin is not None and margin < 0:
            number = Number("stroke.margin", "stroke margin", margin, LENGTH, limit=0.0, margin=margin)
            parts.append(_VerdictPart(f"a leg is {at_most(length, -margin)} beyond its stroke", True, number))

    # when it settles, and how robust its loop is
    late = next((step for step in steps if step["settling_time"] is None), None)
    if steps:
        step = late or max(steps, key=lambda step: step["settling_time"])
        text = f"settles in {about(TIME, step['settling_time'])}"
        if late is not None:
            within = about(TIME, outcome["time"] - step["at"])
            text = f"{step['axis']} has not settled to 2 % within {within} of its step"
        path = f"step_response.{step['axis']}.settling_time"
        parts.append(_VerdictPart(text, late is not None, Number(path, "settling time", step["settling_time"], TIME)))
    if robustness is not None:
        number = Number("margins.disk", "disk margin", robustness.alpha, NUMBER)
        size = at_least(DECIBEL, robustness.decibels) if math.isfinite(robustness.decibels) else "any gain"
        parts.append(_VerdictPart(f"{size} to the disk margin", robustness.alpha < _FRAIL, number))
    if not parts:
        parts = [_VerdictPart(f"completed {outcome['time']:.4g} s; it has neither a reference nor forces to judge")]

    # what its loop does without input, which comes first
    oscillation = Oscillation(**outcome["oscillation"]) if outcome.get("oscillation") else None
    if oscillation is not None:
        size = at_most(length, oscillation.amplitude)
        rate = "" if oscillation.frequency is None else f" at {oscillation.frequency:.3g} Hz"
        motion = f"leg {oscillation.leg} oscillates by {size}{rate}"
        if oscillation.is_growing:
            motion = f"unstable: the error of leg {oscillation.leg} grows to {size}{rate}"
        parts.insert(0, _VerdictPart(f"{motion} although nothing acts on the loop", True))
    numbers = tuple(part.number for part in parts if part.number is not None)
    is_beyond = any(number.margin is not None and number.margin < 0 for number in numbers)
    status: Status = "good" if measured["tracking"] else "told"
    if is_beyond or (oscillation is not None and oscillation.is_growing):
        status = "bad"
    elif any(part.is_marginal for part in parts):
        status = "marginal"
    return Verdict(sentence([*faults, *(part.text for part in parts)]), status, numbers)


def run_numbers(measured: Mapping[str, Any], robustness: Robustness | None = None) -> tuple[Number, ...]:
    """All numbers of a run by the paths of its metrics; of several legs the largest, or the least where that counts."""
    numbers = []
    for path, value in flattened(measured).items():
        metric = metric_of(path)
        numbers.append(Number(path, metric.text, value, metric.quantity, explanation=metric.sentence))
    if robustness is not None:
        disk, alpha, doubt = metric_of("margins.disk"), robustness.alpha, robustness.doubt
        numbers.append(Number(disk.path, disk.text, alpha, disk.quantity, explanation=disk.sentence, doubt=doubt))
    return tuple(numbers)


def report_of_run(
    record: RecordData,
    machine: Platform,
    believed: Platform,
    *,
    measured: Mapping[str, Any] | None = None,
    robustness: Robustness | None = None,
    charts: bool = True,
) -> Report:
    """The report of a run of a machine, whose design assumed the `believed` platform.

    `measured` has its metrics, if they are known; `charts` adds the signals over time and the platform in motion.
    """
    measured, fineness = metrics(record) if measured is None else measured, fineness_of(machine)
    tables = tuple(metrics_tables(measured))
    sections = [Section("Metrics", tables)] if tables else []
    if charts:
        about_run = [
            run_table(record, believed, measured["outcome"]),
            parameters_table(machine, believed),
            versions_table(record),
        ]
        drawn = shown(record, machine, "run")
        if drawn is not None:
            first, rest = run_charts([drawn])
            sections = [Section("Motion", tuple(scenes([drawn]))), *sections, first, rest]
            about_run.insert(1, limits_table(drawn.record, machine))
        filled = tuple(table for table in about_run if table.rows)
        sections.append(Section("Run, parameters, versions", filled, detail=True))
    metadata = record.metadata
    platform, outcome = (metadata.get("platform") or {}).get("name"), metadata.get("outcome") or {}
    lead = [
        (metadata.get("experiment") or {}).get("description"),
        f"platform {platform}" if platform else None,
        f"plant {metadata['plant']}" if metadata.get("plant") else None,
        f"{outcome['time']:.6g} s" if "time" in outcome else None,
        f"sampled every {1e3 * metadata['sample_time']:.4g} ms" if metadata.get("sample_time") else None,
    ]
    report = Report(
        str(metadata.get("title", "untitled")),
        run_verdict(record, measured, fineness, robustness),
        tuple(sections),
        study="run",
        lead=", ".join(filter(None, lead)),
        numbers=run_numbers(measured, robustness),
        settings=settings_of(metadata.get("settings") or {}),
        notes=tuple(Note(text, "warning") for text in metadata.get("warnings", ())),
    )
    return fine(report, fineness)


def run_table(record: RecordData, platform: Platform, outcome: dict[str, Any]) -> Table:
    """How the run was made, and how it ended: the `outcome` of its metrics."""
    metadata = record.metadata
    rows: list[tuple[Cell, Cell]] = []
    if metadata.get("outcome"):
        rows.append(("outcome", outcome_text(outcome)))
    rows += [("plant", str(metadata.get("plant", "–"))), ("platform", platform.name), ("rows", record.table.height)]
    for name, quantity in (("duration", TIME), ("sample_time", TIME), ("plant_step", TIME), ("force_limit", FORCE)):
        if metadata.get(name) is not None:
            value = metadata[name]  # limits of legs that differ are six
            text = ", ".join(map(quantity.text, value)) if isinstance(value, list) else Value(value, quantity)
            rows.append((name.replace("_", " "), text))
    experiment = metadata.get("experiment") or {}
    for name in _SECTIONS:  # without empty ones
        section = experiment.get(name) or []
        for part in section if isinstance(section, list) else [section]:
            text = ", ".join(f"{key} {plain_text(value)}" for key, value in part.items() if value not in (None, {}, []))
            if text:
                rows.append((name, text))
    return Table("Run", (Column(""), Column("")), tuple(rows))


def limits_table(record: RecordData, platform: Platform) -> Table:
    """How near each leg came to its limits, and when flags were first set; the metrics have their shares."""

    def first(name: str, flags: NDArray[np.bool_]) -> tuple[Cell, ...]:
        times = (Value(float(record["time"][leg.argmax()]), TIME) if leg.any() else "never" for leg in flags.T)
        return (name, *times)

    rows: list[tuple[Cell, ...]] = []
    for name, values in nearness_to_limits(record, platform).items():
        rows.append((f"{name}, of its limit", *(Value(share, SHARE) for share in values.max(axis=0).tolist())))
        if name in ("velocity", "power"):
            rows.append(first(f"{name}, first beyond its limit", values > 1))
    for name in FLAGS:
        if f"flag.{name}" in record:
            rows.append(first(f"{name.replace('_', ' ')}, first", record[f"flag.{name}"].astype(bool)))
    columns = (Column("leg"), *(Column(f"{leg}") for leg in range(1, 7)))
    return Table("Limits", columns, tuple(rows), detail=True)


def parameters_table(machine: Platform, believed: Platform) -> Table:
    """All parameters of the machine, with those that the controller's design assumes where they differ."""
    differ = machine != believed
    assumed, rows = believed.as_dict(), []
    for name, value in machine.as_dict().items():
        if value is None or name == "name":
            continue
        head = Quantity("", TABLE[name].unit if name in TABLE else "").headed(name)
        row: list[Cell] = [head, plain_text(value)]
        if differ:
            is_same = assumed.get(name) is not None and np.array_equal(value, assumed[name])
            row.append("" if is_same else plain_text(assumed.get(name, "–")))
        rows.append(tuple(row))
    columns = (Column("parameter"), Column("machine"), *((Column("assumed in the design"),) if differ else ()))
    return Table(f"Platform: {machine.name}", columns, tuple(rows), detail=True)


def versions_table(record: RecordData) -> Table:
    """Versions of the software that wrote the record."""
    rows = tuple((name, str(number)) for name, number in record.metadata.get("versions", {}).items())
    return Table("Versions", (Column("package"), Column("version")), rows, detail=True)
