"""Every error that this project raises on purpose, with the data of the failure on it."""

from typing import Any


class GoughStewartError(Exception):
    """Base of all errors of this project; its text names the value found, the expectation and the remedy."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles, for instance from another process, keep text and data."""
        return _rebuilt, (type(self), self.args, self.__dict__)


def _rebuilt(kind: type[GoughStewartError], args: tuple[Any, ...], data: dict[str, Any]) -> GoughStewartError:
    error = kind.__new__(kind)
    error.args = args
    error.__dict__.update(data)
    return error


class PlatformError(GoughStewartError, ValueError):
    """A platform description that cannot be built; `field` names the offending parameter."""

    def __init__(self, field: str, message: str) -> None:
        super().__init__(f"{field}: {message}")
        self.field = field


class PlatformFileError(GoughStewartError, ValueError):
    """A platform file or preset that cannot be read; `where` names it."""

    def __init__(self, where: str, message: str) -> None:
        super().__init__(f"{where}: {message}")
        self.where = where


class OutputError(GoughStewartError):
    """Results cannot be written where they were asked for."""


class OrientationError(GoughStewartError, ValueError):
    """A rotation without roll, pitch and yaw: not a rotation matrix, or a pitch of ±90°."""


class SingularPoseError(GoughStewartError, ArithmeticError):
    """A pose at which the six leg forces do not span all wrenches; `condition_number` says how nearly."""

    def __init__(self, message: str, condition_number: float) -> None:
        super().__init__(message)
        self.condition_number = condition_number


class NoPoseError(GoughStewartError, ArithmeticError):
    """No pose with the wanted leg lengths near the guess; `result` is where the iteration stopped."""

    def __init__(self, message: str, result: Any) -> None:
        super().__init__(message)
        self.result = result


class InterfaceError(GoughStewartError, ValueError):
    """A variable that does not exist, may not be set now, or a value that it cannot take; `name` is its name."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(f"{name}: {message}")
        self.name = name


class StepError(GoughStewartError, ArithmeticError):
    """A step that could not be completed: which `quantity`, its `value`, at what `time` in s."""

    def __init__(self, quantity: str, value: float, time: float, message: str) -> None:
        super().__init__(f"{quantity} = {value:.6g} at time {time:.9g} s: {message}")
        self.quantity = quantity
        self.value = value
        self.time = time


class MembersError(GoughStewartError, ArithmeticError):
    """Some of many platforms could not be stepped: `failures` has the error of each, by its index."""

    def __init__(self, failures: dict[int, StepError]) -> None:
        first = min(failures)
        super().__init__(f"{len(failures)} of the platforms could not be stepped; number {first}: {failures[first]}")
        self.failures = failures


class WorkspaceError(GoughStewartError, ValueError):
    """Coordinates, ranges or numbers of points that make no grid of poses."""
