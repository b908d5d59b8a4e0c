"""What an export wrote, as a report: in which forms, whether each form's loop is stable, what they leave out."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from gough_stewart.harness.export.stability import Host, LoopStability, StabilityReport
from gough_stewart.harness.report.document import Note, Number, Report, Section, Status, Verdict
from gough_stewart.harness.report.quantities import ANGLE, COUNT, DECIBEL, NUMBER
from gough_stewart.harness.report.table import Column, Table
from gough_stewart.harness.report.words import listed, sentence

_NAMES: Mapping[str, str] = {"c": "C", "fmu": "FMU", "ssp": "SSP", "page": "live page"}


def robustness_of(loop: LoopStability) -> float:
    """The smallest disk margin that is known of a loop; 0 of an unstable one, infinite if none is known."""
    if not loop.is_stable:
        return 0.0
    known = [loop.margins] if loop.margins is not None else []
    known += [loop.margins_of_worst[1]] if loop.margins_of_worst is not None else []
    return min((each.disk.alpha for each in known), default=math.inf)


def least_robust_first(found: Mapping[Host, StabilityReport]) -> list[LoopStability]:
    """All loops that were judged, the one with the smallest disk margin first."""
    return sorted((loop for each in found.values() for loop in each.loops), key=robustness_of)


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
    numbers = _numbers(loops)
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


def _numbers(loops: Sequence[LoopStability]) -> list[Number]:
    """The least margins of the loops, with the delay that each form has; 0 of an unstable loop."""
    if not loops:
        return []
    each = "of the forms' loops, with the delay that each form has"
    least = loops[0]
    found = [m for m in (least.margins, least.margins_of_worst and least.margins_of_worst[1]) if m is not None]
    disk = min((m.disk for m in found), key=lambda one: one.alpha, default=None)
    known = (None, None, None) if disk is None else (disk.alpha, 20 * math.log10(disk.gain[1]), disk.phase)
    alpha, gain, phase = known if least.is_stable else (0.0, 0.0, 0.0)
    return [
        Number("stability.largest_eigenvalue", "largest |z|", max(loop.worst_of_all.size for loop in loops),
               explanation=f"largest magnitude of an eigenvalue {each}; stable below 1"),
        Number("margins.disk", "disk margin", alpha, explanation=f"the least {each}"),
        Number("margins.disk_gain", "gain of each leg", gain, DECIBEL, explanation=f"the least {each}"),
        Number("margins.disk_phase", "phase of each leg", phase, ANGLE, explanation=f"the least {each}"),
    ]  # fmt: skip
