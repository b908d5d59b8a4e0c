"""Errors of the harness."""

from collections.abc import Sequence

from gough_stewart.model.errors import GoughStewartError


class UsageError(GoughStewartError):
    """A command with options that contradict each other, or with an argument that has no meaning."""


class MissedError(GoughStewartError):
    """What was asked for is done, and misses a bound or a requirement."""


class RequirementError(UsageError, ValueError):
    """A requirement that cannot be read, on a number that a study does not have, or in a unit of another kind."""


class PlantError(GoughStewartError):
    """A plant that is not available or refuses a request: no FMU, another model, an error of the FMU."""


class ControllerError(GoughStewartError, ValueError):
    """A controller of the wrong size or sample time, impossible gains, or a control law that gave no forces."""


class SharedMemoryError(ControllerError):
    """A function with memory as the controller of several members, which would share it."""


class ExportError(GoughStewartError, ValueError):
    """A controller or a loop that cannot be exported: no law that C can express, or an SSP that is not portable."""


class RecordError(GoughStewartError, ValueError):
    """A file that is not a record of a run, or a column that a record does not have."""


class LogError(GoughStewartError, ValueError):
    """A log that cannot be read, or with implausible values; names column and row."""


class IdentificationError(GoughStewartError, ValueError):
    """Parameters that a log cannot determine; `names` lists them, as far as they are known."""

    def __init__(self, message: str, names: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.names = tuple(names)


class IdentificationWarning(UserWarning):
    """A reason not to trust the values and intervals of an identification."""


class TableError(GoughStewartError, ValueError):
    """A file that is not a table of numbers; names column and row."""


class MotionError(GoughStewartError, ValueError):
    """An impossible reference motion: invalid numbers, a table with gaps, a time outside its range."""


class ReachError(GoughStewartError, ValueError):
    """A reference that the platform cannot follow: the `quantity`, its `value`, the `time` and the `leg`."""

    def __init__(self, message: str, time: float, quantity: str, value: float, leg: int | None = None) -> None:
        super().__init__(message)
        self.time = time
        self.quantity = quantity
        self.value = value
        self.leg = leg


class TuningError(GoughStewartError, ValueError):
    """An impossible search: nothing to vary, an unknown metric, conditions that no candidate meets."""


class SearchError(TuningError, UsageError):
    """A search that is written wrongly: a key, bounds, a metric or a condition."""


class NoCandidateError(TuningError, MissedError):
    """A search in which no candidate meets the conditions."""


class ExperimentError(GoughStewartError, ValueError):
    """An experiment that cannot run as written: `where` names the file, `key` the place in it."""

    def __init__(self, where: str, key: str, message: str) -> None:
        super().__init__(": ".join(part for part in (where, key, message) if part))
        self.where = where
        self.key = key


class SettingError(ExperimentError, UsageError):
    """An invalid setting of an experiment's key; `--set` on the command line."""


class EnsembleError(GoughStewartError, ValueError):
    """An ensemble that cannot start or continue: a folder of other results, no scheduler, workers that differ."""


class UnstableLoopError(GoughStewartError, ValueError):
    """The closed loop is unstable; `eigenvalue` is the least stable one, s [1/s] or z."""

    def __init__(self, message: str, eigenvalue: complex) -> None:
        super().__init__(message)
        self.eigenvalue = eigenvalue
