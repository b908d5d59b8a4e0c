"""The platform: geometry, masses, friction, gravity, home pose and limits; frozen and validated.

Its file is flat TOML: the parameters of `gough_stewart.model.parameters` by name, in SI units or as texts with a unit,
and keys that state joints as data sheets do: on circles, by cylindrical coordinates, listed once with the legs between
them. Numbers are written in SI units with the fewest digits that give the same float, so TOML → Platform → TOML is
lossless. Presets ship with the package. N platforms are one sequence, checked and evaluated at once.
"""

import html
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from difflib import get_close_matches
from functools import lru_cache
from inspect import cleandoc
from pathlib import Path
from typing import Any, Literal, Self, get_args, overload

import numpy as np
import tomlkit
from numpy.typing import NDArray

from gough_stewart.model import platform_checks
from gough_stewart.model.dynamics import holding_motor_position, static_leg_forces
from gough_stewart.model.errors import PlatformError, PlatformFileError
from gough_stewart.model.interface import nearest, unit_text
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.parameters import (
    FACTOR_OF,
    LIMITS,
    NEEDED,
    PHYSICAL,
    TABLE,
    TEXTS,
    Parameters,
    PlatformFields,
    Variable,
    of_legs,
)
from gough_stewart.model.platform_checks import by_leg
from gough_stewart.model.process.files import write_whole
from gough_stewart.model.process.toml import toml_files, toml_item, toml_values
from gough_stewart.model.units import in_si
from gough_stewart.model.vectors import FloatArray, real_array

# Far beyond any real machine, but its square and cube do not overflow.
LARGEST_NUMBER = 1e30

Pairing = Literal["near", "far"]
# What states joints on circles, in the order of files, and the parameters that it determines.
CIRCLE_KEYS = ("base_radius", "platform_radius", "base_angle", "platform_angle", "pairing", "home_leg_length")
_LENGTHS, _ANGLES = ("base_radius", "platform_radius", "home_leg_length"), ("base_angle", "platform_angle")
ON_CIRCLES = ("base_points", "platform_points", "home_position", "home_orientation")
_THIRD = 2 * np.pi / 3
UNITS_OF_CIRCLES = dict.fromkeys(_LENGTHS, "m") | dict.fromkeys(_ANGLES, "rad")
# Rows of joints by cylindrical coordinates, and the parameter that they determine: base first, as in `legs`.
_CYLINDRICAL = {"base_points_cylindrical": "base_points", "platform_points_cylindrical": "platform_points"}
_COLUMNS = (("radius", "m"), ("angle", "rad"), ("z", "m"))
# Keys of files that determine parameters of a platform.
JOINT_KEYS = (*CIRCLE_KEYS, *_CYLINDRICAL, "legs")

