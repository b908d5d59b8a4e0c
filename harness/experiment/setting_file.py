"""Experiment files with changed keys: everything else stays as its author wrote it, and files are found from there."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit

from gough_stewart.harness.errors import SettingError
from gough_stewart.harness.experiment.file import (
    Settings,
    experiment_from,
    experiment_text,
    is_shipped,
    keys_and_values,
    set_key,
    with_settings,
)
from gough_stewart.harness.experiment.named_files import names_from
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.model.process.toml import toml_values


def text_with_settings(source: Experiment | Path | str, *settings: Settings, folder: Path | None = None) -> str:
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

    Raises
    ------
    ExperimentError
        The source cannot be read, or the experiment with these keys is not valid.
    """
    if isinstance(source, Experiment):
        text = tomlkit.dumps(without_none(source.model_dump(mode="json", exclude_unset=True)))
        where, origin = source.where, source.folder
    else:
        text, where = experiment_text(source)
        origin = Path() if is_shipped(source) else Path(source).parent
    document = tomlkit.parse(text)
    expected: Mapping[str, Any] = toml_values(text)
    chosen = [*settings]
    for some in settings:
        expected = with_settings(expected, some)
    experiment = experiment_from(expected, where, origin)
    if folder is not None:
        names = {".".join(key): name for key, name in names_from(experiment, folder).items()}
        chosen.append(names)
        expected = with_settings(expected, names)
    try:
        for some in chosen:
            for place, key, value in keys_and_values(some):
                set_key(document, place, key, value)
        written = tomlkit.dumps(document)
        if toml_values(written) == expected:
            return written
    except (SettingError, ValueError, KeyError):  # of tables that are not written one after another
        pass
    return tomlkit.dumps(expected)


def without_none(value: Any) -> Any:
    """Plain values without the keys that are None, which TOML does not have."""
    if isinstance(value, dict):
        return {key: without_none(each) for key, each in value.items() if each is not None}
    return [without_none(each) for each in value] if isinstance(value, list) else value
