"""The errors of this project, with the data of the failure as attributes."""

import copyreg
from typing import Any


class GoughStewartError(Exception):
    """Base class of all errors of this project; the text has the value found, the expectation and the remedy."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Keep text and data in copies and pickles, for instance from another process."""
        # as without a constructor, whose arguments are other ones than the text
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]


class PlatformError(GoughStewartError, ValueError):
    """Invalid platform parameters; `field` has the name of the parameter."""

    def __init__(self, field: str, message: str) -> None:
        super().__init__(f"{field}: {message}")
        self.field = field


class PlatformFileError(GoughStewartError, ValueError):
    """A platform file or preset that cannot be read; `where` has its name."""

    def __init__(self, where: str, message: str) -> None:
        super().__init__(f"{where}: {message}")
        self.where = where


class ArgumentError(GoughStewartError, TypeError, ValueError):
    """An argument of a public function that it cannot take, or one that is missing."""


class EnvironmentVariableError(GoughStewartError, ValueError):
    """An environment variable with a value that a library cannot read."""


class NotInstalledError(GoughStewartError):
    """A package of an extra is needed, and not installed."""


class OutputError(GoughStewartError):
    """Results cannot be written to the requested place."""


class OrientationError(GoughStewartError, ValueError):
    """A rotation without roll, pitch and yaw: not a rotation matrix, or a pitch of ±90°."""


class SingularPoseError(GoughStewartError, ArithmeticError):
    """A pose at which the six leg forces do not span all wrenches; has the `condition_number` of the leg Jacobian."""

    def __init__(self, message: str, condition_number: float) -> None:
        super().__init__(message)
        self.condition_number = condition_number


class NoPoseError(GoughStewartError, ArithmeticError):
    """No pose near the guess has the requested leg lengths; `result` has the last iterate, `row` the row of many."""

    def __init__(self, message: str, result: Any, row: tuple[int, ...] = ()) -> None:
        super().__init__(message)
        self.result = result
        self.row = row


class InterfaceError(GoughStewartError, ValueError):
    """A variable that does not exist or cannot be set now, or an invalid value; `name` is its name."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(f"{name}: {message}")
        self.name = name


class StepError(GoughStewartError, ArithmeticError):
    """A step that could not be completed, with the `quantity`, its `value` and the `time` in s."""

    def __init__(self, quantity: str, value: float, time: float, message: str) -> None:
        super().__init__(f"{quantity} = {value:.6g} at time {time:.9g} s: {message}")
        self.quantity = quantity
        self.value = value
        self.time = time


class MembersError(GoughStewartError, ArithmeticError):
    """Some of many platforms could not be stepped; `failures` has their errors by index."""

    def __init__(self, failures: dict[int, StepError]) -> None:
        first = min(failures)
        super().__init__(f"{len(failures)} of the platforms could not be stepped; number {first}: {failures[first]}")
        self.failures = failures


class WorkspaceError(GoughStewartError, ValueError):
    """Coordinates, ranges or numbers of points that do not define a grid of poses."""
