"""Figures as they were drawn, instead of their pixels."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

import numpy as np
from matplotlib.figure import Figure

from tests.support.arrays import FloatArray


@contextmanager
def figures_drawn() -> Iterator[list[Figure]]:
    """The figures that are saved meanwhile, once each, in order; their files stay empty."""
    found: list[Figure] = []

    def noted(figure: Figure, *_: Any, **__: Any) -> None:
        if not any(figure is each for each in found):
            found.append(figure)

    with patch.object(Figure, "savefig", noted):
        yield found


def data_of(line: Any) -> tuple[FloatArray, FloatArray]:
    """Abscissae and ordinates of a line."""
    x, y = (np.asarray(each, dtype=float) for each in line.get_data())
    return x, y
