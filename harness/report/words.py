"""Numbers and words in sentences: few digits, bounds rounded to the side on which they hold; the words of the field."""

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from gough_stewart.harness.report.quantities import LENGTH, Quantity

# Significant digits of a number in a sentence; tables have more.
DIGITS = 2
METRES = Quantity("m", "m")
_NEGATIVE = re.compile(r"(?<![^\s(±\[])-(?=\.?\d|∞)")


def about(
    quantity: Quantity, value: float | None, digits: int = DIGITS, side: Callable[[float], int] | None = None
) -> str:
    """A number with its unit and few digits; with `math.ceil` or `math.floor` rounded to that side."""
    shown = 0.0 if value is None else value * quantity.factor
    if side is not None and math.isfinite(shown) and shown != 0:
        step = 10.0 ** (math.floor(math.log10(abs(shown))) + 1 - digits)
        # what is 0.8 up to rounding errors stays 0.8
        value = side(round(shown / step, 9)) * step / quantity.factor
    return replace(quantity, digits=digits).text(value)


def exactly(quantity: Quantity, value: float, digits: int = DIGITS) -> str:
    """The same, also of what is below the resolution of display."""
    return about(quantity.telling(value), value, digits)


def at_most(quantity: Quantity, value: float, digits: int = DIGITS) -> str:
    """The same as an upper bound, rounded up: "within 0.81 mm" holds for 0.8012 mm.

    Lengths from a metre on are in metres; what is below the resolution of display is within that.
    """
    kind = METRES if quantity == LENGTH and abs(value) >= 1 else quantity
    return about(kind, value, digits, math.ceil).removeprefix("< ")


def at_least(quantity: Quantity, value: float, digits: int = DIGITS) -> str:
    """The same as a lower bound, rounded down."""
    return about(quantity, value, digits, math.floor)


def percent(share: float, digits: int = DIGITS) -> str:
    """A share in percent; 100 % only if it is 1: 99.96 % gets as many digits as that takes."""
    if not math.isfinite(share):
        return "beyond"
    for more in range(digits, 16):
        text = f"{100 * share:.{more}g}"
        text = f"{100 * share:.0f}" if "e+" in text else text
        if share == 1 or text != "100":
            return f"{text} %"
    return "100 %"


def counted(number: int, one: str, many: str | None = None) -> str:
    """A count with its noun: 1 member, 1,000 members."""
    return f"{number:,} {one if number == 1 else many or one + 's'}"


def listed(words: Sequence[str], last: str = "and") -> str:
    """Words with commas and a last conjunction."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}" if words else ""


def sentence(parts: Iterable[str | None]) -> str:
    """Parts of a verdict with semicolons between them, the first with a capital letter."""
    text = "; ".join(part for part in parts if part)
    return text[:1].upper() + text[1:]


def with_minus(text: str) -> str:
    """A text whose negative numbers have a minus sign instead of a hyphen, as on a page."""
    return _NEGATIVE.sub("−", text)


def number_text(value: float | None, digits: int = 4) -> str:
    """A number with at most this many significant digits."""
    return Quantity("", "", digits=digits).text(value)


def plain_text(value: Any) -> str:
    """A value of a file as text, numbers with six digits."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list):
        rows = [plain_text(item) for item in value]
        return "; ".join(rows) if value and isinstance(value[0], list) else ", ".join(rows)
    if isinstance(value, dict):
        return ", ".join(f"{key} {plain_text(item)}" for key, item in value.items())
    return str(value)


