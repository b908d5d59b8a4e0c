"""What a hypothesis says is wrong, in words with its estimate."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from gough_stewart.model.vectors import FloatArray

CALIBRATE = "calibrate by poses (geometry)"
# Of families whose parameters a log of forces does not determine.
WITHOUT_ESTIMATE = {
    "joints": f"joints are not where the platform's file has them; {CALIBRATE}",
    "stiction": "friction of a leg that starts to slide is not that of the model (stiction, elastic contact)",
}


def finding_text(family: str, names: Sequence[str], values: FloatArray, errors: FloatArray) -> str:
    """A sentence with estimates and 95 % intervals.

    Parameters
    ----------
    family
        One of `hypotheses`.
    names, values, errors
        Elements, values and standard errors (q,) [SI].
    """
    return _TEXTS[family](names, values, 1.96 * errors)


def _gain(names: Sequence[str], values: FloatArray, half: FloatArray) -> str:
    if len(names) == 1:
        high = "high" if values[0] > 1 else "low"
        return f"forces of leg {_leg(names[0])} read {_with(100 * abs(values[0] - 1), 100 * half[0])} % {high}"
    shares = _each(names, 100 * (values - 1), 100 * half, _signed)
    return f"forces read high or low, relative to the mean of the legs, in %: {shares}"


def _delay(_names: Sequence[str], values: FloatArray, half: FloatArray) -> str:
    late = "late" if values[0] > 0 else "early"
    return f"forces are {_with(1e3 * abs(values[0]), 1e3 * half[0])} ms {late}, relative to lengths"


def _force_offset(names: Sequence[str], values: FloatArray, half: FloatArray) -> str:
    if len(names) == 1:
        high = "high" if values[0] > 0 else "low"
        return f"forces of leg {_leg(names[0])} read {_with(abs(values[0]), half[0])} N too {high}"
    return f"forces have offsets, in N: {_each(names, values, half, _signed)}"


def _tilt(_names: Sequence[str], values: FloatArray, half: FloatArray) -> str:
    degrees, h = np.degrees(values), np.degrees(half)
    return f"the base is tilted by {_signed(degrees[0], h[0])}° about X, {_signed(degrees[1], h[1])}° about Y"


def _friction(names: Sequence[str], values: FloatArray, half: FloatArray) -> str:
    texts = []
    for kind, said, unit in (("viscous", "viscous", "N·s/m"), ("coulomb", "Coulomb", "N")):
        here = [k for k, name in enumerate(names) if kind in name]
        if here:
            own = _each([names[k] for k in here], values[here], half[here], _with)
            texts.append(f"{said} {own} {unit}")
    return f"friction differs among legs: {'; '.join(texts)}"


def _length_offset(names: Sequence[str], values: FloatArray, half: FloatArray) -> str:
    return f"lengths have offsets, in mm: {_each(names, 1e3 * values, 1e3 * half, _signed)}; {CALIBRATE}"


_TEXTS: dict[str, Callable[[Sequence[str], FloatArray, FloatArray], str]] = {
    "gain of forces": _gain,
    "delay of forces": _delay,
    "offset of forces": _force_offset,
    "tilt of the base": _tilt,
    "friction of each leg": _friction,
    "offset of lengths": _length_offset,
}


def _each(names: Sequence[str], values: FloatArray, half: FloatArray, write: Callable[[float, float], str]) -> str:
    return ", ".join(f"leg {_leg(name)} {write(v, h)}" for name, v, h in zip(names, values, half, strict=True))


def _leg(name: str) -> str:
    return name[name.index("[") + 1 : -1]


def _with(value: float, half: float) -> str:
    """Value ± half the interval, rounded to the latter's second digit."""
    digits = _digits(half)
    return f"{value:.{digits}f} ± {half:.{digits}f}"


def _signed(value: float, half: float) -> str:
    digits = _digits(half)
    return f"{value:+.{digits}f} ± {half:.{digits}f}".replace("-", "−")


def _digits(half: float) -> int:
    return 3 if not (half > 0 and math.isfinite(half)) else int(np.clip(1 - math.floor(math.log10(half)), 0, 9))
