"""What a run found, as a report: whether it follows its reference, what of the drives it uses, when it settles."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.harness.report.document import Note, Number, Part, Report, Section, Status, Verdict, settings_of
from gough_stewart.harness.report.quantities import ANGLE, DECIBEL, FORCE, LENGTH, NUMBER, SHARE, TIME, Quantity
from gough_stewart.harness.report.small_machine import fine, fineness_of, fineness_of_record
from gough_stewart.harness.report.words import about, at_least, at_most, percent, sentence
from gough_stewart.harness.results.circumstances import (
    limits_table,
    parameters_table,
    run_table,
    versions_table,
)
from gough_stewart.harness.results.limits import DRIVE_LIMITS
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.harness.results.metrics import flattened, metrics
from gough_stewart.harness.results.oscillation import Oscillation
from gough_stewart.harness.results.record_data import RecordData
from gough_stewart.harness.results.run_charts import run_charts, scenes, shown
from gough_stewart.harness.results.tables import metrics_tables
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import first_of_largest

# A drive that uses more than this of a limit, a disk margin below this, or a step that has not settled is marginal.
_NEAR, _FRAIL = 0.9, 0.4
# A reference that covers this share of its step within one row jumps. Turns are told if they move the joints by this
# share of the position error.
_JUMP, _SMALL = 0.5, 0.1


class Robustness(NamedTuple):
    """The disk margin of a run's linear loop."""

    alpha: float
    frequency: float  # [Hz]
    gain: tuple[float, float]  # factors
    doubt: str = ""  # what it leaves out, so that a requirement on it cannot be told

    @property
    def decibels(self) -> float:
        """By how much all gains may rise or fall, each by itself [dB]."""
        return 20 * math.log10(self.gain[1]) if math.isfinite(self.gain[1]) and self.gain[1] > 0 else math.inf


class _Part(NamedTuple):
    """A part of the verdict, whether it is a reason to worry, and its number."""

    text: str
    is_marginal: bool = False
    number: Number | None = None


def run_verdict(record: RecordData, measured: Mapping[str, Any], robustness: Robustness | None = None) -> Verdict:
    """Whether the run follows its reference, what it uses of the drives, when it settles, how robust its loop is."""
    outcome = measured["outcome"]
    own = outcome.get("oscillation")
    if outcome["status"] != "completed":
        planned = record.metadata.get("duration") or (record.metadata.get("experiment") or {}).get("loop", {}).get(
            "duration"
        )
        of = f" of {planned:.4g} s" if planned else ""
        cause = f": {outcome['cause']}" if outcome.get("cause") else ""
        return Verdict(sentence([f"{outcome['status']} at {outcome['time']:.4g} s{of}{cause}"]), "bad")
    parts = [*_tracking(record, measured), *_drives(record, measured), *_settling(measured), *_robust(robustness)]
    parts = parts or [_Part(f"completed {outcome['time']:.4g} s; it has neither a reference nor forces to judge")]
    if own:
        parts.insert(0, _Part(_by_itself(own, _own(LENGTH, record)), True))
    numbers = tuple(part.number for part in parts if part.number is not None)
    beyond = any(each.margin is not None and each.margin < 0 for each in numbers)
    status: Status = "good" if measured["tracking"] else "told"
    if beyond or (own and own["is_growing"]):
        status = "bad"
    elif any(part.is_marginal for part in parts):
        status = "marginal"
    return Verdict(sentence(part.text for part in parts), status, numbers)


def run_numbers(measured: Mapping[str, Any], robustness: Robustness | None = None) -> tuple[Number, ...]:
    """All numbers of a run by the paths of its metrics; of several legs the largest, or the least where that counts."""
    found = []
    for path, value in flattened(measured).items():
        metric = metric_of(path)
        found.append(Number(path, metric.text, value, metric.quantity, explanation=metric.sentence))
    if robustness is not None:
        metric = metric_of("margins.disk")
        disk = Number("margins.disk", metric.text, robustness.alpha, explanation=metric.sentence)
        found.append(replace(disk, doubt=robustness.doubt))
    return tuple(found)


