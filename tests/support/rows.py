"""Rows passed to an observer as a loop passes them, in blocks."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from gough_stewart.harness.loop.rows import Observer
from gough_stewart.harness.loop.timing import Timing
from tests.support.arrays import FloatArray
from tests.support.fake_plants import Masses


def pass_rows(
    observer: Observer, timing: Timing, rows: Iterable[tuple[FloatArray, FloatArray, Any, Any]], ends: Any
) -> None:
    """Rows of signals (N, 24), inputs (N, 12) and two flags (N, 6), of which the first `ends` (N,) count."""
    counting = np.asarray(ends)
    block = observer.start(timing, Masses(), len(counting))

    def pass_on() -> None:
        block.counting = np.clip(counting - block.first, 0, block.count)
        observer.block(block)
        block.clear()

    for row in rows:
        block.add(*row)
        if block.count == block.most:
            pass_on()
    if block.count:
        pass_on()