_FILE_KEYS = (*TEXTS, *TABLE, *JOINT_KEYS)
_PRESETS = ("gough_stewart.model", "presets")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Platform(PlatformFields):
    """A Gough–Stewart platform; every parameter by name, in SI units.

    A parameter of the legs may be given as six numbers; it is stored as their mean and six factors. Arrays are copied,
    converted to float64 and read-only. To change a parameter, make a new platform with `dataclasses.replace`, which
    validates it again, or `with_parameters`, which also replaces factors by six values. Parameters, frames and signs:
    docs/notation.md.

    Raises
    ------
    PlatformError
        An invalid parameter; `field` has its name, the text has value, expectation and remedy.

    Examples
    --------
    >>> from dataclasses import replace
    >>> loaded = replace(gs.load_preset("motion_base"), platform_mass=1500.0)
    >>> loaded.actuator_force_max, loaded.base_points.shape
    """

    def __post_init__(self) -> None:
        for text in TEXTS:
            if not isinstance(getattr(self, text), str):
                raise PlatformError(text, f"is {getattr(self, text)!r}; expected a text")
        values = {name: getattr(self, name) for name in TABLE}
        # the default factors contradict nothing
        factors = {name for name in FACTOR_OF.values() if np.array_equal(values[name], TABLE[name].default)}
        values |= by_leg({name: value for name, value in values.items() if name not in factors})
        for name, value in values.items():
            if value is not None or TABLE[name].default is not None:
                object.__setattr__(self, name, _frozen(TABLE[name], value))
        platform_checks.check(self)

    def __eq__(self, other: object) -> bool:
        """Equal in every number and text."""
        if not isinstance(other, Platform):
            return NotImplemented
        return all(np.array_equal(getattr(self, f.name), getattr(other, f.name)) for f in fields(self))

    def __hash__(self) -> int:
        """Consistent with `==`."""
        return hash((self.name, self.base_points.tobytes(), self.platform_mass))

    def __repr__(self) -> str:
        """Name, masses, geometry, home pose and limits, one line each."""
        legs = _range(leg_geometry(self, self.home_position, self.home_orientation).length)
        lower, upper = (_range(of_legs(self, f"leg_{part}_mass"), ".6g") for part in ("lower", "upper"))
        base, joints = (
            _range(np.linalg.norm(points - points.mean(axis=0), axis=1))
            for points in (self.base_points, self.platform_points)
        )
        pose = f"position ({_shown(self.home_position)}) m, orientation ({_shown(self.home_orientation)}) rad"
        stated = [row for row in LIMITS if getattr(self, row.name) is not None]
        limits = ", ".join(f"{row.name} {_shown(getattr(self, row.name))} {unit_text(row.unit)}" for row in stated)
        return (
            f"Platform {self.name}\n"
            f"  masses   platform {self.platform_mass:.6g} kg, legs 6 × ({lower} + {upper}) kg\n"
            f"  joints   {base} m about the base's middle, {joints} m about the platform's\n"
            f"  home     {pose}, legs {legs} m\n"
            f"  limits   {limits or 'none stated'}"
        )

    def _repr_html_(self) -> str:
        """In a notebook: every parameter with its value, unit and meaning."""
        values = self.as_dict()
        texts = " – ".join(html.escape(text) for text in map(values.pop, TEXTS) if text)
        rows = [
            f"<tr><th scope=row>{name}</th><td>{_shown(value)}</td>"
            f"<td>{html.escape(unit_text(TABLE[name].unit))}</td><td>{html.escape(TABLE[name].description)}</td></tr>"
            for name, value in values.items()
        ]
        heads = "".join(f"<th scope=col>{head}</th>" for head in ("parameter", "value", "unit", "meaning"))
        head = f"<caption>Platform {texts}</caption><thead><tr>{heads}</tr></thead>"
        return f"<table>{head}<tbody>{''.join(rows)}</tbody></table>"

    def __setstate__(self, fields_by_name: dict[str, Any]) -> None:
        """Restore with read-only arrays."""
        self.__dict__.update(fields_by_name)
        for value in fields_by_name.values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    @property
    def home_actuator_force(self) -> FloatArray:
        """Actuator forces (6,) [N] that hold the home pose at rest: the start values of plant and FMU."""
        return np.asarray(static_leg_forces(self, self.home_position, self.home_orientation))

    @property
    def home_motor_position(self) -> FloatArray:
        """Motor positions (6,) [m] that hold the home pose: L + F/k of elastic legs, L of rigid legs."""
        return holding_motor_position(self, self.home_position, self.home_orientation)

    @property
    def hints(self) -> tuple[str, ...]:
        """Likely mistakes: suspicious units, touching legs, wrong order of joints, friction that is not passive."""
        return platform_checks.platform_hints(self)

    @classmethod
    def from_radii(
        cls,
        base_radius: float,
        platform_radius: float,
        base_angle: float,
        platform_angle: float,
        *,
        home_leg_length: float,
        pairing: Pairing = "near",
        **parameters: Any,
    ) -> Self:
        """A symmetric platform whose joints are in pairs on two circles, level above its base at home.

        Pairs of base joints at the azimuths 120° k ± a/2, of platform joints at 60° + 120° k ± b/2, from X towards Y;
        each leg goes to the "near" or the "far" joint of the pair beside it. The height of the home pose follows from
        the leg length L: z² = L² − R² − r² + 2 R r cos Δ, with the turn Δ = 60° − (a + b)/2, or 60° − (a − b)/2 if far.

        Parameters
        ----------
        base_radius, platform_radius
            Radii R and r of the circles of joints [m].
        base_angle, platform_angle
            Angles a and b between the two joints of a pair [rad], from 0, where legs share a joint, to below 120°.
        home_leg_length
            Length L of the legs in the home pose [m].
        pairing
            "near" or "far".
        parameters
            The other parameters of the platform, by name.

        Returns
        -------
        Platform
            With the joints' centres, and the limits and home pose that are given.

        Raises
        ------
        PlatformError
            A number out of its range, legs that are too short to reach, or an invalid, unknown or missing parameter.

        Examples
        --------
        >>> preset = gs.load_preset("liu2000").as_dict()
        >>> needed = ("leg_", "platform_mass", "platform_inertia")
        >>> others = {name: value for name, value in preset.items() if name.startswith(needed)}
        >>> angle = np.radians(30)
        >>> platform = gs.Platform.from_radii(2.0, 1.0, angle, angle, home_leg_length=3.2459, **others)
        """
        if repeated := [name for name in ON_CIRCLES if name in parameters]:
            raise PlatformError(repeated[0], "is determined by the radii and angles; leave it out")
        circles = base_radius, platform_radius, base_angle, platform_angle, pairing, home_leg_length
        joints: dict[str, Any] = joints_on_circles(dict(zip(CIRCLE_KEYS, circles, strict=True)))
        for name in parameters:
            if name not in TABLE and name not in TEXTS:
                raise PlatformError(name, f"no such parameter{nearest(name, (*TABLE, *TEXTS))}")
        missing = [name for name in NEEDED if name not in {*joints, *parameters}]
        if missing:
            raise PlatformError(missing[0], f"missing; expected {', '.join(missing)} beside the radii and angles")
        return cls(**joints, **parameters)

    def with_parameters(self, parameters: Mapping[str, Any]) -> Self:
        """A copy with other values of some parameters, validated again, like `dataclasses.replace`.

        Parameters
        ----------
        parameters
            Values by name, those of single legs as for a platform: six of a parameter that has a factor, or of a limit
            of the legs.

        Returns
        -------
        Platform
            The platform with all other parameters unchanged.

        Raises
        ------
        PlatformError
            An unknown name, or an invalid value.
        """
        values = by_leg(parameters)
        new = self.unchecked(values)
        platform_checks.check(new, values)
        return new

    def unchecked(self, values: Mapping[str, Any]) -> Self:
        """A copy with other values of some parameters, with only shape and size checked; not for single legs."""
        new: Self = object.__new__(type(self))
        new.__dict__.update(self.__dict__)
        for name, value in values.items():
            if name not in TABLE:
                raise PlatformError(name, f"no such parameter{nearest(name, TABLE)}")
            row = TABLE[name]
            new.__dict__[name] = None if value is None and row.default is None else _frozen(row, value)
        return new

    def as_dict(self) -> dict[str, Any]:
        """All fields by name, in file order: texts, words, floats, arrays; without limits that are not set."""
        values = {name: getattr(self, name) for name in (*TEXTS, *TABLE)}
        values |= {name: row.words[int(values[name])] for name, row in TABLE.items() if row.words}
        return {name: value for name, value in values.items() if value is not None}


