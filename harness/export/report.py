"""What an export wrote, as a report: in which forms, whether each form's loop is stable, what they leave out."""

import math
from collections.abc import Iterable, Mapping, Sequence

from gough_stewart.harness.export.stability import Host, LoopStability, StabilityReport
from gough_stewart.harness.report.document import Column, Note, Number, Report, Section, Status, Table, Verdict
from gough_stewart.harness.report.words import listed, sentence

_NAMES: Mapping[str, str] = {"c": "C", "fmu": "FMU", "clocked": "clocked FMU", "ssp": "SSP", "page": "live page"}


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
    title: str, forms: Sequence[str], verdicts: Sequence[str], warnings: Iterable[str], files: Sequence[str]
) -> Report:
    """The report of an export; `verdicts` on the loops of its forms, the least robust first."""
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
        judged = f"stable in all {len(verdicts)} loops that it is made for; least robust: {least}"
    table = Table(
        "Loops of the forms, the least robust first", (Column("judged"),), tuple((text,) for text in verdicts)
    )
    status: Status = "bad" if unstable else "good" if verdicts else "told"
    return Report(
        title,
        Verdict(sentence([f"written as {names}", judged]), status),
        (Section("Stability", (table,)),) if verdicts else (),
        study="export",
        numbers=(Number("files", "files written", float(len(files))),),
        notes=tuple(Note(text, "warning") for text in warnings),
    )
