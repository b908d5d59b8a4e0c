"""Errors of the harness."""

from collections.abc import Sequence

from gough_stewart.model.errors import GoughStewartError


class UsageError(GoughStewartError):
    """A command with options that contradict each other, or words that say nothing."""


class PlantError(GoughStewartError):
    """A plant that cannot be had, or that refuses what it was asked: no FMU, another model, the FMU's own complaint."""


class ControllerError(GoughStewartError, ValueError):
    """A controller of the wrong size or rate, gains that no controller can have, or a law that gave no forces."""


class ExportError(GoughStewartError, ValueError):
    """A controller or a loop that cannot leave: no law that can be written as C, or a system that no importer takes."""


class RecordError(GoughStewartError, ValueError):
    """A file that is no record of a run, or a column that a record has not."""


class LogError(GoughStewartError, ValueError):
    """A log of a machine that cannot be read, or that no such machine can have recorded; names column and row."""


class IdentificationError(GoughStewartError, ValueError):
    """Parameters that a log cannot tell; `names` are those, as far as they are known."""

    def __init__(self, message: str, names: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.names = tuple(names)


class TableError(GoughStewartError, ValueError):
    """A file that is no table of numbers; names column and row."""


class MotionError(GoughStewartError, ValueError):
    """A reference motion that cannot be: impossible numbers, a table with holes, a time outside of it."""


class ReachError(GoughStewartError, ValueError):
    """A reference that the platform cannot follow: which `quantity` has which `value`, when, and in which `leg`."""

    def __init__(self, message: str, time: float, quantity: str, value: float, leg: int | None = None) -> None:
        super().__init__(message)
        self.time = time
        self.quantity = quantity
        self.value = value
        self.leg = leg


class TuningError(GoughStewartError, ValueError):
    """A search that cannot be: nothing to vary, a metric that is none, conditions that no candidate keeps."""


class ExperimentError(GoughStewartError, ValueError):
    """An experiment that cannot be run as it is written: `where` names the file, `key` the place in it."""

    def __init__(self, where: str, key: str, message: str) -> None:
        super().__init__(": ".join(part for part in (where, key, message) if part))
        self.where = where
        self.key = key


class SettingError(ExperimentError, UsageError):
    """A setting of an experiment's key that cannot be read; the command line's `--set`."""


class EnsembleError(GoughStewartError, ValueError):
    """An ensemble that cannot run, or not go on: other results in its place, no scheduler, workers that differ."""


class UnstableLoopError(GoughStewartError, ValueError):
    """A loop that is unstable when closed; `eigenvalue` is the worst, s [1/s] or z."""

    def __init__(self, message: str, eigenvalue: complex) -> None:
        super().__init__(message)
        self.eigenvalue = eigenvalue