# help() lists the parameters from the table
Platform.__doc__ = f"{cleandoc(Platform.__doc__ or '')}\n\nParameters\n----------\n" + "\n".join(
    f"{name} : {row.shape or 'number'} [{row.unit}]\n    {row.description}" for name, row in TABLE.items()
)


class Platforms(Sequence[Platform]):
    """N platforms, checked and evaluated at once; each is made as a `Platform` only where it is asked for."""

    def __init__(
        self,
        bases: Sequence[Platform],
        base_of: NDArray[np.intp] | None = None,  # which of them each starts from (N,), by default each one once
        values: Mapping[str, FloatArray] | None = None,  # parameters that replace those of its base (N, *shape)
    ) -> None:
        self._bases = tuple(bases)
        self._base_of = np.arange(len(self._bases)) if base_of is None else base_of
        self._values = dict(values or {})

    def having(self, values: Mapping[str, FloatArray]) -> "Platforms":
        """The same, with these parameters (N, *shape) by name; unchecked."""
        return Platforms(self._bases, self._base_of, {**self._values, **values})

    def __len__(self) -> int:
        """The number N of platforms."""
        return len(self._base_of)

    @overload
    def __getitem__(self, k: int) -> Platform: ...

    @overload
    def __getitem__(self, k: slice | NDArray[np.intp]) -> "Platforms": ...

    def __getitem__(self, k: int | slice | NDArray[np.intp]) -> "Platform | Platforms":
        """One of them, or several in the order of an index."""
        if isinstance(k, slice | np.ndarray):
            return Platforms(self._bases, self._base_of[k], {name: v[k] for name, v in self._values.items()})
        base: Platform = self._bases[self._base_of[k]]
        return base.unchecked({name: v[k].tolist() for name, v in self._values.items()}) if self._values else base

    def field(self, name: str) -> FloatArray:
        """One parameter of all (N, *shape)."""
        if name in self._values:
            return self._values[name]
        of_bases = [np.asarray(getattr(base, name), dtype=float) for base in self._bases]
        values = np.stack(np.broadcast_arrays(*(value.T for value in of_bases)), axis=-1).T
        return values[self._base_of] if len(values) > 1 else np.broadcast_to(values, (len(self), *values.shape[1:]))

    @property
    def parameters(self) -> Parameters:
        """The physical parameters of all, as `stack`."""
        return Parameters(**{row.name: self.field(row.name) for row in PHYSICAL})

    def doubtful(self, changed: Collection[str]) -> NDArray[np.bool_]:
        """Which of them (N,) may be impossible, in the parameters that have changed; to be sure, make that one."""
        wrong = np.zeros(len(self), dtype=bool)
        for values in self._values.values():
            wrong |= ~(np.abs(values) <= LARGEST_NUMBER).reshape(len(self), -1).all(axis=-1)
        stated = [
            name
            for name, row in TABLE.items()
            if row.default is not None or name in self._values or any(getattr(b, name) is not None for b in self._bases)
        ]
        arrays: dict[str, Any] = {name: self.field(name) for name in stated}
        return np.asarray(wrong | platform_checks.check(PlatformFields(**arrays), changed))


