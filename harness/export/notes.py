"""What is said of an export: its delay, the stability of its loops, what it leaves out; inside it and to its maker."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from gough_stewart.harness.control.margins import Margins
from gough_stewart.harness.errors import UnstableLoopError
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.design import NOTHING, Carried
from gough_stewart.harness.export.left_out import left_out
from gough_stewart.harness.export.stability import (
    NO_FEEDBACK,
    Case,
    Host,
    LoopStability,
    StabilityReport,
    output_delay_of,
)

_NAMES_OF = {"sensors": "sensors", "actuators": "drives"}
NAMES: dict[Host, str] = {"c": "C", "fmu": "FMU", "ssp": "SSP", "run": "unit"}


@dataclass(frozen=True)
class Notes:
    """Of one form."""

    inside: tuple[str, ...]  # paragraphs for its documentation
    warnings: tuple[str, ...]  # for its maker
    verdicts: tuple[str, ...]  # on each loop, in one line


def notes_of(experiment: Experiment, host: Host, found: StabilityReport, carried: Carried = NOTHING) -> Notes:
    """The notes of a form of an experiment, as judged, with what it carries of the machine."""
    delay, changed = _delay(experiment, host, carried), _changed_delay(experiment, host)
    missing = [] if host == "run" else left_out(experiment, host, carried.parts)
    without = f"without {', '.join(missing)}: {_holds(host, carried)}" if missing else ""
    title = f"the {NAMES[host]} is"
    stability = _stability(found, carried)
    unstable = [f"{'run' if host == 'run' else 'exported'} anyway: {text}" for text in map(complaint, found.unstable)]
    not_judged = f"the stability of the loop of the {NAMES[host]} is not judged: {found.reason}"
    inside = [
        *_inside(experiment, carried),
        f"Delay: {delay}",
        *stability,
        f"Left out: {', '.join(missing)}." if missing else "Nothing of the experiment is left out.",
    ]
    warnings = [
        *([f"{title} {without}"] if without else []),
        *([f"{title} {changed}"] if changed else []),
        *([not_judged] if found.reason and found.reason != NO_FEEDBACK else []),
        *unstable,
    ]
    return Notes(tuple(inside), tuple(warnings), tuple(map(in_short, found.loops)))


def refusal(experiment: Experiment, judged: Iterable[tuple[Host, StabilityReport]]) -> UnstableLoopError | None:
    """The error for forms of which one loop or more is unstable."""
    loops = [(host, loop) for host, found in judged for loop in found.unstable]
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
        others = " and ".join(part for part in ("sensors", "actuators") if _NAMES_OF[part] not in carried.parts)
        own = f", with its {carried.words}" if carried.parts else ""
        return f"it holds the plant and the controller{own}, not the machine's {others or 'disturbances'}"
    if not carried.parts:
        return "it is the controller alone, not the machine around it"
    return f"it is the controller with its {carried.words}, not the machine around it"


def _inside(experiment: Experiment, carried: Carried) -> list[str]:
    """What is carried of the machine, and when."""
    found, T = [], experiment.loop.sample_time
    step = T / carried.steps_a_sample
    if carried.drives:
        found.append(
            "Drives: the forces are those that act, behind the force limit, the rate limit and the lag: their means "
            f"over each step of {1000 * step:g} ms."
        )
    if carried.sensors:
        often = (
            "at each sample"
            if carried.steps_a_reading is None
            else f"every {1000 * step * carried.steps_a_reading:g} ms"
        )
        found.append(f"Sensors: measurements are read {often}, and quantised; their noise is not part of it.")
    return found


def _delay(experiment: Experiment, host: Host, carried: Carried) -> str:
    own, late = _delay_of(experiment.loop.delay), output_delay_of(experiment)
    if host == "c":
        return (
            f"a step computes its forces at once; the experiment has {own} from measurement to force, and the machine "
            "should have the same."
        )
    long = (
        f"of {1000 * experiment.loop.sample_time / carried.steps_a_sample:g} ms" if carried.has_steps else "of a sample"
    )
    steps = f" This holds for communication steps {long} or less; longer ones add delay."
    if host == "fmu" and not carried.drives:
        around = f" The other {_samples(late - 1)} have to be around the unit." if late > 1 else ""
        return (
            f"the unit outputs the forces of a sample one sample later (output_delay = 1). The experiment has {own}; "
            f"the feedforward is computed for {_samples(late)}.{around}{steps}"
        )
    more = "" if experiment.loop.delay else ", but a unit needs one sample"
    return (
        f"forces act {_samples(late)} after their measurement (output_delay = {late}); the experiment has {own}{more}."
        + steps
    )


def _changed_delay(experiment: Experiment, host: Host) -> str:
    if host in ("run", "c") or experiment.loop.delay:
        return ""
    return "one sample late, where the experiment has no delay: a unit outputs the forces of a sample at the next one"


def _stability(found: StabilityReport, carried: Carried) -> list[str]:
    if not found.loops:
        return [f"Stability: not judged, since {found.reason}."]
    return [
        *(_verdict(loop) for loop in found.loops),
        *dict.fromkeys(text for loop in found.loops for text in _margins(loop)),
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
        own = "" if loop.worst.loop == loop.nominal.loop else f",{_circumstances(loop.worst)}"
        parts.append(f"{loop.members} members of [ensemble] at most {_size(loop.worst)} ({loop.worst.what}{own})")
    if loop.impossible:
        parts.append(f"impossible members, which are not judged: {loop.impossible}")
    return f"Stability {loop.surroundings.where}{_circumstances(loop.nominal)}: {verdict}; {'; '.join(parts)}."


def _margins(loop: LoopStability) -> list[str]:
    found = [] if loop.margins is None else [(loop.nominal, loop.margins)]
    found += [] if loop.margins_of_worst is None else [loop.margins_of_worst]
    return [f"Margins of {case.what}{_circumstances(case)}: {_in_words(margins)}." for case, margins in found]


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
    worst, margins = loop.worst_of_all, [loop.margins, loop.margins_of_worst and loop.margins_of_worst[1]]
    alpha = min((each.disk.alpha for each in margins if each is not None), default=None)
    known = "" if alpha is None else f", disk margin {alpha:.3g}"
    return (
        f"{'stable' if loop.is_stable else 'UNSTABLE'} {loop.surroundings.where}{_circumstances(worst)}: |z| = "
        f"{worst.size:.5g} ({worst.what}){known}"
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
