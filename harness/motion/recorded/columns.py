"""Finds the columns of a motion log for time, and pose or leg lengths, with their units, by its header or as chosen."""

import re
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from gough_stewart.harness.errors import MotionError
from gough_stewart.harness.table_file import Heading
from gough_stewart.model.interface import nearest
from gough_stewart.model.units import UNITS


class LogColumn(NamedTuple):
    """A column by its name in the file, and its unit in SI units."""

    name: str
    factor: float


def _elements(name: str, size: int) -> tuple[str, ...]:
    return tuple(f"{name}[{k + 1}]" for k in range(size))


_PURE = {"": 1.0, "1": 1.0, "-": 1.0}  # units of dimensionless numbers
_UNITS: dict[str, Mapping[str, float]] = {
    "time": UNITS["s"],
    "position": UNITS["m"],
    "orientation": UNITS["rad"],
    "quaternion": _PURE,
    "rotation_vector": UNITS["rad"],
    "leg_length": UNITS["m"],
}
_EXAMPLES = {"time": "ms", "position": "mm", "orientation": "deg", "rotation_vector": "rad", "leg_length": "mm"}
# the representations of orientation, of which a file needs one
_TURNING = {
    "orientation": _elements("orientation", 3),
    "quaternion": _elements("quaternion", 4),
    "rotation_vector": _elements("rotation_vector", 3),
}
_PLACE = ("time", *_elements("position", 3))
LEGS = _elements("leg_length", 6)
_QUANTITIES = (*_PLACE, *LEGS, *(name for names in _TURNING.values() for name in names))
# Names of messages, as of ROS, before the usual ones: "/tool/pose/position/x".
_BEFORE = re.compile(r"^(.*\.)?(pose|transform)\.|^\.+")
_USUAL: dict[str, tuple[str, ...]] = {
    "time": ("time", "t", "timestamp", "datetime", "stamp", "header.stamp", "epoch"),
    **{
        f"position[{k + 1}]": (
            *(axis, motion, f"p{axis}", f"pos_{axis}"),
            *(f"position_{axis}", f"position.{axis}", f"translation.{axis}"),
        )
        for k, (axis, motion) in enumerate(zip("xyz", ("surge", "sway", "heave"), strict=True))
    },
    **{f"orientation[{k + 1}]": (name,) for k, name in enumerate(("roll", "pitch", "yaw"))},
    **{
        f"quaternion[{k + 1}]": (
            *(f"q{axis}", f"q_{axis}", f"quaternion_{axis}"),
            *(f"orientation.{axis}", f"rotation.{axis}"),
        )
        for k, axis in enumerate("xyzw")
    },
    **{f"rotation_vector[{k + 1}]": (f"rotation_vector_{axis}", f"rotvec_{axis}") for k, axis in enumerate("xyz")},
    **{
        name: tuple(f"{usual}{k + 1}" for usual in ("leg_length_", "leg_", "leg", "length_", "l", "strut_"))
        for k, name in enumerate(LEGS)
    },
}
_OWN_PREFIX = re.compile(r"^(reference|measured)\.")