def platforms_with(
    bases: Sequence[Platform], base_of: NDArray[np.intp], parameters: Sequence[Mapping[str, Any]]
) -> tuple[Platforms, dict[int, PlatformError]]:
    """N platforms `bases[base_of[k]].with_parameters(parameters[k])`, and the errors of those that are impossible."""
    platforms: Platforms | None = None
    first, doubtful = parameters[0], np.ones(len(base_of), dtype=bool)
    names = dict.fromkeys(name for values in parameters for name in values)
    varied = [name for name in names if any(values.get(name, ...) is not first.get(name, ...) for values in parameters)]
    try:
        common = by_leg(first)
        arrays = {
            name: real_array([values[name] for values in parameters], (len(base_of), *TABLE[name].shape))
            for name in varied
        }
        started = [base.unchecked(common) for base in bases]
    except (PlatformError, ValueError, KeyError):  # not of one kind: one by one
        pass
    else:
        platforms = Platforms(started, base_of, arrays)
        doubtful = platforms.doubtful(common)
    errors, one_by_one = dict[int, PlatformError](), dict[int, Platform]()
    for k in np.flatnonzero(doubtful).tolist():
        try:
            one_by_one[k] = bases[base_of[k]].with_parameters(parameters[k])
        except PlatformError as error:
            errors[k] = error
    if platforms is None:
        platforms = Platforms([one_by_one.get(k, bases[i]) for k, i in enumerate(base_of.tolist())])
    return platforms, errors


@lru_cache(maxsize=16)
def platform_from_toml(text: str, where: str = "TOML text") -> Platform:
    """The platform in a TOML text; a `PlatformFileError`, also of invalid values, refers to the text as `where`."""
    numeric = {name: row.unit for name, row in TABLE.items() if not row.words}
    units = numeric | UNITS_OF_CIRCLES
    try:
        # texts such as "300 mm" as numbers in SI units; words and texts as they are
        values = {
            name: in_si(name, value, units[name]) if name in units else value
            for name, value in toml_values(text).items()
        }
    except ValueError as error:
        raise PlatformFileError(where, str(error)) from error
    if "controller" in values and "loop" in values:
        expected = "expected a platform file, as printed by `gough-stewart presets`"
        raise PlatformFileError(where, f"is an experiment; {expected}")
    for key in values:
        if key not in _FILE_KEYS:
            raise PlatformFileError(where, f"unknown key '{key}'{nearest(key, _FILE_KEYS)}")

    def are_numbers(value: object) -> bool:
        """NumPy would convert TOML's texts, booleans and dates, or fail obscurely."""
        return all(map(are_numbers, value)) if isinstance(value, list) else type(value) in (int, float)

    try:
        values = joints_of_keys(values)
        if missing := [name for name in NEEDED if name not in values]:
            raise PlatformFileError(where, f"missing {', '.join(missing)}; see a preset for a complete file")
        for key, value in values.items():
            if key in numeric and not isinstance(value, np.ndarray) and not are_numbers(value):
                raise PlatformFileError(where, f"{key} is {value!r}; expected numbers")
        return Platform(**values)
    except PlatformError as error:
        raise PlatformFileError(where, str(error)) from error


