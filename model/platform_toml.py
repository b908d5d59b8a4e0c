"""Platforms as TOML files, and the presets that ship with the package.

A file is flat: the parameters of `gough_stewart.model.parameters` by name, in SI units. Numbers are written with the
fewest digits that give the same float, so TOML → Platform → TOML is lossless.
"""

from functools import lru_cache
from pathlib import Path

import numpy as np
import tomlkit

from gough_stewart.model.errors import PlatformError, PlatformFileError
from gough_stewart.model.interface import nearest
from gough_stewart.model.parameters import FACTOR_OF, NEEDED, TABLE, TEXTS
from gough_stewart.model.platform import CIRCLE_KEYS, Platform, joints_of_keys
from gough_stewart.model.platform_checks import by_leg
from gough_stewart.model.process.files import write_whole
from gough_stewart.model.process.toml import toml_item, toml_names, toml_text, toml_values

_KEYS = (*TEXTS, *TABLE, *CIRCLE_KEYS)
_PRESETS = ("gough_stewart.model", "presets")


@lru_cache(maxsize=16)
def platform_from_toml(text: str, where: str = "TOML text") -> Platform:
    """The platform in a TOML text; a `PlatformFileError`, also of invalid values, refers to the text as `where`."""
    try:
        values = toml_values(text)
    except ValueError as error:
        raise PlatformFileError(where, str(error)) from error
    if "controller" in values and "loop" in values:
        raise PlatformFileError(
            where, "is an experiment; expected a platform file, as printed by `gough-stewart presets`"
        )
    for key in values:
        if key not in _KEYS:
            raise PlatformFileError(where, f"unknown key '{key}'{nearest(key, _KEYS)}")
    try:
        values = joints_of_keys(values)
        if missing := [name for name in NEEDED if name not in values]:
            raise PlatformFileError(where, f"missing {', '.join(missing)}; see a preset for a complete file")
        for key, value in values.items():
            is_number = key in TABLE and not TABLE[key].words
            if is_number and not isinstance(value, np.ndarray) and _holds_other_than_numbers(value):
                raise PlatformFileError(where, f"{key} is {value!r}; expected numbers")
        return Platform(**by_leg(values))
    except PlatformError as error:
        raise PlatformFileError(where, str(error)) from error


def platform_to_toml(platform: Platform) -> str:
    """TOML text of a platform, with units and descriptions as comments; lossless.

    Factors of 1 are left out, and parameters of stiction and compliance that have their defaults.
    """
    document = tomlkit.document()
    for key, value in platform.as_dict().items():
        if key in FACTOR_OF.values() and np.all(value == 1):
            continue  # identical legs
        if key in TABLE and TABLE[key].part is not None and getattr(platform, key) == TABLE[key].default:
            continue
        item = toml_item(value)
        if key in TABLE:
            item.comment(f"[{TABLE[key].unit}] {TABLE[key].description}")
        document.add(key, item)
    return tomlkit.dumps(document)


def load_platform(path: Path | str) -> Platform:
    """Read a platform from a TOML file: the fields of `Platform` by name, in SI units.

    Returns
    -------
    Platform
        Validated, with arrays that are read-only.

    Raises
    ------
    PlatformFileError
        The file cannot be read, is not TOML, has an unknown or a missing key, or describes an invalid platform.

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
        raise PlatformFileError(str(path), f"cannot read this platform file: {reason}") from error
    return platform_from_toml(text, str(path))


def save_platform(platform: Platform, path: Path | str) -> None:
    """Write a platform as a TOML file, which `load_platform` reads without loss; atomic.

    Raises
    ------
    PlatformFileError
        The file cannot be written.
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
    """
    return toml_names(*_PRESETS)


def preset_text(name: str) -> str:
    """The TOML file of a preset with its comments, as a template for your own platform file."""
    if name not in preset_names():
        raise PlatformFileError(f"preset '{name}'", f"no such preset{nearest(name, preset_names())}")
    return toml_text(*_PRESETS, name)


def load_preset(name: str) -> Platform:
    """A preset by name: `liu2000`, the paper's, `desktop_hexapod`, `motion_base` or `motion_base_screws`, which sticks.

    Returns
    -------
    Platform
        Validated, with arrays that are read-only.

    Raises
    ------
    PlatformFileError
        No preset has this name; the nearest one is suggested.

    Examples
    --------
    >>> gs.load_preset("motion_base").platform_mass
    """
    return platform_from_toml(preset_text(name), f"preset '{name}'")


def _holds_other_than_numbers(value: object) -> bool:
    """Whether a value consists of numbers: NumPy would convert TOML's texts, booleans and dates, or fail obscurely."""
    if isinstance(value, list):
        return any(_holds_other_than_numbers(v) for v in value)
    return isinstance(value, bool) or not isinstance(value, int | float)
