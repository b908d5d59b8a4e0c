"""The vector of all signals: where which element lies."""

import numpy as np
import pytest

from gough_stewart import GoughStewartError
from gough_stewart.harness.plants import signals


def test_signals_lie_as_the_notation_says_and_others_are_refused() -> None:
    """Expected: docs/notation.md: pose, its rates, lengths, their rates; in whatever order they are asked for."""
    n = np.arange(24)
    for names, wanted in (
        (signals.NAMES, n),
        (["leg_velocity", "position"], [*n[18:], *n[:3]]),
        ("leg_length", n[12:18]),
        ((name for name in ("angular_velocity", "orientation")), [*n[9:12], *n[3:6]]),
    ):
        assert signals.positions(names).tolist() == list(wanted)
    assert signals.column_names(["velocity", "leg_length"])[2:4] == ["velocity[3]", "leg_length[1]"]
    with pytest.raises(GoughStewartError, match=r"^no signals; expected one or more of position, orientation, "):
        signals.positions([])
    with pytest.raises(GoughStewartError, match=r"^no signal 'velocty'.*did you mean 'velocity'"):
        signals.positions(["position", "velocty"])