def _tracking(record: RecordData, measured: Mapping[str, Any]) -> list[_Part]:
    tracking, length = measured["tracking"] or {}, _own(LENGTH, record)
    if "position" not in tracking:
        return _moved(record, length)
    jumps = [step for step in measured["step_response"] or () if _jumps(record, step)]
    position, orientation = tracking["position"]["norm_peak"], tracking.get("orientation", {}).get("norm_peak")
    if jumps:
        # the error is the step itself at first
        ends = [at_most(_own(_of_axis(step["axis"]), record), abs(step["final_error"])) for step in jumps]
        step = max(jumps, key=lambda each: abs(each["final_error"] / (each["to"] - each["from"])))
        path, quantity = f"step_response.{step['axis']}.final_error", _of_axis(step["axis"])
        number = Number(path, f"{step['axis']}: error at the end", abs(step["final_error"]), quantity)
        return [_Part(f"ends {' and '.join(ends)} from its reference after the step", number=number)]
    number = Number("tracking.position.norm_peak", "position error, peak", position, LENGTH)
    text = f"follows within {at_most(length, position)}"
    # an angle matters by what it moves at the joints
    lever = float(np.linalg.norm(record.metadata["platform"]["platform_points"], axis=1).mean())
    if orientation is not None and orientation * lever > _SMALL * position:
        text += f" and {at_most(_own(ANGLE, record), orientation)}"
    return [_Part(text, number=number)]


def _moved(record: RecordData, length: Quantity) -> list[_Part]:
    """Of a run without a reference: how far the platform goes."""
    if "position" not in record or not len(record["position"]):
        return []
    position = record["position"]
    distance = float(np.linalg.norm(position - position[0], axis=1).max())
    return [_Part(f"open loop: the platform moves up to {at_most(length, distance)} from its start")]


def _jumps(record: RecordData, step: Mapping[str, Any]) -> bool:
    axis = step["axis"]
    signal, k = (
        ("position", "xyz".index(axis)) if axis in "xyz" else ("orientation", ("roll", "pitch", "yaw").index(axis))
    )
    reference = record[f"reference.{signal}"][:, k]
    return bool(np.abs(np.diff(reference)).max(initial=0.0) >= _JUMP * abs(step["to"] - step["from"]))


def _of_axis(axis: str) -> Quantity:
    return LENGTH if axis in "xyz" else ANGLE


def _own(quantity: Quantity, record: RecordData) -> Quantity:
    """A quantity as the record's machine has it."""
    return fine(quantity, fineness_of_record(record.metadata))


def _drives(record: RecordData, measured: Mapping[str, Any]) -> list[_Part]:
    """The limit of which the legs use most; the forces if no limit is stated; what was saturated or left its stroke."""
    if not measured["force"]:
        return []
    found = []
    shares = {
        limit: [share or 0.0 for share in part["used"]]
        for limit in DRIVE_LIMITS
        if (part := (measured["limits"] or {}).get(limit.name))
    }
    force_limit, limited = record.metadata.get("force_limit"), (measured["saturation"] or {}).get("force_limited") or {}
    if force_limit:  # of the run's actuators, which may be less than the platform's
        force = next(limit for limit in DRIVE_LIMITS if limit.name == "actuator_force_max")
        shares[force] = [(peak or 0.0) / force_limit for peak in measured["force"]["peak"]]
    if limited.get("any"):
        pass  # told below
    elif shares:
        limit, of_legs = max(shares.items(), key=lambda each: max(each[1]))
        share, leg = max(of_legs), int(first_of_largest(np.array(of_legs))) + 1
        number = Number(
            f"limits.{limit.name}.used", f"{limit.text}, of its limit", share, SHARE, limit=1.0, margin=1 - share
        )
        if limit.name == "actuator_force_max":
            text = f"forces {percent(share)} of what the drives have"
        else:
            text = f"leg {leg} uses {percent(share)} of its {_LIMITED[limit.name]}"
        found.append(_Part(text, share > _NEAR, number))
    else:
        peak = max(each for each in measured["force"]["peak"] if each is not None)
        number = Number("force.peak", "peak force", peak, FORCE)
        found.append(_Part(f"forces up to {at_most(FORCE, peak, 3)}; no limit of the drives is known", number=number))
    for name, text in (
        ("force_limited", "forces at the drives' limit"),
        ("rate_limited", "forces at the drives' rate limit"),
    ):
        share = ((measured["saturation"] or {}).get(name) or {}).get("any")
        if share:
            found.append(_Part(f"{text} for {percent(share)} of the time", True))
    margin = (measured["stroke"] or {}).get("margin")
    if margin is not None and margin < 0:
        number = Number("stroke.margin", "stroke margin", margin, LENGTH, limit=0.0, margin=margin)
        found.append(_Part(f"a leg is {at_most(_own(LENGTH, record), -margin)} beyond its stroke", True, number))
    return found


