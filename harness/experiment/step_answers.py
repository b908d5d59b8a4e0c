"""Answers of a closed loop to a step of force on one leg."""

import math
from typing import Any

import control
import numpy as np

from gough_stewart.harness.control.linear import modes
from gough_stewart.harness.control.margins import closed_loop
from gough_stewart.model.vectors import FloatArray

_POINTS = 500
_LONGEST = 10_000  # points of a step response
_SETTLED = 0.01


def step_answers(L: Any) -> tuple[FloatArray, FloatArray]:
    """Times (n,) [s] and answers (6, n) [1] to a step of force on each leg: the share that is compensated."""
    time = _times(L)
    closed = closed_loop(L)
    answers = []
    for k in range(L.noutputs):
        one = control.ss(closed.A, closed.B[:, [k]], closed.C[[k]], closed.D[[k]][:, [k]], closed.dt)
        answers.append(control.forced_response(one, time, np.ones(len(time))).outputs)
    values = np.array(answers)
    # slow modes may hardly show: end soon after the response has settled
    moving = np.nonzero((np.abs(values - values[:, -1:]) > _SETTLED).any(axis=0))[0]
    shown = min(len(time), max(10, int(1.5 * (moving[-1] + 1)))) if moving.size else len(time)
    every = max(1, shown // _POINTS)
    return time[:shown:every], values[:, :shown:every]


def _times(L: Any) -> FloatArray:
    """Times until the slowest mode has decayed to e⁻⁶, with a limited number of points [s]."""
    rates = [-mode.eigenvalue.real for mode in modes(closed_loop(L))]
    end = 6 / min(rates, default=6.0)
    if L.isdtime(strict=True):
        return np.asarray(np.arange(min(math.ceil(end / L.dt) + 1, _LONGEST)) * float(L.dt))
    # fine enough for the fastest visible mode
    fastest = 2 * math.pi * max((mode.frequency for mode in modes(closed_loop(L))), default=1.0)
    return np.linspace(0, end, min(max(_POINTS, math.ceil(3 * end * fastest)), _LONGEST))
