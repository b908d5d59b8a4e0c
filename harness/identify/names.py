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

_UNITS = {row.name: row.unit for row in PHYSICAL if not row.words}
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
    """

    def elements_of(stem: str, *, is_each_leg: bool = False) -> list[str]:
        shape = OF_LOGS[stem][0] if stem in OF_LOGS else np.shape(getattr(platform, stem))
        indices = product(*(range(1, n + 1) for n in ((6,) if is_each_leg else shape)))
        return [
            f"{stem}[{','.join(map(str, index))}]" if index else stem
            for index in indices
            if stem != "platform_inertia" or index[0] <= index[1]
        ]

    elements: list[str] = []
    for name in map(str.strip, names):
        stem = name.partition("[")[0]
        if stem not in _UNITS and stem not in OF_LOGS:
            raise IdentificationError(f"estimate: no parameter '{name}'{nearest(stem, [*_UNITS, *OF_LOGS])}", [name])
        if name in (stem, f"{stem}[1..6]"):
            elements += elements_of(stem, is_each_leg=name != stem and stem in PER_LEG)
        elif name in elements_of(stem, is_each_leg=stem in PER_LEG):
            elements.append(name)
        else:
            raise IdentificationError(
                f"estimate: no element '{name}'; {stem} has {', '.join(elements_of(stem))}", [name]
            )
    twice = sorted({n for n in elements if elements.count(n) > 1 or (n in PER_LEG and f"{n}[" in "".join(elements))})
    if twice:
        raise IdentificationError(f"estimate: {', '.join(twice)} is repeated; expected every parameter once", twice)
    if not elements:
        raise IdentificationError("estimate: no names; expected parameters such as platform_mass,platform_com")
    return tuple(elements)


def place_of(element: str) -> tuple[str, tuple[int, ...]]:
    """The parameter, and the index of the element in it, from 0."""
    match = _ELEMENT.fullmatch(element)
    if match is None:
        return element, ()
    stem, *digits = match.groups()
    return stem, tuple(int(digit) - 1 for digit in digits if digit is not None)


def unit_of(element: str) -> str:
    """The unit of an element [SI]."""
    stem = element.partition("[")[0]
    return _UNITS[stem] if stem in _UNITS else OF_LOGS[stem][1]


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
    """The platform with other values, validated again; quantities of a log are left out."""
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
