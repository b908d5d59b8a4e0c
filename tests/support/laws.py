"""The law of a controller of one member, called with vectors instead of columns of members."""

import numpy as np

from gough_stewart.harness.control import laws_of_members
from gough_stewart.harness.control.laws_of_members import KnownAhead
from gough_stewart.harness.control.linear_controller import Controller
from tests.support.arrays import FloatArray


class OneLaw:
    """As `Law`, without the member axis; its errors are raised."""

    def __init__(self, law: laws_of_members.Law) -> None:
        self._law, self.used = law, law.used

    @property
    def state(self) -> FloatArray:
        return np.array(self._law.state[0])

    def force(self, k: int, time: float, reference: FloatArray, measured: FloatArray, excess: FloatArray) -> FloatArray:
        force = np.array(self._law.force(k, time, reference, measured[None], excess[None])[0])
        for error in self._law.failures.values():
            raise error
        return force


def law_of(
    controller: Controller,
    sample_time: float,
    jacobians: FloatArray,
    reference: FloatArray,
    measured: FloatArray,
    known: KnownAhead | None = None,
) -> OneLaw:
    """Begun with references (30,) and measurements (24,)."""
    return OneLaw(laws_of_members.law_of(controller, sample_time, jacobians, known)(reference, measured[None]))
