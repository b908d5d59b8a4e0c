"""The files of a search: an experiment file that runs, and all candidates."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from gough_stewart.harness.experiment.file import text_with_settings
from gough_stewart.harness.experiment.overrides import Settings
from gough_stewart.harness.quantities import PLAIN
from gough_stewart.harness.report.versions import versions
from gough_stewart.harness.tuning.candidates import Evaluation
from gough_stewart.harness.tuning.result import Tuning

TUNED = "tuned.toml"
FILES = frozenset({TUNED, "tuning.json", "candidates.csv"})


def tuning_files(found: Tuning, name: Path | str | None, folder: Path, settings: Settings = ()) -> dict[str, bytes]:
    """The files by name: the experiment's own text with changed keys and its comments, and all candidates.

    Parameters
    ----------
    name
        The file or shipped name of the experiment; None if it has no file.
    folder
        Their folder: file names in the experiment become relative to it.
    settings
        Other changed settings.
    """
    numbers = {**summary(found), "versions": versions()}
    values = {".".join(axis.place.path): _written(found.values[axis.key], axis.unit) for axis in found.search.axes}
    return {
        TUNED: text_with_settings(found.experiment if name is None else name, settings, values, folder=folder).encode(),
        "tuning.json": (json.dumps(numbers, indent=2, ensure_ascii=False) + "\n").encode(),
        "candidates.csv": found.candidates.write_csv().encode(),
    }


def _written(value: float | int, unit: str) -> float | int | str:
    """With its unit, for a reader; plain numbers and shares have none."""
    return value if unit in (PLAIN, "1") else f"{value!r} {unit}"


def summary(found: Tuning) -> dict[str, Any]:
    """The result as plain types; None for infinite values."""
    goal = found.search.goal

    def plain(each: Evaluation | None) -> dict[str, Any] | None:
        if each is None:
            return None
        names = [condition.metric for condition in goal.conditions]
        values = dict(zip(names, map(_finite, each.conditions), strict=True))
        return {"value": _finite(each.value), "conditions": values, "failed": each.failed}

    return {
        "metric": goal.metric,
        "subject_to": [condition.text for condition in goal.conditions],
        "quantile": goal.quantile if found.search_is_over_members else None,
        "values": found.values,
        "units": {axis.key: axis.unit for axis in found.search.axes},
        "members": found.members,
        "seen": plain(found.seen),
        "before": plain(found.before),
        "fresh_members": found.fresh_members,
        "fresh": plain(found.fresh),
        "before_fresh": plain(found.before_fresh),
        "candidates": len(found.search.tried),
        "ending": found.search.ending,
        "left_out": found.left_out,
        "integration_error": found.integration_error,
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
