"""Experiments from plain values."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit

import gough_stewart as gs


def experiment_from(values: Mapping[str, Any], settings: Mapping[str, Any] | None = None) -> gs.Experiment:
    """The experiment of a file with these values, which names its other files by absolute paths; None is left out."""
    with tempfile.TemporaryDirectory() as folder:
        return gs.load_experiment(written(values, Path(folder, "experiment.toml")), settings or {})


def written(experiment: gs.Experiment | Mapping[str, Any], path: Path) -> Path:
    """The file of an experiment, or of such values."""
    values = (
        experiment.model_dump(mode="json", exclude_unset=True) if isinstance(experiment, gs.Experiment) else experiment
    )
    path.write_text(tomlkit.dumps(_plain(values)), encoding="utf-8")
    return path


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items() if inner is not None}
    if isinstance(value, Path):
        return str(value)
    return [_plain(inner) for inner in value] if isinstance(value, list | tuple) else value
