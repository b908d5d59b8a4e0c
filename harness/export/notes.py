"""What is said of an export: its delay, the stability of its loops, what it leaves out; inside it and to its maker."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gough_stewart.harness.control.margins import Margins
from gough_stewart.harness.errors import UnstableLoopError
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.choices import NOTHING, Carried, Part
from gough_stewart.harness.export.stability import (
    NO_FEEDBACK,
    Case,
    Host,
    LoopStability,
    StabilityReport,
    output_delay_of,
)
from gough_stewart.harness.report.document import Note, Number, Report, Section, Status, Verdict
from gough_stewart.harness.report.quantities import ANGLE, COUNT, DECIBEL, NUMBER
from gough_stewart.harness.report.table import Column, Table
from gough_stewart.harness.report.words import listed, sentence
from gough_stewart.harness.section import Kind

_NAMES_OF = {"sensors": "sensors", "actuators": "drives"}
_NAMES: dict[str, str] = {"c": "C", "fmu": "FMU", "ssp": "SSP", "run": "unit", "page": "live page"}


@dataclass(frozen=True)
class Notes:
    """Of one form."""

    inside: tuple[str, ...]  # paragraphs for its documentation
    warnings: tuple[str, ...]  # for its maker


def notes_of(experiment: Experiment, host: Host, judged: StabilityReport, carried: Carried = NOTHING) -> Notes:
    """The notes of a form of an experiment, as judged, with what it carries of the machine."""
    missing = [] if host == "run" else left_out(experiment, host, carried.parts)
    inside = [
        *_inside(experiment, carried),
        f"Delay: {_delay(experiment, host, carried)}",
        *_stability(judged, carried),
        f"Left out: {', '.join(missing)}." if missing else "Nothing of the experiment is left out.",
    ]
    warnings = []
    if missing:
        warnings.append(f"the {_NAMES[host]} is without {', '.join(missing)}: {_holds(host, carried)}")
    if host in ("fmu", "ssp") and not experiment.loop.delay:
        warnings.append(
            f"the {_NAMES[host]} is one sample late, where the experiment has no delay: a unit outputs the forces of a "
            "sample at the next one"
        )
    if judged.reason and judged.reason != NO_FEEDBACK:
        warnings.append(f"the stability of the loop of the {_NAMES[host]} is not judged: {judged.reason}")
    warnings += [f"{'run' if host == 'run' else 'exported'} anyway: {complaint(loop)}" for loop in judged.unstable]
    return Notes(tuple(inside), tuple(warnings))


def refusal(experiment: Experiment, judged: Iterable[tuple[Host, StabilityReport]]) -> UnstableLoopError | None:
    """The error for forms of which one loop or more is unstable."""
    loops = [(host, loop) for host, report in judged for loop in report.unstable]
    if not loops:
        return None
    texts = [complaint(loop) for _, loop in loops]
    remedies = [loop.remedy for _, loop in loops if loop.remedy]
    anyway = "--anyway runs it" if loops[0][0] == "run" else "--anyway (anyway=True) exports it, with a note inside"
    parts = [*dict.fromkeys(texts), *dict.fromkeys(remedies), anyway]
    return UnstableLoopError(f"{experiment.where}: {'; '.join(parts)}", loops[0][1].worst_of_all.eigenvalue)


def complaint(loop: LoopStability) -> str:
    """What is unstable: where, by how much, for which machine."""
    worst = loop.worst_of_all
    text = (
        f"{loop.surroundings.where} the closed loop is unstable{_circumstances(worst)}: |z| = {worst.size:.5g} at "
        f"{worst.frequency:.3g} Hz for {worst.what}, expected below 1"
    )
    if loop.unstable:
        text += f" ({loop.unstable} of {loop.members} members are unstable)"
    return text


def _holds(host: Host, carried: Carried) -> str:
    """What a form is, for which something is left out."""
    if host == "ssp":
        missing = " and ".join(part for part in ("sensors", "actuators") if _NAMES_OF[part] not in carried.parts)
        with_parts = f", with its {carried.words}" if carried.words else ""
        return f"it holds the plant and the controller{with_parts}, not the machine's {missing or 'disturbances'}"
    if not carried.words:
        return "it is the controller alone, not the machine around it"
    return f"it is the controller with its {carried.words}, not the machine around it"


def _inside(experiment: Experiment, carried: Carried) -> list[str]:
    texts, step = [], experiment.loop.sample_time / carried.steps_a_sample
    if carried.drives:
        texts.append(
            "Drives: the forces are those that act, behind the force limit, the rate limit and the lag: their means "
            f"over each step of {1000 * step:g} ms."
        )
    if carried.sensors:
        often = (
            "at each sample"
            if carried.steps_a_reading is None
            else f"every {1000 * step * carried.steps_a_reading:g} ms"
        )
        texts.append(f"Sensors: measurements are read {often}, and quantised; their noise is not part of it.")
    if carried.manual:
        texts.append(
            "Manual: while `enabled` is 0 the forces follow `manual_force`; the stability is that of the loop on."
        )
    return texts


def _delay(experiment: Experiment, host: Host, carried: Carried) -> str:
    delay, late = _delay_of(experiment.loop.delay), output_delay_of(experiment)
    if host == "c":
        return (
            f"a step computes its forces at once; the experiment has {delay} from measurement to force, and the "
            "machine should have the same."
        )
    long = (
        f"of {1000 * experiment.loop.sample_time / carried.steps_a_sample:g} ms" if carried.has_steps else "of a sample"
    )
    steps = f" This holds for communication steps {long} or less; longer ones add delay."
    if host == "fmu" and not carried.drives:
        around = f" The other {_samples(late - 1)} have to be around the unit." if late > 1 else ""
        return (
            f"the unit outputs the forces of a sample one sample later (output_delay = 1). The experiment has {delay}; "
            f"the feedforward is computed for {_samples(late)}.{around}{steps}"
        )
    more = "" if experiment.loop.delay else ", but a unit needs one sample"
    return (
        f"forces act {_samples(late)} after their measurement (output_delay = {late}); the experiment has "
        f"{delay}{more}.{steps}"
    )


def _stability(judged: StabilityReport, carried: Carried) -> list[str]:
    if not judged.loops:
        return [f"Stability: not judged, since {judged.reason}."]
    return [
        *(_verdict(loop) for loop in judged.loops),
        *dict.fromkeys(text for loop in judged.loops for text in _margins(loop)),
        "Judged by the eigenvalues z of the sampled loop, linearised at rest, without Coulomb friction and limits. "
        + (
            "The lag of the drives was part of it, quantisation was not."
            if carried.drives
            else "Of what is left out, only a lag, a sensors' clock and jitter that are named here were part of it."
        ),
    ]


def _verdict(loop: LoopStability) -> str:
    verdict = "stable" if loop.is_stable else f"UNSTABLE, and exported anyway: {complaint(loop)}"
    parts = [f"{loop.nominal.what} {_size(loop.nominal)}"]
    if loop.poses > 1:
        parts.append(f"along the motion at most {_size(loop.on_the_way)} ({loop.poses} poses)")
    parts += [f"{case.what} {_size(case)}" for case in loop.changed]
    if loop.worst is not None:
        circumstances = "" if loop.worst.loop == loop.nominal.loop else f",{_circumstances(loop.worst)}"
        parts.append(
            f"{loop.members} members of [ensemble] at most {_size(loop.worst)} ({loop.worst.what}{circumstances})"
        )
    if loop.impossible:
        parts.append(f"impossible members, which are not judged: {loop.impossible}")
    return f"Stability {loop.surroundings.where}{_circumstances(loop.nominal)}: {verdict}; {'; '.join(parts)}."


def _margins(loop: LoopStability) -> list[str]:
    margins_of = [] if loop.margins is None else [(loop.nominal, loop.margins)]
    margins_of += [] if loop.margins_of_worst is None else [loop.margins_of_worst]
    return [f"Margins of {case.what}{_circumstances(case)}: {_in_words(margins)}." for case, margins in margins_of]


def _in_words(margins: Margins) -> str:
    disk, legs = margins.disk, margins.legs
    up, down = min(leg.gain_up for leg in legs), max(leg.gain_down for leg in legs)
    phase, delay = min(leg.phase for leg in legs), min(leg.delay for leg in legs)
    return (
        f"all legs at once disk margin {disk.alpha:.3g}, gains × {disk.gain[0]:.3g} to {disk.gain[1]:.3g}, phases "
        f"± {np.degrees(disk.phase):.3g}°; one leg at a time gain × {down:.3g} to {up:.3g}, phase "
        f"{np.degrees(phase):.3g}°, delay {1000 * delay:.3g} ms"
    )


def in_short(loop: LoopStability) -> str:
    """A loop in one line."""
    worst, alpha = loop.worst_of_all, min((m.disk.alpha for m in loop.known_margins), default=None)
    robustness = "" if alpha is None else f", disk margin {alpha:.3g}"
    return (
        f"{'stable' if loop.is_stable else 'UNSTABLE'} {loop.surroundings.where}{_circumstances(worst)}: |z| = "
        f"{worst.size:.5g} ({worst.what}){robustness}"
    )


def _circumstances(case: Case) -> str:
    late = f", up to {1000 * case.late:.4g} ms by the sensors' clock and jitter" if case.late else ""
    lag = f" and a lag of {1000 * case.lag:.3g} ms" if case.lag else ""
    return f" with {_delay_of(case.delay)}{late}{lag}"


def _delay_of(number: int) -> str:
    return f"a delay of {_samples(number)}" if number else "no delay"


def _samples(number: int) -> str:
    return "1 sample" if number == 1 else f"{number} samples"


def _size(case: Case) -> str:
    return f"|z| = {case.size:.5g} ({case.frequency:.3g} Hz)"


# --- what is left out -----------------------------------------------------------------------------------

# What every form has, what it is checked by, or what describes the run alone. Everything else in an experiment is left
# out if it is set, so that a new key is named until it has its place here.
_HAS = frozenset(
    {
        *("title", "description", "platform", "reference", "controller", "start", "require"),
        *("plant.kind", "plant.file", "plant.parameters", "plant.tolerance", "plant.fixed_step_size"),
        *("loop.duration", "loop.sample_time", "loop.plant_step", "loop.delay"),
        *("actuators.force_limit", "sensors.seed"),
        *("limits.reference", "limits.condition_number"),
    }
)
# What it carries of the machine, by part; noise is left out, since its random streams are the harness's.
_CARRIES: dict[Part, tuple[str, ...]] = {
    "manual": (),
    "drives": ("actuators.rate_limit", "actuators.lag"),
    "sensors": ("sensors.quantisation", "sensors.sample_time"),
}
# Values that mean nothing more than the default does.
_HARMLESS = {"limits.stroke": ("warn", "ignore")}
# A controller alone has no plant, of whichever kind.
_OF_PLANT = ("plant",)
_OTHER_MACHINES = "ensemble (its other machines)"


def left_out(experiment: Experiment, host: Host, parts: Iterable[Part] = ()) -> list[str]:
    """Keys that are set in an experiment, and that a form with these parts does not include: `injection`.

    Of an `[ensemble]`, the keys that vary are named, since a form holds one value of each; an SSP holds one machine.
    """
    around = () if host == "ssp" else _OF_PLANT
    carried = {key for part in parts for key in _CARRIES[part]}
    missing = [
        key for key in _set(experiment) if key not in _HAS | carried and key.split(".")[0] not in (*_HAS, *around)
    ]
    if experiment.ensemble is not None:
        for key, path in _varied(experiment):
            is_named = any(".".join(path).startswith(name) for name in missing)
            if path[0] not in around and not is_named:
                missing.append(_OTHER_MACHINES if path[0] in _OF_PLANT else f"ensemble.{key}")
    return list(dict.fromkeys(missing))


def _set(experiment: Experiment) -> Iterator[str]:
    """Keys that are not at their defaults, as `section.key`; lists and choices of a kind by their section."""
    for section, value in experiment.model_dump(exclude_defaults=True).items():
        if section == "ensemble":
            continue
        # a section of a kind, such as an injection, is one thing
        if not isinstance(value, dict) or section in _HAS or isinstance(getattr(experiment, section), Kind):
            if _means_something(section, value):
                yield section
            continue
        yield from (
            f"{section}.{name}" for name, setting in value.items() if _means_something(f"{section}.{name}", setting)
        )


def _means_something(key: str, value: Any) -> bool:
    if value in _HARMLESS.get(key, ()):
        return False
    return any(value.values()) if isinstance(value, dict) else value not in (None, [], 0)


def _varied(experiment: Experiment) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Keys of `[ensemble]` as written, each with its path; a bare name is of the machine."""
    assert experiment.ensemble is not None
    together = (key for inputs in experiment.ensemble.covariance for key in inputs.of)
    for key in (*experiment.ensemble.varied, *together):
        yield key, tuple(key.split(".")) if "." in key else ("plant", key)


