"""Figures as they were drawn, instead of their pixels."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

from matplotlib.axes import Axes
from matplotlib.figure import Figure

_SAVE = Figure.savefig


@contextmanager
def figures_drawn() -> Iterator[list[Figure]]:
    """The figures that are saved meanwhile, once each, in order."""
    found: list[Figure] = []

    def noted(figure: Figure, *arguments: Any, **options: Any) -> None:
        if not any(figure is each for each in found):
            found.append(figure)
        _SAVE(figure, *arguments, **options)

    with patch.object(Figure, "savefig", noted):
        yield found


def axes_titled(figure: Figure, beginning: str) -> Axes:
    """The axes of a figure whose title begins so."""
    (found,) = (axes for axes in figure.axes if axes.get_title(loc="left").startswith(beginning))
    return found
