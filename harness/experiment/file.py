"""Experiments from TOML files, from the shipped ones, and with changed settings."""

import json
from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from gough_stewart.harness.errors import ExperimentError, SettingError
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.section import complaints
from gough_stewart.model.interface import nearest
from gough_stewart.model.process.toml import toml_names, toml_text, toml_values

_SHIPPED = ("gough_stewart.harness.experiment", "shipped")


# Changed settings: strings "key.key=value", or a mapping from "key.key" to values.
Settings = Iterable[str] | Mapping[str, Any]


def load_experiment(name: Path | str, settings: Settings = ()) -> Experiment:
    """Read an experiment file, or the shipped experiment of a name; a file of that name takes precedence.

    Parameters
    ----------
    name
        A TOML file, or one of `experiment_names()`.
    settings
        Keys of the file to change: `{"loop.duration": 3, "controller.bandwidth": "2 Hz"}`, or as on the command
        line `["loop.duration=3"]`. Numbers are in SI units, frequencies in Hz; strings may have a unit.

    Returns
    -------
    Experiment
        Validated, in SI units, with the folder to which its paths are relative.

    Raises
    ------
    ExperimentError
        The file cannot be read, or a key is unknown, missing, or has an invalid value; the message names place, value
        and remedy.

    Examples
    --------
    >>> experiment = gs.load_experiment("heave_step", {"loop.duration": 1, "controller.bandwidth": 3})
    """
    if is_shipped(name):
        return shipped_experiment(str(name), settings)
    text, where = experiment_text(name)
    return _set(_parsed(text, where), settings, where, Path(name).parent)


def experiment_text(name: Path | str) -> tuple[str, str]:
    """The TOML text of an experiment's file or of a shipped experiment, and its name for messages.

    Raises
    ------
    ExperimentError
        It cannot be read.
    """
    if is_shipped(name):
        return shipped_text(str(name)), f"experiment '{name}'"
    path = Path(name)
    try:
        return path.read_text(encoding="utf-8-sig"), str(path)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is not UTF-8 text"
        close = get_close_matches(path.stem, experiment_names(), n=1)
        hint = (
            f"did you mean '{close[0]}', which ships with the package?"
            if close
            else "expected a TOML file, or a shipped experiment, which `gough-stewart experiments` lists"
        )
        raise ExperimentError(str(path), "", f"cannot read this experiment: {reason}; {hint}") from error


def is_shipped(name: Path | str) -> bool:
    """Whether it is a shipped name; a file of the same name takes precedence."""
    return str(name) in experiment_names() and not Path(name).is_file()


def experiment_of(experiment: Experiment | Path | str, settings: Settings = ()) -> Experiment:
    """The experiment itself, or that of a file or shipped name; with settings as in `load_experiment`.

    Raises
    ------
    ExperimentError
        As `load_experiment`.
    """
    if isinstance(experiment, Path | str):
        return load_experiment(experiment, settings)
    if not isinstance(experiment, Experiment):
        raise ExperimentError(
            "experiment",
            "",
            f"is {experiment!r}; expected an Experiment, a file, or a shipped name such as 'heave_step'",
        )
    if not settings:
        return experiment
    values = experiment.model_dump(mode="json", exclude_unset=True)
    return _set(values, settings, experiment.where, experiment.folder, experiment.changed)


def experiment_names() -> tuple[str, ...]:
    """Names of the shipped experiments, for `load_experiment`, `run` and `margins`.

    Returns
    -------
    tuple of str
        In alphabetical order.
    """
    return toml_names(*_SHIPPED)


def shipped_text(name: str) -> str:
    """The TOML file of a shipped experiment, with its comments.

    Raises
    ------
    ExperimentError
        No such experiment; the nearest name is suggested.
    """
    if name not in experiment_names():
        raise ExperimentError(f"experiment '{name}'", "", f"no such experiment{nearest(name, experiment_names())}")
    return toml_text(*_SHIPPED, name)


def shipped_experiment(name: str, settings: Settings = ()) -> Experiment:
    """A shipped experiment by name; see `load_experiment` for the settings.

    Raises
    ------
    ExperimentError
        No such experiment, or as `experiment_from`.
    """
    where = f"experiment '{name}'"
    return _set(_parsed(shipped_text(name), where), settings, where)