# --- the report -----------------------------------------------------------------------------------------


def robustness_of(loop: LoopStability) -> float:
    """The smallest disk margin that is known of a loop; 0 of an unstable one, infinite if none is known."""
    if not loop.is_stable:
        return 0.0
    return min((margins.disk.alpha for margins in loop.known_margins), default=math.inf)


def least_robust_first(reports: Mapping[Host, StabilityReport]) -> list[LoopStability]:
    """All loops that were judged, the one with the smallest disk margin first."""
    return sorted((loop for report in reports.values() for loop in report.loops), key=robustness_of)


def export_report(
    title: str,
    forms: Sequence[str],
    verdicts: Sequence[str],
    warnings: Iterable[str],
    files: Sequence[str],
    loops: Sequence[LoopStability] = (),
) -> Report:
    """The report of an export; `verdicts` on the `loops` of its forms, the least robust first."""
    names = listed([_NAMES.get(form, form) for form in forms])
    unstable = [text for text in verdicts if text.startswith("UNSTABLE")]
    if not verdicts:
        judged = "no loop was judged for stability"
    elif unstable:
        judged = unstable[0]
    elif len(verdicts) == 1:
        judged = verdicts[0]
    else:
        least = verdicts[0].removeprefix("stable ")
        number = "both" if len(verdicts) == 2 else f"all {len(verdicts)}"
        judged = f"stable in {number} loops that it is made for; least robust: {least}"
    numbers = _least_margins(loops)
    status: Status = "bad" if unstable else "good" if verdicts else "told"
    return Report(
        title,
        Verdict(sentence([f"written as {names}", judged]), status, tuple(numbers[:2])),
        (Section("Stability", (_judged(loops),)),) if loops else (),
        study="export",
        numbers=(Number("files", "files written", float(len(files)), COUNT), *numbers),
        notes=tuple(Note(text, "warning") for text in warnings),
    )


