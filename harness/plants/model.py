"""The stepping model as a plant, in the same process."""

from collections.abc import Mapping

from gough_stewart.harness.plants.plant import Plant
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import State
from gough_stewart.model.step_times import DEFAULT_TOLERANCE
from gough_stewart.model.stepping import SteppingModel
from gough_stewart.model.vectors import FloatArray


class ModelPlant(Plant):
    """The stepping model as a `Plant`."""

    may_overrun = True

    def __init__(
        self,
        platform: Platform,
        start: State | None = None,
        tolerance: float = DEFAULT_TOLERANCE,
        fixed_step_size: float = 0.0,
    ) -> None:
        self._model = SteppingModel(platform, tolerance, fixed_step_size)
        self.columns = self._model.variant.columns
        if start is not None:
            self._model.set_many(start._asdict())

    def set_inputs(self, inputs: FloatArray) -> None:
        """Rule 2."""
        self._model.set_inputs(inputs)

    def set_parameters(self, values: Mapping[str, object]) -> None:
        """Rule 3."""
        self._model.set_many(values)

    def results(self) -> FloatArray:
        """Rule 4."""
        return self._model.result_vector()

    def do_step(self, time: float, step: float) -> None:
        """Rules 5 and 6."""
        self._model.do_step(time, step)

    def close(self) -> None:
        """Rule 8; there is nothing to release."""
