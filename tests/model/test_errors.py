"""Errors keep their data on the way through copies and pickles."""

import pickle
from copy import copy, deepcopy

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
]


# Its failures are errors themselves, and errors are equal to themselves alone.
MEMBERS = errors.MembersError({3: errors.StepError("leg_length[1]", 0.1, 2.0, "has collapsed")})


def test_every_error_has_an_example() -> None:
    kinds = {kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, Exception)}
    assert {type(example) for example in (*EXAMPLES, MEMBERS)} == kinds


@pytest.mark.parametrize("copied", [copy, deepcopy, lambda e: pickle.loads(pickle.dumps(e))])
def test_copies_of_errors_of_many_keep_who_failed_and_how(copied: object) -> None:
    assert callable(copied)
    other = copied(MEMBERS)
    assert (
        str(other)
        == "1 of the platforms could not be stepped; number 3: leg_length[1] = 0.1 at time 2 s: has collapsed"
    )
    assert {k: vars(error) for k, error in other.failures.items()} == {3: vars(MEMBERS.failures[3])}


@pytest.mark.parametrize("error", EXAMPLES, ids=lambda e: type(e).__name__)
@pytest.mark.parametrize("copied", [copy, deepcopy, lambda e: pickle.loads(pickle.dumps(e))])
def test_copies_of_errors_keep_text_and_data(error: errors.GoughStewartError, copied: object) -> None:
    assert callable(copied)
    other = copied(error)
    assert type(other) is type(error)
    assert str(other) == str(error)
    assert vars(other) == vars(error)


def test_an_error_of_many_names_the_first_of_them_and_their_number() -> None:
    """Expected: the lowest index, in whatever order they were found."""
    failures = {7: errors.StepError("a", 1, 0.5, "late"), 3: errors.StepError("b", 2, 7.3, "early")}
    error = errors.MembersError(failures)
    assert str(error) == "2 of the platforms could not be stepped; number 3: b = 2 at time 7.3 s: early"
    assert error.failures is failures


def test_errors_say_where_first_and_keep_it() -> None:
    """Expected: the name, then the words; each piece of data under its own name."""
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
    for kind in vars(errors).values():
        if isinstance(kind, type) and issubclass(kind, Exception):
            assert issubclass(kind, errors.GoughStewartError)