def columns_of(
    header: Sequence[str],
    chosen: Mapping[str, str] | str = "",
    *,
    timed: bool = True,
    timestamps: Collection[str] = (),
    only_legs: bool = False,  # whether leg lengths are read in any case
) -> dict[str, LogColumn]:
    """The columns for time, position, and one of orientation, quaternion, rotation_vector; or for time and leg lengths.

    Leg lengths are read if they are chosen, or if the file has no position. Headings have units, as in "x [mm]" or
    "x (mm)"; in a table with this project's names (`time`, `position[1]`, …) missing units mean SI. `chosen` has names
    in the file, with or without units, by this project's names; others are found by the usual names of motion logs; or
    it is the prefix of a record's signals, "reference" or "measured". `timestamps` need no unit as times: they have
    dates, or seconds since 1970.
    """
    headings = [Heading.of(column) for column in header]
    if isinstance(chosen, str):
        pose = (*_elements("position", 3), *_TURNING["orientation"])
        chosen = {name: f"{chosen}.{name}" for name in pose} if chosen else {}
    for name in chosen:
        if name not in _QUANTITIES:
            raise MotionError(f"columns: no quantity '{name}'{nearest(name, _QUANTITIES)}")
    headings_found = {name: _heading_of(name, headings, chosen) for name in _QUANTITIES}
    has_position = any(headings_found[name] is not None for name in _PLACE[1:])
    has_legs = any(headings_found[name] is not None for name in LEGS)
    if only_legs or any(name in chosen for name in LEGS) or (has_legs and not has_position):
        required: tuple[str, ...] = (*_PLACE[: 1 if timed else 0], *LEGS)
    else:
        kinds = [kind for kind, names in _TURNING.items() if not set(names).isdisjoint(chosen)]
        has = {kind: sum(headings_found[name] is not None for name in names) for kind, names in _TURNING.items()}
        whole = kinds or [kind for kind, names in _TURNING.items() if has[kind] == len(names)]
        if len(whole) > 1:
            first = _TURNING[whole[0]][0]
            heading = headings_found[first]
            column = heading.column if heading is not None else ""
            raise MotionError(
                f"has {' and '.join(whole)}; choose one by naming its columns: "
                f'columns = {{ "{first}" = "{column}", … }}'
            )
        kind = whole[0] if whole else max(_TURNING, key=lambda kind: has[kind])
        required = (*(_PLACE if timed else _PLACE[1:]), *_TURNING[kind])
    missing = [name for name in required if headings_found[name] is None]
    if missing:
        raise MotionError(
            f"has no column {', '.join(missing)}; expected {', '.join(required)}, or the usual names of motion logs "
            "('x [mm]', 'roll [deg]', 'qx'), or columns named in the reference: columns = { \"position[1]\" = "
            '"NAME [mm]", … }'
        )
    found = {name: heading for name in required if (heading := headings_found[name]) is not None}

    # their units
    is_ours = all(
        _OWN_PREFIX.sub("", heading.name) == quantity
        for quantity, heading in found.items()
        if heading.column not in timestamps
    )
    columns, without = dict[str, LogColumn](), dict[str, Heading]()
    for quantity, heading in found.items():
        kind = quantity.partition("[")[0]
        if quantity == "time" and heading.column in timestamps:
            columns[quantity] = LogColumn(heading.column, 1.0)
            continue
        if heading.unit is None and not is_ours and kind != "quaternion":
            without[quantity] = heading
        try:
            columns[quantity] = LogColumn(heading.column, heading.factor(_UNITS[kind]))
        except ValueError as error:
            raise MotionError(str(error)) from None
    if without:
        quantity, lacking = next(iter(without.items()))
        example = f"{lacking.name} [{_EXAMPLES[quantity.partition('[')[0]]}]"
        raise MotionError(
            f"units missing: {', '.join(heading.column for heading in without.values())}; expected them in the header, "
            f'for instance \'{example}\', or in the reference: columns = {{ "{quantity}" = "{example}", … }}'
        )
    return columns


def other_headings(header: Sequence[str], chosen: Mapping[str, str]) -> dict[str, Heading]:
    """The columns by the name of what they have: chosen ones, and those of usual names that are not this project's."""
    headings = [Heading.of(column) for column in header]
    found = {name: _heading_of(name, headings, {}) for name in _QUANTITIES}
    usual = {name: heading for name, heading in found.items() if heading is not None and heading.name != name}
    return usual | {name: _chosen(name, headings, text) for name, text in chosen.items()}


def _heading_of(quantity: str, headings: Sequence[Heading], chosen: Mapping[str, str]) -> Heading | None:
    """The column of a quantity: as chosen, by this project's name, or by a usual one."""
    if quantity in chosen:
        return _chosen(quantity, headings, chosen[quantity])
    ours = [heading for heading in headings if heading.name == quantity]
    candidates = ours or [
        heading for heading in headings if _BEFORE.sub("", heading.name.lower().replace("/", ".")) in _USUAL[quantity]
    ]
    if len(candidates) > 1:
        names = " and ".join(heading.column for heading in candidates)
        raise MotionError(
            f'has {names} for {quantity}; choose one: columns = {{ "{quantity}" = "{candidates[0].column}" }}'
        )
    return candidates[0] if candidates else None


def _chosen(quantity: str, headings: Sequence[Heading], text: str) -> Heading:
    """A column by its whole heading, or by its name, optionally with a unit."""
    whole = [heading for heading in headings if heading.column == text]
    name, unit = Heading.of(text)[1:]
    candidates = whole or [heading for heading in headings if name in (heading.column, heading.name)]
    if not candidates:
        raise MotionError(
            f"columns: {quantity} is '{text}', but the file has no such column"
            f"{nearest(name, [heading.name for heading in headings])}"
        )
    if len(candidates) > 1:
        raise MotionError(
            f"columns: {quantity} is '{text}'; the file has {len(candidates)} such columns; write the unit"
        )
    of_file = None if candidates[0].column == name else candidates[0].unit
    if unit is not None and of_file is not None and unit != of_file:
        raise MotionError(
            f"columns: {quantity} is '{text}', but the file has '{candidates[0].column}'; expected one unit"
        )
    return candidates[0]._replace(unit=of_file if unit is None else unit)
