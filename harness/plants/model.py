"""The stepping model as a plant, in the same process."""

from collections.abc import Mapping

from gough_stewart.harness.plants.plant import Plant
from gough_stewart.model.interface import DEFAULT_TOLERANCE
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import State
from gough_stewart.model.stepping import Integrator, SteppingModel
from gough_stewart.model.vectors import FloatArray


class ModelPlant(Plant):
    """The stepping model with one of its integrators as a `Plant`, whose rules its methods follow."""

    may_overrun = True

    def __init__(
        self,
        platform: Platform,
        start: State | None = None,
        tolerance: float = DEFAULT_TOLERANCE,
        fixed_step_size: float = 0.0,
        integrator: Integrator = "compiled",
    ) -> None:
        self._model = model = SteppingModel(platform, tolerance, fixed_step_size, integrator)
        self.columns = model.variant.columns
        if start is not None:
            model.set_many(start._asdict())

    def set_inputs(self, inputs: FloatArray) -> None:
        """Set all inputs."""
        self._model.set_inputs(inputs)

    def set_parameters(self, values: Mapping[str, object]) -> None:
        """Set tunable parameters by name."""
        self._model.set_many(values)

    def results(self) -> FloatArray:
        """All outputs and locals at the present time."""
        return self._model.result_vector()

    def do_step(self, time: float, step: float) -> None:
        """Advance from `time` to `time + step` [s]."""
        self._model.do_step(time, step)

    def close(self) -> None:
        """There is nothing to release."""
