"""Experiments from TOML files, from the shipped ones, and with single keys set anew."""

import tomllib
from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ValidationError

from gough_stewart.harness.errors import ExperimentError, SettingError
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.model import shipped
from gough_stewart.model.interface import nearest

_SHIPPED = ("gough_stewart.harness.experiment", "shipped")


# Single keys set anew: texts "key.key=value", or a mapping from "key.key" to values.
Settings = Iterable[str] | Mapping[str, Any]


def load_experiment(name: Path | str, settings: Settings = ()) -> Experiment:
    """Read an experiment file, or the experiment that ships under a name; a file of that name goes first.

    Parameters
    ----------
    name
        A TOML file, or one of `experiment_names()`.
    settings
        Keys of the file to set anew: `{"loop.duration": 3, "controller.bandwidth": "2 Hz"}`, or as on the command
        line `["loop.duration=3"]`. Numbers are in SI units, frequencies in Hz; texts may carry a unit.

    Raises
    ------
    ExperimentError
        The file cannot be read, or has an unknown key, misses one, or has a value that it cannot take; the text
        names place, value and remedy.

    Examples
    --------
    >>> experiment = gs.load_experiment("heave_step", {"loop.duration": 1, "controller.bandwidth": 3})
    """
    path = Path(name)
    if str(name) in experiment_names() and not path.is_file():
        return shipped_experiment(str(name), settings)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is not UTF-8 text"
        close = get_close_matches(path.stem, experiment_names(), n=1)
        hint = f"; a shipped one is called '{close[0]}', without folder and .toml" if close else ""
        raise ExperimentError(str(path), "", f"cannot read this experiment: {reason}{hint}") from error
    values = with_settings(_parsed(text, str(path)), settings)
    return experiment_from(values, str(path)).from_file(str(path), path.parent)