def _judged(loops: Sequence[LoopStability]) -> Table:
    """A row for each loop: its delay, the case that is nearest to instability, its disk margin."""
    columns = (
        *(Column("loop"), Column("outcome"), Column("delay in samples", COUNT)),
        *(Column("largest |z|", replace(NUMBER, digits=5)), Column("of"), Column("disk margin", NUMBER)),
    )
    rows = tuple(
        (loop.surroundings.where, "stable" if loop.is_stable else "UNSTABLE", worst.delay, worst.size, worst.what, disk)
        for loop in loops
        for worst, disk in ((loop.worst_of_all, robustness_of(loop)),)
    )
    return Table("Loops of the forms, the least robust first", columns, rows)


def _least_margins(loops: Sequence[LoopStability]) -> list[Number]:
    """The least margins of the loops, with the delay that each form has; 0 of an unstable loop."""
    if not loops:
        return []
    least, of_forms = loops[0], "of the forms' loops, with the delay that each form has"
    disk = min((margins.disk for margins in least.known_margins), key=lambda disk: disk.alpha, default=None)
    known = (None, None, None) if disk is None else (disk.alpha, 20 * math.log10(disk.gain[1]), disk.phase)
    alpha, gain, phase = known if least.is_stable else (0.0, 0.0, 0.0)
    return [
        Number("stability.largest_eigenvalue", "largest |z|", max(loop.worst_of_all.size for loop in loops),
               explanation=f"largest magnitude of an eigenvalue {of_forms}; stable below 1"),
        Number("margins.disk", "disk margin", alpha, explanation=f"the least {of_forms}"),
        Number("margins.disk_gain", "gain of each leg", gain, DECIBEL, explanation=f"the least {of_forms}"),
        Number("margins.disk_phase", "phase of each leg", phase, ANGLE, explanation=f"the least {of_forms}"),
    ]  # fmt: skip
