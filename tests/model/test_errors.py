"""Errors keep their data on the way through copies and pickles."""

import pickle
from copy import copy, deepcopy
from typing import Any

import pytest

from gough_stewart.model import errors

EXAMPLES = [
    errors.GoughStewartError("text"),
    errors.PlatformError("gravity", "is odd"),
    errors.PlatformFileError("mine.toml", "is odd"),
    errors.ArgumentError("is None"),
    errors.EnvironmentVariableError("is 'abc'"),
    errors.NotInstalledError("casadi is not installed"),
    errors.OutputError("is a file"),
    errors.OrientationError("odd"),
    errors.SingularPoseError("odd", 1e13),
    errors.NoPoseError("none", {"iterations": 3}),
    errors.InterfaceError("leg_length", "is odd"),
    errors.WorkspaceError("is both swept and fixed"),
    errors.StepError("leg_length[1]", 0.1, 2.0, "has collapsed"),
    errors.MembersError({3: errors.StepError("leg_length[1]", 0.1, 2.0, "has collapsed")}),
]


@pytest.mark.parametrize("error", EXAMPLES, ids=lambda e: type(e).__name__)
@pytest.mark.parametrize("copied", [copy, deepcopy, lambda e: pickle.loads(pickle.dumps(e))])
def test_copies_of_errors_keep_text_and_data(error: errors.GoughStewartError, copied: Any) -> None:
    other = copied(error)
    assert type(other) is type(error)
    assert str(other) == str(error)
    assert repr(vars(other)) == repr(vars(error))


def test_errors_say_where_first_and_keep_it() -> None:
    """Expected: the name, then the words; each piece of data under its own name; of many the lowest index."""
    kinds = {kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, Exception)}
    assert {type(example) for example in EXAMPLES} == kinds
    assert all(issubclass(kind, errors.GoughStewartError) for kind in kinds)
    platform, file = errors.PlatformError("gravity", "is odd"), errors.PlatformFileError("a.toml", "is empty")
    assert (str(platform), platform.field) == ("gravity: is odd", "gravity")
    assert (str(file), file.where) == ("a.toml: is empty", "a.toml")
    variable, step = errors.InterfaceError("leg_length", "is odd"), errors.StepError("pitch", 1 / 3, 7.3, "too far")
    assert (str(variable), variable.name) == ("leg_length: is odd", "leg_length")
    assert (step.quantity, step.value, step.time) == ("pitch", 1 / 3, 7.3)
    assert str(step) == "pitch = 0.333333 at time 7.3 s: too far"
    assert str(errors.StepError("pitch", 1.0, 1234.567891234, "x")) == "pitch = 1 at time 1234.56789 s: x"
    assert errors.SingularPoseError("odd", 2e13).condition_number == 2e13
    assert errors.NoPoseError("none", "last").result == "last"
    many = errors.MembersError({7: errors.StepError("a", 1, 0.5, "late"), 3: errors.StepError("b", 2, 7.3, "early")})
    assert str(many) == "2 of the platforms could not be stepped; number 3: b = 2 at time 7.3 s: early"
    assert list(many.failures) == [7, 3]