def platform_to_toml(platform: Platform) -> str:
    """Lossless TOML with comments, without factors of 1 and defaults of stiction and compliance."""
    document = tomlkit.document()
    for key, value in platform.as_dict().items():
        is_optional = key in TABLE and (key in FACTOR_OF.values() or TABLE[key].part is not None)
        if is_optional and np.array_equal(getattr(platform, key), TABLE[key].default):
            continue
        item = toml_item(value)
        if key in TABLE:
            item.comment(f"[{TABLE[key].unit}] {TABLE[key].description}")
        document.add(key, item)
    return tomlkit.dumps(document)


def load_platform(path: Path | str) -> Platform:
    """Read a platform from a TOML file: the fields of `Platform` by name, in SI units or as "300 mm".

    Joints may be on circles or by cylindrical coordinates, with the legs between them: docs/notation.md.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Platform
        Validated, with arrays that are read-only.

    Raises
    ------
    PlatformFileError
        The file cannot be read, is not TOML, has an unknown or a missing key, or describes an invalid platform.

    See Also
    --------
    save_platform, load_preset, Platform

    Examples
    --------
    >>> gs.save_platform(gs.load_preset("motion_base"), "mine.toml")
    >>> platform = gs.load_platform("mine.toml")
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is not UTF-8 text"
        is_missing, presets = isinstance(error, FileNotFoundError), preset_names()
        beside = [file.stem for file in path.parent.glob("*.toml") if is_missing and file != path]
        hint = "; expected a TOML file, or one of the presets " + ", ".join(presets)
        if close := get_close_matches(path.stem, beside, n=1):
            hint = f"; did you mean '{path.with_name(close[0])}.toml'?"
        elif close := get_close_matches(path.stem, presets if is_missing else [], n=1, cutoff=0.5):
            hint = f"; did you mean the preset '{close[0]}'?"
        raise PlatformFileError(str(path), f"cannot read this platform file: {reason}{hint}") from error
    return platform_from_toml(text, str(path))


def save_platform(platform: Platform, path: Path | str) -> None:
    """Write a platform atomically as a TOML file, which `load_platform` reads back without loss.

    Parameters
    ----------
    platform
        The platform.
    path
        The file to write.

    Raises
    ------
    PlatformFileError
        The file cannot be written.

    See Also
    --------
    load_platform, Platform

    Examples
    --------
    >>> heavier = gs.load_preset("motion_base").with_parameters({"platform_mass": 1500})
    >>> gs.save_platform(heavier, "heavier.toml")
    """
    if Path(path).is_dir():
        raise PlatformFileError(str(path), f"is a folder; expected a file, such as {Path(path, 'platform.toml')}")
    try:
        write_whole(Path(path), platform_to_toml(platform).encode())
    except OSError as error:
        raise PlatformFileError(str(path), f"cannot write this platform file: {error.strerror}") from error


def preset_names() -> tuple[str, ...]:
    """Names of the presets for `load_preset`.

    Returns
    -------
    tuple of str
        In alphabetical order.

    See Also
    --------
    load_preset, experiment_names

    Examples
    --------
    >>> "liu2000" in gs.preset_names()
    True
    """
    return tuple(toml_files(*_PRESETS))


def preset_text(name: str) -> str:
    """The TOML file of a preset with its comments, as a template for your own platform file."""
    presets = toml_files(*_PRESETS)
    if name not in presets:
        raise PlatformFileError(f"preset '{name}'", f"no such preset{nearest(name, presets)}")
    return presets[name].read_text(encoding="utf-8")


def load_preset(name: str) -> Platform:
    """A preset by name: `liu2000`, the paper's, `desktop_hexapod`, `motion_base` or `motion_base_screws`, which sticks.

    Parameters
    ----------
    name
        One of `preset_names()`.

    Returns
    -------
    Platform
        Validated, with arrays that are read-only.

    Raises
    ------
    PlatformFileError
        No preset has this name; the nearest one is suggested.

    See Also
    --------
    preset_names, load_platform

    Examples
    --------
    >>> gs.load_preset("motion_base").platform_mass
    """
    return platform_from_toml(preset_text(name), f"preset '{name}'")


def joints_of_keys(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values with joints and home pose in the place of `JOINT_KEYS`; `PlatformError` for keys that do not fit."""
    joints = dict(values)
    circles = {key: joints.pop(key) for key in CIRCLE_KEYS if key in joints}
    if circles:
        first = next(iter(circles))
        if missing := [key for key in CIRCLE_KEYS if key not in circles and key != "pairing"]:
            expected = ", ".join(_LENGTHS + _ANGLES)
            raise PlatformError(first, f"needs {', '.join(missing)} beside it; expected all of {expected}")
        if repeated := [name for name in (*ON_CIRCLES, *_CYLINDRICAL) if name in joints]:
            raise PlatformError(repeated[0], f"is also determined by {first}; expected only one of the two")
        joints |= joints_on_circles(circles)
    for key, name in _CYLINDRICAL.items():
        if key in joints:
            if name in joints:
                raise PlatformError(name, f"is also determined by {key}; expected only one of the two")
            joints[name] = _cartesian(key, joints.pop(key))
    if "legs" in joints:
        rows = _rows_of("legs", joints.pop("legs"), ("base joint", "platform joint"))
        if len(rows) != 6:
            raise PlatformError("legs", f"has {len(rows)} rows; expected six")
        for k, row in enumerate(rows):
            if not all(type(number) is int and number >= 1 for number in row):
                raise PlatformError(f"legs[{k + 1}]", f"is {row}; expected two numbers of joints, from 1")
        pairs = np.array(rows) - 1
        for end, name in enumerate(_CYLINDRICAL.values()):
            if name in joints:
                joints[name] = _taken(name, joints[name], pairs[:, end])
    return joints


