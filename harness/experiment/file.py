"""Experiments from TOML files, from the shipped ones, and with settings; the files that they name."""

import ast
import hashlib
import json
import os
from collections.abc import Mapping
from difflib import get_close_matches
from functools import reduce
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from gough_stewart.harness.control.controllers import PythonController
from gough_stewart.harness.errors import ExperimentError, SettingError
from gough_stewart.harness.experiment.overrides import Settings, inner, keys_and_values, set_key, with_settings
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.motion.recorded.recording import recording_path
from gough_stewart.harness.motion.references import FromFile
from gough_stewart.harness.section import complaints, file_names
from gough_stewart.model.interface import nearest
from gough_stewart.model.process.toml import toml_files, toml_values

_SHIPPED = ("gough_stewart.harness.experiment", "shipped")


def load_experiment(name: Experiment | Path | str, settings: Settings = ()) -> Experiment:
    """Read an experiment file, or the shipped experiment of a name; a file of that name takes precedence.

    Parameters
    ----------
    name
        A TOML file, or one of `experiment_names()`; or an `Experiment`, whose keys may be changed likewise.
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

    See Also
    --------
    experiment_names, run, check

    Examples
    --------
    >>> experiment = gs.load_experiment("heave_step", {"loop.duration": 1, "controller.bandwidth": 3})
    """
    if isinstance(name, Experiment):
        if not settings:
            return name
        values = name.model_dump(mode="json", exclude_unset=True)
        return experiment_from(values, name.where, name.folder, settings, name.changed)
    if not isinstance(name, Path | str):
        text = f"is {name!r}; expected an Experiment, a file, or a shipped name such as 'heave_step'"
        raise ExperimentError("experiment", "", text)
    text, where, folder = _read(name)
    try:
        values = toml_values(text)
    except ValueError as error:
        raise ExperimentError(where, "", str(error)) from error
    if "platform_mass" in values and "base_points" in values:
        raise ExperimentError(
            where, "", "is a platform file; expected an experiment that names it: platform.file = 'FILE.toml'"
        )
    return experiment_from(values, where, folder, settings)


def _read(name: Path | str) -> tuple[str, str, Path]:
    """The TOML text of an experiment's file or of a shipped experiment, its name for messages, and its folder."""
    path, shipped = Path(name), toml_files(*_SHIPPED)
    if str(name) in shipped and not path.is_file():
        return shipped[str(name)].read_text(encoding="utf-8"), f"experiment '{name}'", Path()
    try:
        return path.read_text(encoding="utf-8-sig"), str(path), path.parent
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is not UTF-8 text"
        close = get_close_matches(path.stem, shipped, n=1)
        hint = (
            f"did you mean '{close[0]}', which ships with the package?"
            if close
            else "expected a TOML file, or a shipped experiment, which `gough-stewart experiments` lists"
        )
        raise ExperimentError(str(path), "", f"cannot read this experiment: {reason}; {hint}") from error


def experiment_names() -> tuple[str, ...]:
    """Names of the shipped experiments, for `load_experiment`, `run` and `margins`.

    Returns
    -------
    tuple of str
        In alphabetical order.

    See Also
    --------
    load_experiment, preset_names

    Examples
    --------
    >>> "heave_step" in gs.experiment_names()
    True
    """
    return tuple(toml_files(*_SHIPPED))


def shipped_text(name: str) -> str:
    """The TOML file of a shipped experiment, with its comments."""
    shipped = toml_files(*_SHIPPED)
    if name not in shipped:
        raise ExperimentError(f"experiment '{name}'", "", f"no such experiment{nearest(name, shipped)}")
    return shipped[name].read_text(encoding="utf-8")


def experiment_from(
    values: Mapping[str, Any],
    where: str = "experiment",  # its file or name, for messages
    folder: Path = Path(),  # resolves file names
    settings: Settings = (),
    changed: Mapping[str, dict[str, Any]] | None = None,  # what calls before have set, as `Experiment.changed`
) -> Experiment:
    """An experiment from plain values, as in a TOML file, with settings; it remembers what its file has instead.

    Raises
    ------
    ExperimentError
        A key that is unknown, missing, or has an invalid value; names place, value and remedy, one line each.
    """
    settings = settings if isinstance(settings, Mapping | str) else list(settings)
    known = dict(changed or {})
    for _, key, value in keys_and_values(settings) if settings else ():
        name = key.strip()
        of_file = known[name]["file"] if name in known else reduce(inner, name.split("."), values)
        known[name] = json.loads(json.dumps({"value": value, "file": of_file}, default=str))
    tables = with_settings(values, settings) if settings else dict(values)
    try:
        return Experiment.built().model_validate(tables).from_file(where, folder, known)
    except ValidationError as error:
        raise ExperimentError(where, "", complaints(error, Experiment, tables)) from None


