"""The vector of all signals: where which element lies."""

import numpy as np
import pytest

from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.model import ModelPlant
from tests.support.uneven import STATE, UNEVEN


def test_signals_lie_as_the_notation_says() -> None:
    """Expected: docs/notation.md: pose, its rates, lengths, their rates; in whatever order they are asked for."""
    assert signals.SIZE == 24
    assert signals.positions(signals.NAMES).tolist() == list(range(24))
    assert signals.positions(["leg_velocity", "position"]).tolist() == [*range(18, 24), 0, 1, 2]
    assert signals.positions("leg_length").tolist() == list(range(12, 18))
    assert signals.positions(name for name in ("angular_velocity", "orientation")).tolist() == [9, 10, 11, 3, 4, 5]
    assert signals.column_names(["velocity", "leg_length"]) == [
        *("velocity[1]", "velocity[2]", "velocity[3]"),
        *(f"leg_length[{k}]" for k in range(1, 7)),
    ]


def test_they_are_the_head_of_what_a_plant_gives() -> None:
    """Expected: the state as it was set."""
    with ModelPlant(UNEVEN, STATE) as plant:
        head = plant.results()[: signals.SIZE]
    names = ("position", "orientation", "velocity", "angular_velocity")
    assert head[signals.positions(names)] == pytest.approx(np.concatenate(STATE), abs=0)


def test_what_is_no_signal_is_refused() -> None:
    with pytest.raises(
        ControllerError, match=r"^no signals; expected one or more of position, orientation, velocity, "
    ):
        signals.positions([])
    with pytest.raises(ControllerError, match=r"^no signal 'velocty'.*did you mean 'velocity'"):
        signals.positions(["position", "velocty"])