def _rows_of(key: str, value: object, columns: tuple[str, ...]) -> list[Any]:
    """Rows of a list with a value for each column; a `PlatformError` names the one that has not."""
    expected = f"a row [{', '.join(columns)}]"
    if not isinstance(value, list) or not value:
        raise PlatformError(key, f"is {value!r}; expected a list with {expected} for each")
    for k, row in enumerate(value):
        if not isinstance(row, list) or len(row) != len(columns):
            raise PlatformError(f"{key}[{k + 1}]", f"is {row!r}; expected {expected}")
    return value


def _cartesian(key: str, value: object) -> FloatArray:
    """Joints (n, 3) [m] from rows of radius, angle from X towards Y, and z: (r cos φ, r sin φ, z)."""
    points = []
    for k, row in enumerate(_rows_of(key, value, ("radius", "angle", "z"))):
        try:
            parts = [in_si(name, part, unit) for (name, unit), part in zip(_COLUMNS, row, strict=True)]
            radius, angle, z = real_array(parts, (3,))
        except ValueError as error:
            raise PlatformError(f"{key}[{k + 1}]", str(error)) from None
        if not radius >= 0:
            raise PlatformError(f"{key}[{k + 1}]", f"has the radius {radius:g} m; expected 0 or more")
        if not abs(angle) <= 2 * np.pi:
            raise PlatformError(
                f"{key}[{k + 1}]",
                f"has the angle {angle:g} rad; expected a full turn at most, or a text, '{angle:g} deg'",
            )
        points.append([radius * np.cos(angle), radius * np.sin(angle), z])
    return np.array(points)


def _taken(name: str, points: Any, numbers: NDArray[np.intp]) -> Any:
    """The joints of the legs (6, 3), by their numbers in a list of joints; each must be some leg's."""
    if not isinstance(points, list | np.ndarray):
        raise PlatformError(name, f"is {points!r}; expected a list of joints")
    if numbers.max() >= len(points):
        leg = int(numbers.argmax())
        raise PlatformError(
            f"legs[{leg + 1}]", f"names joint {numbers[leg] + 1}; {name} has {len(points)}, numbered from 1"
        )
    if idle := sorted({*range(len(points))} - {*numbers.tolist()}):
        raise PlatformError("legs", f"leaves out joint {idle[0] + 1} of {name}; expected a leg at each joint")
    return points[numbers] if isinstance(points, np.ndarray) else [points[number] for number in numbers]


