"""Excitation: finite Fourier series in all six coordinates, from rest to rest."""

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from gough_stewart.harness.motion.motion import Motion
from gough_stewart.harness.motion.profiles import Profile, quintic, sine
from gough_stewart.harness.motion.references import AboutPose
from gough_stewart.harness.quantities import Frequency, Orientation, Position, PositiveTime
from gough_stewart.model.vectors import Array, FloatArray

_Positions = Annotated[list[Position], Field(min_length=1, max_length=100)]
_Orientations = Annotated[list[Orientation], Field(min_length=1, max_length=100)]


class Excitation(AboutPose):
    """A finite Fourier series in every coordinate: w(t) Σ_k (a_k sin 2π k f t + b_k cos 2π k f t).

    `position_sine`, `position_cosine` [m], `orientation_sine`, `orientation_cosine` [rad]: the coefficients, three
    numbers for each k = 1, 2, …; `frequency` f [Hz], `duration` [s], `fade` [s]: the time over which w rises as a
    quintic, and falls at the end, so that pose, velocity and acceleration start and end at rest. About `position` [m]
    and `orientation` [rad], home by default.

    Examples
    --------
    >>> swing = gs.Excitation(frequency=0.5, duration=4, position_sine=[[0.02, 0, 0]], position_cosine=[[0, 0, 0.01]],
    ...                       orientation_sine=[[0, 0.02, 0]], orientation_cosine=[[0, 0, 0]])
    >>> swing.about(gs.load_preset("liu2000"))(np.linspace(0, 4, 5)).velocity.shape
    (5, 3)
    """

    type: Literal["excitation"] = "excitation"
    frequency: Frequency
    duration: PositiveTime
    fade: PositiveTime = 1.0
    position_sine: _Positions
    position_cosine: _Positions
    orientation_sine: _Orientations
    orientation_cosine: _Orientations

    @model_validator(mode="after")
    def _alike(self) -> "Excitation":
        sizes = {name: len(getattr(self, name)) for name in _COEFFICIENTS}
        if len(set(sizes.values())) > 1:
            listed = ", ".join(f"{name} {size}" for name, size in sizes.items())
            raise ValueError(f"expected the same number of coefficients of each kind; found {listed}")
        if 2 * self.fade > self.duration:
            raise ValueError(f"fade is {self.fade:g} s at either end of a duration of {self.duration:g} s")
        return self

    def _at(self, time: Array) -> Motion:
        begin, end = quintic(time, self.fade), quintic(time - (self.duration - self.fade), self.fade)
        window = begin.times(Profile(1 - end.value, -end.rate, -end.acceleration))
        parts = []
        sines, cosines = self.coefficients
        for k in range(len(sines)):
            omega = 2 * math.pi * (k + 1) * self.frequency
            for phase, direction in ((0.0, sines[k]), (math.pi / 2, cosines[k])):
                parts.append((sine(omega * time + phase, omega).times(window), direction))
        return self._by(*parts)

    @property
    def coefficients(self) -> tuple[FloatArray, FloatArray]:
        """The coefficients of the sines and of the cosines (N, 6) [m], [rad]."""
        arrays = [np.array(getattr(self, name), dtype=float) for name in _COEFFICIENTS]
        return np.hstack([arrays[0], arrays[2]]), np.hstack([arrays[1], arrays[3]])

    @property
    def highest_frequency(self) -> float:
        """The frequency of the last harmonic [Hz]."""
        return self.frequency * len(self.position_sine) / self.time_scale


_COEFFICIENTS = ("position_sine", "position_cosine", "orientation_sine", "orientation_cosine")
