"""The words of the field, which pages explain, and texts as pages have them."""

import re
from functools import cache

from markupsafe import Markup, escape

_NEGATIVE = re.compile(r"(?<![^\s(±\[])-(?=\.?\d|∞)")


def with_minus(text: str) -> str:
    """A text whose negative numbers have a minus sign instead of a hyphen, as on a page."""
    return _NEGATIVE.sub("−", text)


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