def joints_on_circles(circles: Mapping[str, Any]) -> dict[str, FloatArray]:
    """Joints (6, 3) and home pose (3,) of `Platform.from_radii` by name, from values of `CIRCLE_KEYS`."""
    numbers, pairing = [], circles.get("pairing", "near")
    for name in (*_LENGTHS, *_ANGLES):
        try:
            number = float(real_array(circles[name], ()))
        except ValueError as error:
            raise PlatformError(name, str(error)) from None
        is_angle = name in _ANGLES
        if not (0 <= number < _THIRD if is_angle else number > 0):
            expected = "in radians, from 0 (one joint for both) to below 2.0944 (120°)" if is_angle else "above 0"
            raise PlatformError(name, f"is {number:g} {'rad' if is_angle else 'm'}; expected a number {expected}")
        numbers.append(number)
    R, r, L, a, b = numbers
    if pairing not in get_args(Pairing):
        raise PlatformError("pairing", f"is {pairing!r}; expected 'near' or 'far'")
    turn = np.pi / 3 - (a + b) / 2 if pairing == "near" else np.pi / 3 - (a - b) / 2
    across = R * R + r * r - 2 * R * r * np.cos(turn)
    if not across < L * L:
        raise PlatformError(
            "home_leg_length",
            f"is {L:g} m; expected more than the {np.sqrt(across):g} m between a base joint and the platform joint "
            "above it, seen from above",
        )
    # leg 2k + 1 turns to the left, leg 2k + 2, from the other end of the next pair of the base, to the right
    pairs = _THIRD * np.arange(3)
    base = np.stack([pairs + a / 2, pairs + _THIRD - a / 2], axis=-1).reshape(6)
    tips = base + np.tile([turn, -turn], 3)
    return {
        "base_points": R * np.stack([np.cos(base), np.sin(base), np.zeros(6)], axis=-1),
        "platform_points": r * np.stack([np.cos(tips), np.sin(tips), np.zeros(6)], axis=-1),
        "home_position": np.array([0.0, 0.0, np.sqrt(L * L - across)]),
        "home_orientation": np.zeros(3),
    }


def _frozen(row: Variable, value: object) -> FloatArray | float:
    """A float, or a read-only float64 array of the row's shape."""
    name, shape, words = row.name, row.shape, row.words
    if type(value) is float and shape == () and abs(value) <= LARGEST_NUMBER:  # the usual case, a shortcut
        return value
    # a ragged list is refused below, with its name
    is_list = isinstance(value, list | tuple) and not any(isinstance(part, list | tuple) for part in value)
    if row.is_by_leg and (is_list or (isinstance(value, np.ndarray) and value.ndim == 1)):
        shape = (6,)
    if words and isinstance(value, str):
        if value not in words:
            raise PlatformError(name, f"is {value!r}; expected {', '.join(words)}")
        return float(words.index(value))
    try:
        array = real_array(value, shape)
    except ValueError as error:
        six = ", or six, one per leg" if row.is_by_leg or name in FACTOR_OF else ""
        raise PlatformError(name, f"{error}{six}" if shape == () else str(error)) from None
    if np.abs(array).max() > LARGEST_NUMBER:
        raise PlatformError(name, f"is {array.tolist()}; expected numbers below {LARGEST_NUMBER:g} in SI units")
    if shape == () or (row.is_by_leg and np.ptp(array) == 0):
        return float(array.flat[0])
    array.setflags(write=False)
    return array


def _range(values: FloatArray, digits: str = ".4g") -> str:
    low, high = format(values.min(), digits), format(values.max(), digits)
    return low if low == high else f"{low} to {high}"


def _shown(value: Any) -> str:
    """Numbers with commas, rows with semicolons."""
    if isinstance(value, str):
        return value
    array = np.asarray(value)
    if array.ndim < 2:
        return ", ".join(f"{number:.6g}" for number in array.reshape(-1))
    return "; ".join(_shown(row) for row in array)
