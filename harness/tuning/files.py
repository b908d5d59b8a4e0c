"""The files of a search: an experiment file that runs, all candidates, and a figure."""

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gough_stewart.harness.experiment.file import Settings
from gough_stewart.harness.experiment.setting_file import text_with_settings
from gough_stewart.harness.output.colours import COLOURS
from gough_stewart.harness.output.plotting import entitle, pictures
from gough_stewart.harness.output.versions import versions
from gough_stewart.harness.quantities import PLAIN
from gough_stewart.harness.results.metric_folds import shown_metric
from gough_stewart.harness.tuning.candidates import Evaluation
from gough_stewart.harness.tuning.result import Tuning
from gough_stewart.harness.tuning.search import Search

TUNED = "tuned.toml"
FILES = frozenset({TUNED, "tuning.json", "candidates.csv", "search.png", "search.svg"})


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
        **pictures("search", partial(_draw, found.search), 8.0, 3.4),
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


def _draw(found: Search, figure: Figure) -> None:
    shown = shown_metric(found.goal.metric)
    unit = f" [{shown.unit}]" if shown.unit else ""
    values = shown.factor * np.array([each.value for each in found.tried])
    kept = np.array([found.goal.violation(each) == 0 for each in found.tried]) & np.isfinite(values)
    entitle(figure, f"{len(found.tried)} candidates for the {shown.text}")
    left, right = figure.subplots(1, 2)
    number = np.arange(1, len(values) + 1)
    best = np.minimum.accumulate(np.where(kept, values, np.inf))
    is_shown = np.isfinite(values) & (values <= _most(values[kept]))
    left.plot(number[is_shown & kept], values[is_shown & kept], ".", color=COLOURS[4], markersize=3)
    left.plot(number[is_shown & ~kept], values[is_shown & ~kept], "x", color="#999999", markersize=3)
    left.plot(number[np.isfinite(best)], best[np.isfinite(best)], color=COLOURS[0], drawstyle="steps-post")
    left.set_title(f"{shown.text}{unit}; line: the best so far")
    left.set_xlabel("candidate")
    points = np.array([each.point for each in found.tried], dtype=float)
    if len(found.axes) == 1:
        _one(right, found, points[:, 0], values, kept, is_shown)
    else:
        _two(figure, right, found, points, values, kept)


def _one(axes: Axes, found: Search, x: Any, values: Any, kept: Any, is_shown: Any) -> None:
    axes.plot(x[is_shown & kept], values[is_shown & kept], ".", color=COLOURS[0], markersize=4)
    axes.plot(x[is_shown & ~kept], values[is_shown & ~kept], "x", color="#999999", markersize=4)
    _name(axes.set_xlabel, found, 0)
    axes.set_title("landscape; crosses break a condition")


def _two(figure: Figure, axes: Axes, found: Search, points: Any, values: Any, kept: Any) -> None:
    """The first two keys, coloured by the metric."""
    axes.plot(points[~kept, 0], points[~kept, 1], "x", color="#999999", markersize=3.5)
    if kept.any():
        dots = axes.scatter(
            points[kept, 0], points[kept, 1], c=values[kept], s=12, cmap="viridis_r", vmax=_most(values[kept])
        )
        figure.colorbar(dots, ax=axes)
        best = int(np.flatnonzero(kept)[values[kept].argmin()])
        axes.plot(*points[best, :2], "o", markerfacecolor="none", markeredgecolor="black", markersize=9)
    _name(axes.set_xlabel, found, 0)
    _name(axes.set_ylabel, found, 1)
    if found.axes[0].is_log:
        axes.set_xscale("log")
    if found.axes[1].is_log:
        axes.set_yscale("log")
    axes.set_title("landscape; circle: the best, crosses break a condition")


def _name(set_label: Any, found: Search, k: int) -> None:
    axis = found.axes[k]
    set_label(f"{axis.key} [{axis.unit}]" if axis.unit else axis.key)


def _most(values: Any) -> float:
    """An upper limit of the axis, so that a few large values do not hide the others."""
    if not len(values):
        return np.inf
    low, middle, high = np.quantile(values, (0, 0.5, 1))
    return float(min(high, middle + 4 * (middle - low))) if middle > low else float(high)
