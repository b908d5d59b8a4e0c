"""What is said of an export: its delay, the stability of its loops, what it leaves out; inside it and to its maker."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gough_stewart.harness.errors import UnstableLoopError
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.choices import NOTHING, Carried, Part
from gough_stewart.harness.export.stability import (
    NO_FEEDBACK,
    Delays,
    Host,
    LoopStability,
    StabilityReport,
    output_delay_of,
)
from gough_stewart.harness.report.document import Column, Note, Number, Report, Section, Status, Table, Verdict
from gough_stewart.harness.report.quantities import ANGLE, COUNT, DECIBEL, NUMBER, listed, sentence
from gough_stewart.harness.section import Kind

_NAMES: dict[str, str] = {"c": "C", "fmu": "FMU", "ssp": "SSP", "run": "unit", "page": "live page"}


class Notes(NamedTuple):
    """Of one form."""

    inside: tuple[str, ...]  # paragraphs for its documentation
    warnings: tuple[str, ...]  # for its maker


def notes_of(  # noqa: PLR0912, PLR0915 - a note after the other
    experiment: Experiment, host: Host, judged: StabilityReport, carried: Carried = NOTHING
) -> Notes:
    """The notes of a form of an experiment, as judged, with what it carries of the machine."""
    name, inside, warnings = _NAMES[host], list[str](), list[str]()
    words = " and ".join(part for part in carried.parts if part != "manual")
    step = 1000 * experiment.loop.sample_time / carried.steps_a_sample  # [ms]

    # what it carries
    if "drives" in carried.parts:
        inside.append(
            "Drives: the forces are those that act, behind the force limit, the rate limit and the lag: their means "
            f"over each step of {step:g} ms."
        )
    if "sensors" in carried.parts:
        reading = carried.steps_a_reading
        often = "at each sample" if reading is None else f"every {step * reading:g} ms"
        inside.append(f"Sensors: measurements are read {often}, and quantised; their noise is not part of it.")
    if "manual" in carried.parts:
        inside.append(
            "Manual: while `enabled` is 0 the forces follow `manual_force`; the stability is that of the loop on."
        )

    # its delay
    delay, late = _samples(experiment.loop.delay, delay=True), output_delay_of(experiment)
    longest = f"{step:g} ms" if carried.has_steps else "a sample"
    steps = f" This holds for communication steps of {longest} or less; longer ones add delay."
    if host == "c":
        text = (
            f"a step computes its forces at once; the experiment has {delay} from measurement to force, and the "
            "machine should have the same."
        )
    elif host == "fmu" and "drives" not in carried.parts:
        around = f" The rest, {_samples(late - 1)}, has to be around the unit." if late > 1 else ""
        text = (
            f"the unit outputs the forces of a sample one sample later (output_delay = 1). The experiment has {delay}; "
            f"the feedforward is computed for {_samples(late)}.{around}{steps}"
        )
    else:
        more = "" if experiment.loop.delay else ", but a unit needs one sample"
        text = (
            f"forces act {_samples(late)} after their measurement (output_delay = {late}); the experiment has "
            f"{delay}{more}.{steps}"
        )
    inside.append(f"Delay: {text}")

    # its stability
    texts = list[str]()
    for loop in judged.loops:
        named = [(loop.nominal.what, loop.nominal)]
        named += [("along the motion at most", loop.on_the_way)] * (loop.poses > 1)
        named += [(case.what, case) for case in loop.changed]
        if loop.worst is not None:
            named.append((f"{loop.members} members of [ensemble] at most", loop.worst))
        parts = [f"{what} |z| = {case.size:.5g} ({case.frequency:.3g} Hz)" for what, case in named]
        if loop.poses > 1:
            parts[1] += f" ({loop.poses} poses)"
        if loop.worst is not None:
            others = "" if loop.worst.loop == loop.nominal.loop else f",{_with(loop.worst.loop)}"
            parts[-1] += f" ({loop.worst.what}{others})"
        if loop.impossible:
            parts.append(f"impossible members, which are not judged: {loop.impossible}")
        verdict = "stable" if loop.is_stable else f"UNSTABLE, and exported on request: {complaint(loop)}"
        inside.append(f"Stability {loop.surroundings.where}{_with(loop.nominal.loop)}: {verdict}; {'; '.join(parts)}.")
        margins_of = [] if loop.margins is None else [(loop.nominal, loop.margins)]
        margins_of += [] if loop.margins_of_worst is None else [loop.margins_of_worst]
        for case, margins in margins_of:
            disk, legs = margins.disk, margins.legs
            up, down = min(leg.gain_up for leg in legs), max(leg.gain_down for leg in legs)
            phase, late_by = min(leg.phase for leg in legs), min(leg.delay for leg in legs)
            texts.append(
                f"Margins of {case.what}{_with(case.loop)}: all legs at once disk margin {disk.alpha:.3g}, gains × "
                f"{disk.gain[0]:.3g} to {disk.gain[1]:.3g}, phases ± {np.degrees(disk.phase):.3g}°; one leg at a time "
                f"gain × {down:.3g} to {up:.3g}, phase {np.degrees(phase):.3g}°, delay {1000 * late_by:.3g} ms."
            )
    inside += dict.fromkeys(texts)
    if judged.loops:
        part = (
            "The lag of the drives was part of it, quantisation was not."
            if "drives" in carried.parts
            else "Of what is left out, only a lag, a sensors' clock and jitter that are named here were part of it."
        )
        inside.append(
            "Judged by the eigenvalues z of the sampled loop, linearised at rest, without Coulomb friction and limits. "
            + part
        )
    else:
        inside.append(f"Stability: not judged, since {judged.reason}.")

    # what it leaves out
    missing = [] if host == "run" else left_out(experiment, host, carried.parts)
    inside.append(f"Left out: {', '.join(missing)}." if missing else "Nothing of the experiment is left out.")
    if missing:
        if host == "ssp":
            of_machine = {"sensors": "sensors", "drives": "actuators"}
            others = " and ".join(text for part, text in of_machine.items() if part not in carried.parts)
            holds = f"holds the plant and the controller{f', with its {words}' * bool(words)}"
            holds += f", not the machine's {others or 'disturbances'}"
        else:
            holds = f"is the controller {f'with its {words}' if words else 'alone'}, not the machine around it"
        warnings.append(f"the {name} is without {', '.join(missing)}: it {holds}")
    if host in ("fmu", "ssp") and not experiment.loop.delay:
        warnings.append(
            f"the {name} is one sample late, where the experiment has no delay: a unit outputs the forces of a "
            "sample at the next one"
        )
    if judged.reason and judged.reason != NO_FEEDBACK:
        warnings.append(f"the stability of the loop of the {name} is not judged: {judged.reason}")
    warnings += [f"{'run' if host == 'run' else 'exported'} on request: {complaint(loop)}" for loop in judged.unstable]
    return Notes(tuple(inside), tuple(warnings))


def refusal(experiment: Experiment, judged: Iterable[tuple[Host, StabilityReport]]) -> UnstableLoopError | None:
    """The error for forms of which one loop or more is unstable."""
    loops = [(host, loop) for host, report in judged for loop in report.unstable]
    if not loops:
        return None
    texts = [complaint(loop) for _, loop in loops]
    remedies = [loop.remedy for _, loop in loops if loop.remedy]
    on_request = "--allow-unstable (allow_unstable=True) exports it, with a note inside"
    if loops[0][0] == "run":
        on_request = "--allow-unstable runs it"
    parts = [*dict.fromkeys(texts), *dict.fromkeys(remedies), on_request]
    return UnstableLoopError(f"{experiment.where}: {'; '.join(parts)}", loops[0][1].worst_of_all.eigenvalue)


def complaint(loop: LoopStability) -> str:
    """What is unstable: where, by how much, for which machine."""
    worst = loop.worst_of_all
    text = (
        f"{loop.surroundings.where} the closed loop is unstable{_with(worst.loop)}: |z| = {worst.size:.5g} at "
        f"{worst.frequency:.3g} Hz for {worst.what}, expected below 1"
    )
    if loop.unstable:
        text += f" ({loop.unstable} of {loop.members} members are unstable)"
    return text


def in_short(loop: LoopStability) -> str:
    """A loop in one line."""
    worst, robustness = loop.worst_of_all, "" if loop.disk is None else f", disk margin {loop.disk.alpha:.3g}"
    return (
        f"{'stable' if loop.is_stable else 'UNSTABLE'} {loop.surroundings.where}{_with(worst.loop)}: |z| = "
        f"{worst.size:.5g} ({worst.what}){robustness}"
    )


def _with(loop: Delays) -> str:
    """What makes a loop late, in words."""
    late = f", up to {1000 * loop.late:.4g} ms by the sensors' clock and jitter" if loop.late else ""
    lag = f" and a lag of {1000 * loop.lag:.3g} ms" if loop.lag else ""
    return f" with {_samples(loop.delay, delay=True)}{late}{lag}"


def _samples(number: int, delay: bool = False) -> str:
    """A number of samples, or of a delay, in words."""
    text = "1 sample" if number == 1 else f"{number} samples"
    return text if not delay else f"a delay of {text}" if number else "no delay"


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
    carried |= {"sensors.side"} if host == "ssp" else set()  # which is connected
    missing = list[str]()
    for section, table in experiment.model_dump(exclude_defaults=True).items():
        if section in _HAS or section in (*around, "ensemble"):
            continue
        # keys that are not at their defaults; a section of a kind, such as an injection, is one thing
        is_one = not isinstance(table, dict) or isinstance(getattr(experiment, section), Kind)
        for key, value in {section: table}.items() if is_one else table.items():
            path = section if is_one else f"{section}.{key}"
            is_set = any(value.values()) if isinstance(value, dict) else value not in (None, [], 0)
            if is_set and path not in _HAS | carried and value not in _HARMLESS.get(path, ()):
                missing.append(path)
    if experiment.ensemble is not None:
        together = (key for inputs in experiment.ensemble.covariance for key in inputs.of)
        for key in (*experiment.ensemble.varied, *together):
            path = key if "." in key else f"plant.{key}"  # a bare name is of the machine
            section = path.split(".")[0]
            if section not in around and not any(path.startswith(name) for name in missing):
                missing.append(_OTHER_MACHINES if section in _OF_PLANT else f"ensemble.{key}")
    return list(dict.fromkeys(missing))


# --- the report -----------------------------------------------------------------------------------------


def robustness_of(loop: LoopStability) -> float:
    """The smallest disk margin that is known of a loop; 0 of an unstable one, infinite if none is known."""
    of_stable = math.inf if loop.disk is None else loop.disk.alpha
    return of_stable if loop.is_stable else 0.0


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

    # the least margins of the loops, with the delay that each form has; 0 of an unstable loop
    numbers, of_forms = list[Number](), "of the forms' loops, with the delay that each form has"
    if loops:
        disk = loops[0].disk
        known = (None, None, None) if disk is None else (disk.alpha, 20 * math.log10(disk.gain[1]), disk.phase)
        alpha, gain, phase = known if loops[0].is_stable else (0.0, 0.0, 0.0)
        numbers = [
            Number("stability.largest_eigenvalue", "largest |z|", max(loop.worst_of_all.size for loop in loops),
                   explanation=f"largest magnitude of an eigenvalue {of_forms}; stable below 1"),
            Number("margins.disk", "disk margin", alpha, explanation=f"the least {of_forms}"),
            Number("margins.disk_gain", "gain of each leg", gain, DECIBEL, explanation=f"the least {of_forms}"),
            Number("margins.disk_phase", "phase of each leg", phase, ANGLE, explanation=f"the least {of_forms}"),
        ]  # fmt: skip

    # a row for each loop: its delay, the case that is nearest to instability, its disk margin
    columns = (
        *(Column("loop"), Column("outcome"), Column("delay in samples", COUNT)),
        *(Column("largest |z|", replace(NUMBER, digits=5)), Column("of"), Column("disk margin", NUMBER)),
    )
    rows = []
    for loop in loops:
        worst, outcome = loop.worst_of_all, "stable" if loop.is_stable else "UNSTABLE"
        case = worst.loop.delay, worst.size, worst.what, robustness_of(loop)
        rows.append((loop.surroundings.where, outcome, *case))
    table = Table("Loops of the forms, the least robust first", columns, tuple(rows))
    status: Status = "bad" if unstable else "good" if verdicts else "told"
    return Report(
        title,
        Verdict(sentence([f"written as {names}", judged]), status, tuple(numbers[:2])),
        (Section("Stability", (table,)),) if loops else (),
        study="export",
        numbers=(Number("files", "files written", float(len(files)), COUNT), *numbers),
        notes=tuple(Note(text, "warning") for text in warnings),
    )
