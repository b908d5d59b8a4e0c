"""The figures of a report as matplotlib's axes, from which lines and titles can be read."""

from typing import Any
from unittest.mock import patch

from matplotlib.figure import Figure

from gough_stewart.harness.report import figures as drawing
from gough_stewart.harness.report.document import Report


def drawn(report: Report) -> dict[str, list[Any]]:
    """The axes of each figure by its name."""
    made: list[Figure] = []

    def noted(draw: Any, width: float, height: float, kinds: tuple[str, ...]) -> dict[str, bytes]:
        figure = Figure(figsize=(width, height), layout="constrained")
        draw(figure)
        made.append(figure)
        return dict.fromkeys(kinds, b"")

    with patch.object(drawing, "files_of", noted):
        names = drawing.figures(report, ("png",))
    return {name.removesuffix(".png"): list(figure.axes) for name, figure in zip(names, made, strict=True)}
