"""Names of quantities that can be estimated: elements of a platform's parameters, and offsets of a log."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from gough_stewart.harness.errors import IdentificationError
from gough_stewart.model.interface import nearest
from gough_stewart.model.parameters import PHYSICAL
from gough_stewart.model.platform import Platform

_ROWS = {row.name: row for row in PHYSICAL if not row.words}
# Quantities of a log, not of the platform: shape and unit. Their nominal value is 0, that of a gain 1.
OF_LOGS: dict[str, tuple[tuple[int, ...], str]] = {
    "leg_length_offset": ((6,), "m"),
    "force_gain": ((6,), ""),
    "force_offset": ((6,), "N"),
    "delay": ((), "s"),
    "base_tilt": ((2,), "rad"),
}
# One value for all legs, or six.
PER_LEG = ("leg_viscous_friction", "leg_coulomb_friction")
_ELEMENT = re.compile(r"(\w+)\[(\d+)(?:,(\d+))?\]")


def expanded(names: Iterable[str], platform: Platform) -> tuple[str, ...]:
    """The elements of these names: `platform_com` means its three, `leg_viscous_friction[1..6]` one per leg.

    For the symmetric inertia, the six with ascending indices.

    Raises
    ------
    IdentificationError
        An unknown parameter, or a repeated one; names it, and the nearest.
    """
    elements: list[str] = []
    for name in map(str.strip, names):
        stem = name.partition("[")[0]
        if stem not in _ROWS and stem not in OF_LOGS:
            raise IdentificationError(f"estimate: no parameter '{name}'{nearest(stem, [*_ROWS, *OF_LOGS])}", [name])
        if name in (stem, f"{stem}[1..6]"):
            six = name != stem and stem in PER_LEG
            elements += _elements(stem, (6,) if six else _shape(stem, platform))
        elif name in _elements(stem, (6,) if stem in PER_LEG else _shape(stem, platform)):
            elements.append(name)
        else:
            raise IdentificationError(
                f"estimate: no element '{name}'; {stem} has {', '.join(_elements(stem, _shape(stem, platform)))}",
                [name],
            )
    twice = sorted({n for n in elements if elements.count(n) > 1 or (n in PER_LEG and f"{n}[" in "".join(elements))})
    if twice:
        raise IdentificationError(f"estimate: {', '.join(twice)} is repeated; expected every parameter once", twice)
    if not elements:
        raise IdentificationError("estimate: no names; expected parameters such as platform_mass,platform_com")
    return tuple(elements)


def unit_of(element: str) -> str:
    """The unit of an element [SI]."""
    stem = element.partition("[")[0]
    return _ROWS[stem].unit if stem in _ROWS else OF_LOGS[stem][1]


def value_of(platform: Platform, element: str) -> float:
    """The platform's value of an element; for quantities of a log that of a perfect one."""
    stem, index = place_of(element)
    if stem in OF_LOGS:
        return 1.0 if stem == "force_gain" else 0.0
    value = np.asarray(getattr(platform, stem))
    if index and stem in PER_LEG:
        return float(value * getattr(platform, f"{stem}_factor")[index])
    return float(value if value.ndim == 0 else value[index])


def with_values(platform: Platform, values: Mapping[str, float]) -> Platform:
    """The platform with other values, validated again; quantities of a log are left out.

    Raises
    ------
    PlatformError
        Impossible values.
    """
    changed: dict[str, Any] = {}
    for element, value in values.items():
        stem, index = place_of(element)
        if stem in OF_LOGS:
            continue
        if stem not in changed:
            changed[stem] = np.array(getattr(platform, stem), dtype=float)
            if index and stem in PER_LEG:
                changed[stem] = changed[stem] * getattr(platform, f"{stem}_factor")
        changed[stem][index] = value
        if stem == "platform_inertia":
            changed[stem][index[::-1]] = value
    for stem in [stem for stem in PER_LEG if np.ndim(changed.get(stem, 0.0))]:
        # as stored in the platform: the mean of the legs, and each leg's factor
        of_legs = changed[stem]
        mean = of_legs.mean()
        changed |= {stem: mean, f"{stem}_factor": of_legs / mean if mean > 0 else np.ones(6)}
    return replace(platform, **{stem: value if value.ndim else value.item() for stem, value in changed.items()})


def _shape(stem: str, platform: Platform) -> tuple[int, ...]:
    return OF_LOGS[stem][0] if stem in OF_LOGS else np.shape(getattr(platform, stem))


def _elements(stem: str, shape: tuple[int, ...]) -> list[str]:
    indices = product(*(range(1, n + 1) for n in shape))
    if stem == "platform_inertia":
        indices = ((a, b) for a, b in indices if a <= b)  # type: ignore[assignment]
    return [f"{stem}[{','.join(map(str, index))}]" if index else stem for index in indices]


def place_of(element: str) -> tuple[str, tuple[int, ...]]:
    """The parameter, and the index of the element in it, from 0."""
    match = _ELEMENT.fullmatch(element)
    if match is None:
        return element, ()
    stem, *digits = match.groups()
    return stem, tuple(int(d) - 1 for d in digits if d is not None)
