"""A plant with a closed form: six masses on rails, L̈ = F/m, in the places of the legs."""

from collections.abc import Mapping
from types import TracebackType
from typing import Self

import numpy as np

from gough_stewart.model.errors import StepError
from gough_stewart.model.kernel import N_RESULTS
from gough_stewart.model.vectors import FloatArray

LENGTH, VELOCITY = slice(12, 18), slice(18, 24)


class Masses:
    """A `Plant`; the position of the platform is the mean length, upwards."""

    def __init__(self, mass: float = 2.0, length: float = 1.0, fails_at: float = np.inf) -> None:
        self.mass, self.fails_at = mass, fails_at
        self.x, self.v = np.full(6, length), np.zeros(6)
        self.inputs = np.zeros(12)
        self.forces: list[FloatArray] = []

    def set_inputs(self, inputs: FloatArray) -> None:
        self.inputs = inputs.copy()

    def set_parameters(self, values: Mapping[str, object]) -> None:
        self.mass = float(np.asarray(values["platform_mass"]))

    def results(self) -> FloatArray:
        y = np.zeros(N_RESULTS)
        y[2] = self.x.mean()
        y[LENGTH], y[VELOCITY] = self.x, self.v
        return y

    def do_step(self, time: float, step: float) -> None:
        if time + step > self.fails_at + 1e-12:
            raise StepError("leg_length[1]", 0.0, self.fails_at, "the leg has collapsed")
        a = self.inputs[:6] / self.mass
        self.x, self.v = self.x + self.v * step + a * step**2 / 2, self.v + a * step
        self.forces.append(self.inputs[:6].copy())

    def close(self) -> None: ...

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...