_LIMITED = {"leg_velocity_max": "speed", "actuator_force_max": "force", "actuator_power_max": "power"}


def _settling(measured: Mapping[str, Any]) -> list[_Part]:
    """When the slowest of the step responses settles."""
    steps = measured["step_response"] or ()
    if not steps:
        return []
    late = [step for step in steps if step["settling_time"] is None]
    if late:
        step = late[0]
        waited = measured["outcome"]["time"] - step["at"]
        text = f"{step['axis']} has not settled to 2 % within {about(TIME, waited)} of its step"
        return [_Part(text, True, Number(f"step_response.{step['axis']}.settling_time", "settling time", None, TIME))]
    step = max(steps, key=lambda each: each["settling_time"])
    number = Number(f"step_response.{step['axis']}.settling_time", "settling time", step["settling_time"], TIME)
    return [_Part(f"settles in {about(TIME, step['settling_time'])}", number=number)]


def _robust(robustness: Robustness | None) -> list[_Part]:
    if robustness is None:
        return []
    number = Number("margins.disk", "disk margin", robustness.alpha, NUMBER)
    size = at_least(DECIBEL, robustness.decibels) if math.isfinite(robustness.decibels) else "any gain"
    return [_Part(f"{size} to the disk margin", robustness.alpha < _FRAIL, number)]


def _by_itself(own: Mapping[str, Any], length: Quantity) -> str:
    found = Oscillation(**own)
    size = at_most(length, found.amplitude)
    rate = "" if found.frequency is None else f" at {found.frequency:.3g} Hz"
    if found.is_growing:
        return f"unstable: the error of leg {found.leg} grows to {size}{rate} although nothing acts on the loop"
    return f"leg {found.leg} oscillates by {size}{rate} although nothing acts on the loop"


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
    found = metrics(record) if measured is None else measured
    tables: list[Part] = list(metrics_tables(found))
    drawn = shown(record, machine, "run") if charts else None
    sections = [Section("Metrics", tuple(tables))] if tables else []
    if drawn is not None:
        first, others = run_charts([drawn])
        sections = [Section("Motion", tuple(scenes([drawn]))), *sections, first, others]
    limits = limits_table(drawn.record, machine) if drawn is not None else None
    about_run = (run_table(record, believed), limits, parameters_table(machine, believed), versions_table(record))
    circumstances = tuple(table for table in about_run if table is not None and table.rows)
    if charts:
        sections.append(Section("Run, parameters, versions", circumstances, detail=True))
    return fine(
        Report(
            str(record.metadata.get("title", "untitled")),
            run_verdict(record, found, robustness),
            tuple(sections),
            study="run",
            lead=_lead(record),
            numbers=run_numbers(found, robustness),
            settings=settings_of(record.metadata.get("settings") or {}),
            notes=tuple(Note(text, "warning") for text in record.metadata.get("warnings", ())),
        ),
        fineness_of(machine),
    )


def _lead(record: RecordData) -> str:
    """What was run: the experiment's description, platform, plant, length and clock."""
    metadata = record.metadata
    platform = (metadata.get("platform") or {}).get("name")
    parts = [(metadata.get("experiment") or {}).get("description")]
    parts += [f"platform {platform}"] if platform else []
    parts += [f"plant {metadata['plant']}"] if metadata.get("plant") else []
    outcome = metadata.get("outcome") or {}
    if "time" in outcome:
        parts.append(f"{outcome['time']:.6g} s")
    if metadata.get("sample_time"):
        parts.append(f"sampled every {1e3 * metadata['sample_time']:.4g} ms")
    return ", ".join(filter(None, parts))