def experiment_from(values: Mapping[str, Any], where: str = "experiment", folder: Path = Path()) -> Experiment:
    """An experiment from plain values, as in a TOML file.

    Parameters
    ----------
    where
        The file or name of the experiment, for messages.
    folder
        Resolves file names.

    Raises
    ------
    ExperimentError
        A key that is unknown, missing, or has an invalid value; names place, value and remedy, one line each.
    """
    try:
        return Experiment.built().model_validate(dict(values)).from_file(where, folder)
    except ValidationError as error:
        raise ExperimentError(where, "", complaints(error, Experiment, values)) from None


def _set(
    values: Mapping[str, Any],
    settings: Settings,
    where: str,
    folder: Path = Path(),
    before: Mapping[str, dict[str, Any]] | None = None,
) -> Experiment:
    """An experiment with settings, which remembers them and what its file has in their place."""
    given = [settings] if isinstance(settings, str) else settings
    each = dict(given) if isinstance(given, Mapping) else list(given)
    made = experiment_from(with_settings(values, each), where, folder)
    changed = dict(before or {})
    for _, key, value in keys_and_values(each):
        name = key.strip()
        of_file = changed[name]["file"] if name in changed else _value_at(values, name)
        changed[name] = json.loads(json.dumps({"value": value, "file": of_file}, default=str))
    return made.with_changed(changed)


def _value_at(values: Any, key: str) -> Any:
    """The value of a key in plain tables; None if there is none."""
    found = values
    for name in key.split("."):
        found = found.get(name) if isinstance(found, Mapping) else _element(found, name)
    return found


def with_settings(values: Mapping[str, Any], settings: Settings) -> dict[str, Any]:
    """Plain values with some replaced: "loop.duration=3", "reference.position_change=[0, 0, 0.01]", "plant.kind=fmu2".

    Values in strings are TOML; anything else is taken as a string. Values of a mapping are copied, arrays become
    lists.

    Raises
    ------
    SettingError
        No "=", or a key inside something that is not a table.
    """
    made: dict[str, Any] = _copied(values)
    for where, key, value in keys_and_values(settings):
        set_key(made, where, key, _copied(value))
    return made


def set_key(values: Any, where: str, key: str, value: Any) -> None:
    """Set one key, such as "loop.duration", in the tables of an experiment, plain or tomlkit's.

    Raises
    ------
    SettingError
        A key inside something that is not a table; `where` names the setting.
    """
    names = key.strip().split(".")
    if not all(names):
        raise SettingError(where, "", "expected key=value, for instance loop.duration=2")
    table: Any = values
    for name in names[:-1]:
        table = table.setdefault(name, {}) if isinstance(table, dict) else _element(table, name)
        if table is None:
            break
    if not isinstance(table, dict):
        raise SettingError(where, "", f"{key.rpartition('.')[0]} is not a table of the experiment")
    table[names[-1]] = value


def keys_and_values(settings: Settings) -> Iterator[tuple[str, str, Any]]:
    """For every setting its name for messages, its key, and its value."""
    if isinstance(settings, Mapping):
        for key, value in settings.items():
            yield f"setting {key!r}", str(key), value.tolist() if isinstance(value, np.ndarray | np.generic) else value
        return
    for setting in [settings] if isinstance(settings, str) else settings:
        where = f"--set {setting}"
        key, equals, text = setting.partition("=")
        if not equals:
            raise SettingError(where, "", "expected key=value, for instance loop.duration=2")
        if "\n" in text:
            raise SettingError(where, "", "expected one line")
        try:
            yield where, key, toml_values(f"value = {text}")["value"]
        except ValueError:
            yield where, key, text.strip()


def _element(array: Any, name: str) -> Any:
    """An element of [[change]] or [[disturbance]], 1-based."""
    known = isinstance(array, list) and name.isdigit() and 1 <= int(name) <= len(array)
    return array[int(name) - 1] if known else None


def _copied(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {k: _copied(v) for k, v in value.items()}
    return [_copied(v) for v in value] if isinstance(value, list) else value


def _parsed(text: str, where: str) -> dict[str, Any]:
    try:
        values = toml_values(text)
    except ValueError as error:
        raise ExperimentError(where, "", str(error)) from error
    if "platform_mass" in values and "base_points" in values:
        raise ExperimentError(
            where, "", "is a platform file; expected an experiment that names it: platform.file = 'FILE.toml'"
        )
    return values
