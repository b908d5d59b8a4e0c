"""NAME.h: what a caller of an exported controller sees, by the template runtime/controller.h.in."""

from collections.abc import Iterable, Mapping
from textwrap import fill

from jinja2 import Environment, StrictUndefined

from gough_stewart.harness.control.drive import TRANSFER_TIME
from gough_stewart.harness.export.design import Designed, Ranges
from gough_stewart.harness.export.laws import FunctionLaw
from gough_stewart.harness.export.trace import Traced
from gough_stewart.model.parameters import Variable

# Comments in ASCII, for every compiler and editor.
_ASCII = str.maketrans({"×": "x", "±": "+-", "°": " deg", "–": "-", "—": "-", "µ": "u"})


def header(
    template: str,
    designed: Designed,
    functions: Traced,
    switches: Mapping[str, int],
    work: str,
    flash: tuple[int, int],
    deviation: str = "",
) -> str:
    """The header of a controller.

    `switches` are those of the runtime; `work` are the operations per step and `deviation` what single precision costs,
    in words; `flash` are bytes of constants in double and in single precision.
    """
    measured, reference = designed.measured, designed.reference_variables
    safe_forces = (
        "0",
        f"the feedforward{', of the last good reference if that is the fault' if reference else ''}",
        "`start_force`, since there is no feedforward",
    )
    ranges = _ranges(measured, designed.ranges)
    environment = Environment(undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {"comment": _comment, "plain": plain_c}
    text = environment.from_string(template).render(
        switches,
        design=designed,
        title=title_of(designed),
        ordinal=_ordinal,
        work=work,
        flash=flash,
        deviation=deviation,
        transfer_time=TRANSFER_TIME,
        frozen=designed.faults.frozen,
        components=[(c.coefficients.name_out(0), c.coefficients.numel_out(0)) for c in functions.components],
        measured=", ".join(f"{v.name}[{v.size}] [{v.unit}]" for v in measured) or "nothing",
        ranges=f"{ranges}; of the reference: {_ranges(reference, designed.ranges)}" if reference else ranges,
        safe=safe_forces[switches["SAFE_FORCE"]],
        is_function=isinstance(designed.law, FunctionLaw),
    )
    return f"{text}\n"


def title_of(designed: Designed) -> str:
    """Title, law and feedforward in a comment."""
    title = " ".join(designed.title.replace("*/", "").replace("/*", "").split())
    law = "no feedback" if designed.law is None else designed.law.name
    return f"{title}: {law}, feedforward: {designed.feedforward.replace('_', ' ')}"


def plain_c(text: str) -> str:
    """A text that does not end the comment that it is in."""
    plain = text.translate(_ASCII).encode("ascii", "replace").decode()
    return plain.replace("*/", "* /").replace("/*", "/ *").replace("\\", "/")


def _comment(text: str) -> str:
    """A comment, whose paragraphs are filled to at most 120 characters; those with aligned columns stay."""
    lines = list[str]()
    for paragraph in text.replace("\\\n", "").split("\n"):
        if "  " in paragraph:
            lines.append(paragraph.rstrip())
        elif paragraph or (lines and lines[-1]):
            lines += fill(paragraph, 117, subsequent_indent="  " * paragraph.startswith("- ")).split("\n")
    return "/* " + "\n".join(f"   {line}".rstrip() for line in lines)[3:].rstrip() + " */"


def _ordinal(n: int) -> str:
    """In words: `step`, `3rd step`."""
    ending = {1: "st", 2: "nd", 3: "rd"}.get(n % 10 if n % 100 not in (11, 12, 13) else 0, "th")
    return "step" if n == 1 else f"{n}{ending} step"


def _ranges(variables: Iterable[Variable], ranges: Ranges) -> str:
    texts = []
    for v in variables:
        ends = [f"{low:.6g} to {high:.6g}" for low, high in zip(*ranges.of(v), strict=True)]
        # once for all elements, if it is the same
        texts.append(f"{v.name} {ends[0] if len(set(ends)) == 1 else ', '.join(ends)} {v.unit}")
    return "; ".join(texts) or "none, since nothing comes in"