def text_with_settings(  # noqa: PLR0912 - one road, in sections
    source: Experiment | Path | str, *settings: Settings, folder: Path | None = None
) -> str:
    """The TOML text of an experiment with keys set, which `load_experiment` accepts from a file in a folder.

    Comments and order of an experiment's file, or of a shipped experiment, are kept. A file whose keys cannot be set in
    place is written anew, without its comments.

    Parameters
    ----------
    source
        A file, a shipped name, or an experiment without a file.
    folder
        The folder of the text, where the files that the experiment names have other relative names; by default that of
        the source.
    """
    import tomlkit  # slow, and only needed to write files

    if isinstance(source, Experiment):
        text = tomlkit.dumps(without_none(source.model_dump(mode="json", exclude_unset=True)))
        where, origin = source.where, source.folder
    else:
        text, where, origin = _read(source)
    document, expected = tomlkit.parse(text), toml_values(text)
    all_settings = [*settings]
    for keys in settings:
        expected = with_settings(expected, keys)
    experiment = experiment_from(expected, where, origin)
    if folder is not None:
        names = dict[str, str]()
        for path, file_name in file_names(experiment).items():
            name, in_folder = Path(file_name), origin / file_name
            is_recording = path[0] == "reference" and isinstance(experiment.reference, FromFile)
            if name.is_absolute():
                names[".".join(path)] = str(name)
            elif is_recording and recording_path(origin, str(name)) != in_folder:  # a shipped one
                if (folder / name).exists():
                    raise ExperimentError(
                        where,
                        ".".join(path),
                        f"is the shipped {name}, but {folder} has a file of this name, which an experiment there would "
                        "read; choose another folder",
                    )
                names[".".join(path)] = str(name)
            else:
                # resolved first: ".." leads elsewhere from a folder that is a link
                names[".".join(path)] = _from(in_folder.parent.resolve() / name.name, folder.resolve())
        all_settings.append(names)
        expected = with_settings(expected, names)
    try:
        for keys in all_settings:
            for setting, key, value in keys_and_values(keys):
                set_key(document, setting, key, value)
        written = tomlkit.dumps(document)
        if toml_values(written) == expected:
            return written
    except (SettingError, ValueError, KeyError):  # of tables that are not written one after another
        pass
    return tomlkit.dumps(expected)


def without_none(value: Any) -> Any:
    """Plain values without the keys that are None, which TOML does not have."""
    if isinstance(value, dict):
        return {key: without_none(inner) for key, inner in value.items() if inner is not None}
    return [without_none(element) for element in value] if isinstance(value, list) else value


def digests(experiment: Experiment) -> dict[str, str]:
    """SHA-256 of the files that an experiment names in its folder, by name; shipped files have none.

    Of a Python controller also the modules beside it that it imports, and the files that these name.
    """
    names = set(file_names(experiment).values())
    if isinstance(experiment.controller, PythonController) and experiment.controller.file is not None:
        # what import statements reach, of a package all, and files that texts name
        file = experiment.folder / experiment.controller.file
        folder, seen, waiting = file.parent, set[Path](), [file]
        while waiting:
            path = waiting.pop()
            if path in seen:
                continue
            seen.add(path)
            try:
                nodes = list(ast.walk(ast.parse(path.read_bytes()))) if path.suffix == ".py" else []
            except (OSError, SyntaxError, ValueError):
                continue  # executing it says so
            for node in nodes:
                imported = list[str]()
                if isinstance(node, ast.Import):
                    imported = [alias.name for alias in node.names]
                elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                    imported = [node.module]
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    waiting += [folder / node.value] * os.path.isfile(folder / node.value)  # noqa: PTH113 - of any text
                for name in imported:
                    spec = PathFinder.find_spec(name.partition(".")[0], [str(folder)])
                    if spec is not None and spec.submodule_search_locations is not None:
                        for place in spec.submodule_search_locations:
                            waiting += Path(place).rglob("*.py")
                    elif spec is not None and spec.origin is not None:
                        waiting.append(Path(spec.origin))
        names |= {_from(path, experiment.folder) for path in seen - {file}}
    paths = {name: experiment.folder / name for name in sorted(names)}
    return {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in paths.items() if path.is_file()}


def _from(file: Path, folder: Path) -> str:
    """The name of a file from a folder, the same wherever both lie."""
    try:
        return Path(os.path.relpath(file, folder)).as_posix()
    except ValueError:  # on another drive
        return file.as_posix()
