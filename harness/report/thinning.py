"""A report with fewer points in its charts, for data that other programs read; no peak is lost."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from gough_stewart.harness.output.display_resolution import decimated
from gough_stewart.harness.report.chart import Chart, Series
from gough_stewart.harness.report.document import Part, Report
from gough_stewart.harness.report.scene import Scene

# Points of a line, and frames of a scene.
POINTS, FRAMES = 800, 201


def thinned(report: Report, points: int = POINTS) -> Report:
    """The same report with at most so many points in each line, the smallest and the largest of each interval."""
    sections = tuple(replace(each, parts=tuple(map(_Thinned(points), each.parts))) for each in report.sections)
    return replace(report, sections=sections)


class _Thinned:
    """Thins one part after the other; series that keep the same rows share them."""

    def __init__(self, points: int) -> None:
        self.points = points

    def __call__(self, part: Part) -> Part:
        if isinstance(part, Chart) and part.samples is not None:
            # millions of numbers; the bands beside them say what they have in common
            part = replace(part, samples=None)
        if isinstance(part, Chart) and part.kind in ("line", "step"):
            return self._chart(part)
        return _frames(part) if isinstance(part, Scene) else part

    def _chart(self, chart: Chart) -> Chart:
        if all(len(each.values) <= self.points for each in chart.series):
            return chart
        series = tuple(self._series(chart, each) for each in chart.series)
        # every series has abscissae of its own now
        return replace(chart, x=replace(chart.x, values=np.zeros(0)), series=series)

    def _series(self, chart: Chart, series: Series) -> Series:
        x = chart.x_of(series)
        rows = np.arange(len(x), dtype=float)
        kept, _ = decimated(rows, series.values, self.points)
        index = kept.astype(int)
        arrays = {name: getattr(series, name) for name in ("low", "high", "members")}
        some = {name: each[index] for name, each in arrays.items() if each is not None}
        return replace(series, x=x[index], values=series.values[index], of=len(x), **some)


def _frames(scene: Scene) -> Scene:
    """A scene with few frames; what was on or off between two of them is on if it was on in any part."""
    n = len(scene.time)
    if n <= FRAMES:
        return scene
    kept = np.unique(np.linspace(0, n - 1, FRAMES).astype(int))
    names = ("time", "pose", "leg_length", "orientation", "reference", "actuator_force", "external_force", "nearness")
    arrays = {name: each[kept] for name in names if (each := getattr(scene, name)) is not None}
    flags = tuple(
        replace(
            flag,
            values="".join("01"["1" in flag.values[a:b]] for a, b in pairwise(kept)),
        )
        for flag in scene.flags
    )
    return replace(scene, flags=flags, **arrays)
