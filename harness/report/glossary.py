"""Words of the field that reports use, and what they mean; the page explains each where a reader points at it."""

import html
import re
from functools import cache

# docs/notation.md lists the same words.
GLOSSARY: dict[str, str] = {
    "actuator force": "The force of a leg's actuator along the leg; positive extends the leg.",
    "bandwidth": "The frequency up to which the closed loop follows its reference, here where its gain falls by 3 dB.",
    "coherence": "The share of an output's power that a linear response to the input explains, from 0 to 1.",
    "condition number": "The largest over the smallest singular value of the leg Jacobian; large near singular poses.",
    "confidence interval": (
        "A range from a method that holds the true value in the stated share of cases, 95 % unless said otherwise."
    ),
    "crossover": "The frequency at which the gain of the open loop is 1.",
    "disk margin": "How far gain and phase of the loop may change at once, at any frequency, before it is unstable.",
    "feedforward": "Actuator forces computed from the reference, before any error has occurred.",
    "gain margin": "The factor by which the loop's gain may change before it is unstable.",
    "growing loop": (
        "A loop whose error rises without a cause from outside: it is unstable, though limits may bound it."
    ),
    "home": "The pose in the middle of the strokes, at which the platform starts unless told otherwise.",
    "jitter": "A random delay of each sample.",
    "leg Jacobian": "The matrix that turns the platform's velocity into the velocities of the six legs.",
    "median": "The value that half of the members stay below.",
    "member": "One of the machines that an ensemble runs, with parameters drawn for it.",
    "nominal": "The machine as the design assumes it, before anything is varied.",
    "overshoot": "How far a response goes beyond its final value, as a share of the step.",
    "phase margin": "The phase that the loop may lose at its crossover before it is unstable.",
    "quantile": "The value that a stated share of the members stays below.",
    "reference": "The pose that the platform is asked to follow.",
    "residual": "What a fitted model leaves of a measured signal.",
    "RMS": "Root mean square: the square root of the mean of the squares over time.",
    "sensitivity": "The ratio of the error with feedback to the error without it, by frequency.",
    "settling time": "The time after which the error stays within its tolerance.",
    "singular pose": "A pose at which the legs cannot hold the platform in some direction.",
    "stroke": "The range of lengths that a leg allows.",
    "tracking": "How well the true pose follows its reference.",
    "whiteness": "Whether values that follow each other are independent, as noise is.",
}

_CODE = re.compile(r"`([^`<>]+)`")


@cache
def _words() -> re.Pattern[str]:
    terms = sorted(GLOSSARY, key=len, reverse=True)
    return re.compile(rf"\b({'|'.join(map(re.escape, terms))})(s?)\b", re.IGNORECASE)


@cache
def _by_word() -> dict[str, str]:
    return {term.casefold(): meaning for term, meaning in GLOSSARY.items()}


def with_terms(text: str) -> str:
    """A text as HTML, with the first of each word of the glossary marked for the page's explanations."""
    found, at, seen = [], 0, set()
    for match in _words().finditer(text):
        word = match[1].casefold()
        if word in seen:
            continue
        seen.add(word)
        found += [html.escape(text[at : match.start()]), _term(match[0], _by_word()[word])]
        at = match.end()
    return _CODE.sub(r"<code>\1</code>", "".join(found) + html.escape(text[at:]))


def explained(text: str, explanation: str) -> str:
    """A text as HTML with its own explanation; without one, as `with_terms`."""
    return _term(text, explanation) if explanation else with_terms(text)


def _term(text: str, meaning: str) -> str:
    return f'<span class="term" tabindex="0" data-means="{html.escape(meaning)}">{html.escape(text)}</span>'
