"""Errors as users meet them: their words, the data that they carry, and both in copies and pickles."""

import pickle
from collections.abc import Callable
from copy import copy, deepcopy
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs

PAPER = gs.load_preset("liu2000")


def failed_step() -> None:
    model = gs.SteppingModel(PAPER)
    model.set("position", PAPER.base_points[3] - PAPER.platform_points[3])
    model.set("orientation", [0.0, 0.0, 0.0])
    model.do_step(0.0, 0.1)


# What is done, how the message begins, and the data.
MET: list[tuple[Callable[[], object], str, dict[str, Any]]] = [
    (lambda: PAPER.with_parameters({"gravity": [0, 0]}), "gravity: has shape (2,); expected", {"field": "gravity"}),
    (lambda: gs.load_platform("no.toml"), "no.toml: cannot read this platform file", {"where": "no.toml"}),
    (lambda: gs.SteppingModel(PAPER).get("leg_lenght"), "leg_lenght: no such variable", {"name": "leg_lenght"}),
    (
        failed_step,
        "leg_length[4] = 0 at time 0 s: the leg has",
        {"quantity": "leg_length[4]", "value": 0.0, "time": 0.0},
    ),
    (
        lambda: gs.static_leg_forces(PAPER, PAPER.home_position, np.array([0, 0, np.pi / 2])),
        "leg Jacobian has condition number",
        {"condition_number": pytest.approx(1e17, rel=10)},
    ),
    (lambda: gs.forward_kinematics(PAPER, np.tile([9.0, 1.0], (2, 3))), "row 0, lengths [9.0", {"row": (0,)}),
]


@pytest.mark.parametrize(("call", "words", "data"), MET, ids=lambda value: value if isinstance(value, str) else "")
def test_an_error_keeps_text_and_data_on_its_way(call: Callable[[], object], words: str, data: dict[str, Any]) -> None:
    with pytest.raises(gs.GoughStewartError) as caught:
        call()
    error = caught.value
    assert str(error).startswith(words)
    assert {name: vars(error)[name] for name in data} == data
    for other in (copy(error), deepcopy(error), pickle.loads(pickle.dumps(error))):
        assert type(other) is type(error)
        assert (str(other), repr(vars(other))) == (str(error), repr(vars(error)))