def experiment_of(experiment: Experiment | Path | str, settings: Settings = ()) -> Experiment:
    """The experiment itself, or that of a file or shipped name; with settings as `load_experiment` takes them.

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
    values = with_settings(experiment.model_dump(mode="json", exclude_unset=True), settings)
    return experiment_from(values, experiment.where).from_file(experiment.where, experiment.folder)


def experiment_names() -> tuple[str, ...]:
    """Names of the experiments that ship with the package, for `load_experiment`, `run` and `margins`."""
    return shipped.names(*_SHIPPED)


def shipped_text(name: str) -> str:
    """The TOML file of a shipped experiment, with its comments.

    Raises
    ------
    ExperimentError
        No such experiment; the nearest name is suggested.
    """
    if name not in experiment_names():
        raise ExperimentError(f"experiment '{name}'", "", f"no such experiment{nearest(name, experiment_names())}")
    return shipped.text(*_SHIPPED, name)


def shipped_experiment(name: str, settings: Settings = ()) -> Experiment:
    """A shipped experiment by name; see `load_experiment` for the settings.

    Raises
    ------
    ExperimentError
        No such experiment, or as `experiment_from`.
    """
    where = f"experiment '{name}'"
    values = with_settings(_parsed(shipped_text(name), where), settings)
    return experiment_from(values, where).from_file(where, Path())


def experiment_from(values: Mapping[str, Any], where: str = "experiment") -> Experiment:
    """An experiment from plain values, as a TOML file has them.

    Raises
    ------
    ExperimentError
        An unknown key, a missing one, or a value that it cannot take; names place, value and remedy, one line each.
    """
    try:
        return Experiment.model_validate(dict(values))
    except ValidationError as error:
        found = error.errors()
        keys = [_key_of(each["loc"], values) for each in found]
        lines = [f"{key}: {_said(each, values)}" for key, each in zip(keys, found, strict=True)]
        raise ExperimentError(where, "", "; ".join(dict.fromkeys(lines))) from None


def with_settings(values: Mapping[str, Any], settings: Settings) -> dict[str, Any]:
    """Plain values with some replaced: "loop.duration=3", "reference.position_change=[0, 0, 0.01]", "plant.kind=fmu2".

    Values in texts are TOML; what is not is taken as a text. Those of a mapping are taken as they are, arrays as lists.

    Raises
    ------
    SettingError
        No "=", or a key below something that is no table.
    """
    made: dict[str, Any] = _copied(values)
    for where, key, value in _keys_and_values(settings):
        names = key.strip().split(".")
        if not all(names):
            raise SettingError(where, "", "expected key=value, for instance loop.duration=2")
        table: Any = made
        for name in names[:-1]:
            table = table.setdefault(name, {}) if isinstance(table, dict) else _element(table, name)
            if table is None:
                break
        if not isinstance(table, dict):
            raise SettingError(where, "", f"{key.rpartition('.')[0]} is no table of the experiment")
        table[names[-1]] = value
    return made


def _keys_and_values(settings: Settings) -> Iterator[tuple[str, str, Any]]:
    """Of every setting what to call it in a message, its key, and its value."""
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
            yield where, key, tomllib.loads(f"value = {text}")["value"]
        except (ValueError, RecursionError):
            yield where, key, text.strip()


def _element(array: Any, name: str) -> Any:
    """Of [[change]] and [[disturbance]], 1-based."""
    known = isinstance(array, list) and name.isdigit() and 1 <= int(name) <= len(array)
    return array[int(name) - 1] if known else None


def _copied(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {k: _copied(v) for k, v in value.items()}
    return [_copied(v) for v in value] if isinstance(value, list) else value


def _parsed(text: str, where: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ExperimentError(where, "", f"is not TOML: {error}") from error


def _key_of(place: tuple[int | str, ...], values: Any) -> str:
    """A place in the file; the schema also counts the type of a controller or reference as a step on the way."""
    parts: list[str] = []
    for step in place:
        if isinstance(values, Mapping) and step not in values and values.get("type") == step:
            continue
        parts.append(str(step + 1) if isinstance(step, int) else step)
        if isinstance(values, list) and isinstance(step, int):
            values = values[step]
        else:
            values = values.get(step) if isinstance(values, Mapping) else None
    return ".".join(parts)


def _said(error: Any, values: Mapping[str, Any]) -> str:
    """What is wrong, in this project's words: the value found, what was expected, the remedy."""
    kind, context = error["type"], error.get("ctx", {})
    if kind == "extra_forbidden":
        return f"unknown key (= {error['input']!r}){nearest(str(error['loc'][-1]), _keys_beside(error['loc'], values))}"
    fixed = {
        "missing": "is missing; add it",
        "union_tag_not_found": "the key type is missing; `gough-stewart experiments heave_step` shows a whole file",
        "union_tag_invalid": "type is {tag!r}; expected one of {expected_tags}",
    }
    if kind in fixed:
        return fixed[kind].format(**context)
    text = str(context.get("error", "")) or error["msg"].replace("Input should be", "expected")
    if kind in ("model_attributes_type", "model_type"):
        text = "expected a table of keys"
    return text if isinstance(error["input"], Mapping) else f"is {error['input']!r}; {text}"


def _keys_beside(place: tuple[int | str, ...], values: Mapping[str, Any]) -> list[str]:
    """The keys that the table at a place may have."""
    model: type[BaseModel] = Experiment
    for step in place[:-1]:
        found = _models_in(model.model_fields[step].annotation) if step in model.model_fields else []
        if len(found) == 1:
            model = found[0]
        elif found:
            tags = {_tag(each): each for each in found}
            model = tags.get(_type_at(step, values), found[0])
    return list(model.model_fields)


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in getattr(annotation, "__args__", ()) for model in _models_in(part)]


def _tag(model: type[BaseModel]) -> str:
    return str(model.model_fields["type"].annotation.__args__[0])  # type: ignore[union-attr]


def _type_at(step: int | str, values: Mapping[str, Any]) -> str:
    section = values.get(str(step))
    return str(section.get("type")) if isinstance(section, Mapping) else ""
