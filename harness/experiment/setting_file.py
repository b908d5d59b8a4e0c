"""Changes single keys in the file of an experiment and leaves everything else as its author wrote it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit

from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.file import Settings, experiment_text, keys_and_values, set_key, with_settings
from gough_stewart.model.toml import toml_values


def text_with_settings(name: Path | str, *settings: Settings) -> str:
    """The TOML text of an experiment's file or a shipped experiment, with keys set; comments and order are kept.

    Raises
    ------
    ExperimentError
        The file cannot be read, or a key cannot be set in it.
    """
    text, where = experiment_text(name)
    document = tomlkit.parse(text)
    expected: Mapping[str, Any] = toml_values(text)
    for some in settings:
        expected = with_settings(expected, some)
        for place, key, value in keys_and_values(some):
            set_key(document, place, key, value)
    written = tomlkit.dumps(document)
    if toml_values(written) != expected:
        raise ExperimentError(where, "", "its keys cannot be set in place; write its tables one after another")
    return written
