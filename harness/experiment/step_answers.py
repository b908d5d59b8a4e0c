"""Answers of a closed loop to a step of force on one leg."""

import math
from typing import Any

import numpy as np

from gough_stewart.harness.control.linear import modes
from gough_stewart.harness.control.margins import closed_loop
from gough_stewart.harness.control.state_space import StateSpace, discretised
from gough_stewart.model.vectors import FloatArray

_POINTS = 500
_LONGEST = 10_000  # points of a step response
_SETTLED = 0.01


def step_answers(L: Any) -> tuple[FloatArray, FloatArray]:
    """Times (n,) [s] and answers (6, n) [1] to a step of force on each leg: the share that is compensated."""
    closed = closed_loop(L)
    time = _times(closed)
    # the input is constant, so that a system in continuous time is sampled exactly
    sampled = closed if closed.isdtime() else discretised(closed, float(time[1]), "zoh")
    # column k of the states answers to leg k
    states, values = np.zeros(sampled.B.shape), np.empty((L.noutputs, len(time)))
    direct = np.diag(sampled.D)
    for n in range(len(time)):
        values[:, n] = (sampled.C * states.T).sum(axis=1) + direct
        states = sampled.A @ states + sampled.B
    # slow modes may hardly show: end soon after the response has settled
    moving = np.nonzero((np.abs(values - values[:, -1:]) > _SETTLED).any(axis=0))[0]
    shown = min(len(time), max(10, int(1.5 * (moving[-1] + 1)))) if moving.size else len(time)
    every = max(1, shown // _POINTS)
    return time[:shown:every], values[:, :shown:every]


def _times(closed: StateSpace) -> FloatArray:
    """Times until the slowest mode has decayed to e⁻⁶, with a limited number of points [s]."""
    found = modes(closed)
    end = 6 / min((-mode.eigenvalue.real for mode in found), default=6.0)
    if closed.isdtime():
        return np.asarray(np.arange(min(math.ceil(end / closed.dt) + 1, _LONGEST)) * closed.dt)
    # fine enough for the fastest visible mode
    fastest = 2 * math.pi * max((mode.frequency for mode in found), default=1.0)
    return np.linspace(0, end, min(max(_POINTS, math.ceil(3 * end * fastest)), _LONGEST))