# docs/hooks/glossary.py shows them on the page of notation.
GLOSSARY: dict[str, str] = {
    "actuator force": "The force of a leg's actuator along the leg; positive extends the leg.",
    "bandwidth": "The frequency up to which the closed loop follows its reference, here where its gain falls by 3 dB.",
    "candidate": "A set of values that a search tries.",
    "Clopper–Pearson": "An exact confidence interval of a share that was counted among independent members.",
    "Co-Simulation": "The kind of FMU that has an integrator of its own.",
    "coherence": "The share of an output's power that a linear response to the input explains, from 0 to 1.",
    "condition number": "The largest over the smallest singular value of the leg Jacobian; large near singular poses.",
    "confidence interval": "A range whose method holds the true value in 95 % of cases, or in another stated share.",
    "constraint drift": "How far integration lets the parts of a mechanism move apart that should stay connected.",
    "crossover": "The frequency at which the gain of the open loop is 1.",
    "damping ratio": "How fast an oscillation decays: not at all at 0, without overshoot from 1 on.",
    "disk margin": "How far gain and phase of all legs may change at once, each independently, before it is unstable.",
    "eigenvalue": "A number of a linear system that says how a mode of it decays or grows, and how fast it oscillates.",
    "feedforward": "Actuator forces computed from the reference, before any error has occurred.",
    "FMU": "A model in a file that simulation tools import, as the standard FMI defines it.",
    "fresh member": "A member that a search did not use, drawn anew to test its result.",
    "gain margin": "The factor by which the gain of the loop, of all legs or of one, may change before it is unstable.",
    "growing loop": "A loop whose error rises without a cause from outside: unstable, though limits may bound it.",
    "home": "The pose in the middle of the strokes, at which the platform starts unless told otherwise.",
    "injection": "A force that is added in the loop to measure its frequency response.",
    "jitter": "A random delay of each sample.",
    "leg Jacobian": "The matrix that turns the platform's velocity into the velocities of the six legs.",
    "linear model": "The equations linearised at a pose at rest: no Coulomb friction, limits or rounding of sensors.",
    "median": "The value that half of the members stay below.",
    "member": "One of the machines that an ensemble runs, with parameters drawn for it.",
    "mode": "A motion of a linear system that decays or grows without input, with one frequency.",
    "Model Exchange": "The kind of FMU that the importing tool integrates.",
    "nominal": "The machine as the design assumes it, before anything is varied.",
    "overshoot": "How far a response goes beyond its final value, as a share of the step.",
    "phase margin": "The phase that the loop, all legs or one, may lose at its crossover before it is unstable.",
    "quantile": "The value that a stated share of the members stays below.",
    "quantisation": "The rounding of a measurement to the steps of its sensor.",
    "reference": "The pose that the platform is asked to follow.",
    "regressor": "The matrix that turns parameters into the forces that they cause in a log.",
    "residual": "What a fitted model leaves of a measured signal.",
    "rise time": "The time from 10 to 90 % of a step.",
    "RMS": "Root mean square: the square root of the mean of the squares over time.",
    "sensitivity": "The ratio of the error with feedback to the error without it, by frequency.",
    "settling time": "The time after which the error stays within its tolerance.",
    "singular pose": "A pose at which the legs cannot hold the platform in some direction.",
    "singular value": "A gain of a system with several inputs and outputs; the extremes are those of all directions.",
    "SSP": "A file with several connected FMUs, as the standard SSP defines it.",
    "stroke": "The range of lengths that a leg allows.",
    "tracking": "How well the true pose follows its reference.",
    "whiteness": "Whether values that follow each other are independent, as noise is.",
}


@cache
def _terms() -> tuple[re.Pattern[str], dict[str, str]]:
    terms = sorted(GLOSSARY, key=len, reverse=True)
    pattern = re.compile(rf"`[^`]+`|(?<![\w.])({'|'.join(map(re.escape, terms))})s?\b", re.IGNORECASE)
    return pattern, {term.casefold(): meaning for term, meaning in GLOSSARY.items()}


def with_terms(text: str) -> Markup:
    """A text as HTML, with the first of each word of the glossary marked for the page's explanations."""
    pattern, meanings = _terms()
    shown, marked, at, seen = with_minus(text), Markup(), 0, set()
    for match in pattern.finditer(text):
        word = (match[1] or "").casefold()
        if word in seen:
            continue
        marked += escape(shown[at : match.start()])
        if word:
            seen.add(word)
            marked += explained(match[0], meanings[word])
        else:
            marked += Markup("<code>{}</code>").format(match[0].strip("`"))
        at = match.end()
    return marked + escape(shown[at:])


def explained(text: str, explanation: str) -> Markup:
    """A text as HTML with its own explanation; without one, as `with_terms`."""
    if not explanation:
        return with_terms(text)
    return Markup('<span class="term" tabindex="0" data-means="{}">{}</span>').format(explanation, text)
