"""A plant with a closed form: six different masses on rails, L̈ = F/m, in the places of the legs."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from gough_stewart import StepError
from gough_stewart.harness.plants.members import zeros
from gough_stewart.harness.plants.plant import BoolArray, Plant
from gough_stewart.model import interface
from gough_stewart.model.errors import MembersError
from tests.support.arrays import FloatArray

MASSES = np.array([2.0, 1.6, 2.5, 1.25, 4.0, 3.2])  # [kg]
LENGTHS = np.array([1.0, 1.3, 0.8, 1.1, 1.6, 0.9])  # at the start [m]
LENGTH, VELOCITY = slice(12, 18), slice(18, 24)
# What the platform does is a sum of what the legs do, another one in each component.
_POSE = np.array(
    [
        [0.3, -0.2, 0.1, 0.4, -0.1, 0.2],
        [-0.1, 0.5, 0.2, -0.3, 0.2, 0.1],
        [0.2, 0.1, 0.3, 0.1, 0.2, 0.1],
        [0.1, 0.0, -0.2, 0.3, 0.1, -0.4],
        [0.0, -0.3, 0.2, 0.1, 0.4, 0.1],
        [0.2, 0.2, -0.1, 0.0, -0.3, 0.5],
    ]
)


def signals_of(length: FloatArray, velocity: FloatArray, acceleration: FloatArray) -> FloatArray:
    """Pose, its rate, lengths, their rate, accelerations (..., 30) of such legs (..., 6)."""
    pose, rate, change = (
        # column by column, so that the last bits are the same for one and for many
        sum((each[..., leg, None] * _POSE[:, leg] for leg in range(6)), start=0.0 * each)
        for each in (length, velocity, acceleration)
    )
    return np.concatenate([pose, rate, length, velocity, change], axis=-1)


class Masses(Plant):
    """A `Plant`; its parameter `platform_mass` multiplies all masses."""

    def __init__(self, platform_mass: float = 1.0, fails_at: float = np.inf) -> None:
        self.mass, self.fails_at = platform_mass * MASSES, fails_at
        self.x, self.v = LENGTHS.copy(), np.zeros(6)
        self.inputs = np.zeros(12)

    def set_inputs(self, inputs: FloatArray) -> None:
        self.inputs = inputs.copy()

    def set_parameters(self, values: Mapping[str, object]) -> None:
        self.mass = float(np.asarray(values["platform_mass"])) * MASSES

    def results(self) -> FloatArray:
        y = np.zeros(interface.size_of(interface.RESULTS))
        y[:30] = signals_of(self.x, self.v, self.inputs[:6] / self.mass)
        return y

    def do_step(self, time: float, step: float) -> None:
        if time + step > self.fails_at + 1e-12:
            raise StepError("leg_length[1]", 0.0, self.fails_at, "the leg has collapsed")
        a = self.inputs[:6] / self.mass
        self.x, self.v = self.x + self.v * step + a * step**2 / 2, self.v + a * step

    def close(self) -> None: ...


class ManyMasses(Plant):
    """Members of the same kind side by side, each with its own factor of all masses and end."""

    def __init__(self, platform_mass: ArrayLike, fails_at: ArrayLike = np.inf) -> None:
        factors = np.atleast_1d(np.asarray(platform_mass, dtype=float))
        self.shape = factors.shape
        self.mass = zeros(self.shape, 6)
        self.mass[...] = factors[:, None] * MASSES
        self.fails_at = np.broadcast_to(fails_at, self.shape)
        self.x, self.v, self.inputs = zeros(self.shape, 6), zeros(self.shape, 6), zeros(self.shape, 12)
        self.x[...] = LENGTHS
        self.frozen = np.zeros(self.shape, dtype=bool)

    def set_inputs(self, inputs: FloatArray) -> None:
        assert inputs.T.flags.c_contiguous
        self.inputs[...] = inputs

    def set_parameters(self, values: Mapping[str, object]) -> None:
        self.set_parameters_of(np.ones(self.shape, dtype=bool), values)

    def set_parameters_of(self, members: BoolArray, values: Mapping[str, object]) -> None:
        factors = np.broadcast_to(np.asarray(values["platform_mass"], dtype=float), self.shape)
        np.copyto(self.mass, factors[:, None] * MASSES, where=members[:, None])

    def results(self) -> FloatArray:
        y = zeros(self.shape, interface.size_of(interface.RESULTS))
        y[..., :30] = signals_of(self.x, self.v, self.inputs[..., :6] / self.mass)
        return y

    def do_step(self, time: float, step: float) -> None:
        failing = ~self.frozen & (time + step > self.fails_at + 1e-12)
        self.freeze(failing)
        a = self.inputs[..., :6] / self.mass
        go = ~self.frozen[:, None]
        np.copyto(self.x, self.x + self.v * step + a * step**2 / 2, where=go)
        np.copyto(self.v, self.v + a * step, where=go)
        if failing.any():
            raise MembersError(
                {
                    k: StepError("leg_length[1]", 0.0, float(self.fails_at[k]), "the leg has collapsed")
                    for k in np.flatnonzero(failing).tolist()
                }
            )

    def freeze(self, members: BoolArray) -> None:
        self.frozen = self.frozen | members

    def close(self) -> None: ...
