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


def test_a_step_error_says_quantity_value_and_time() -> None:
    assert str(EXAMPLES[-1]) == "leg_length[1] = 0.1 at time 2 s: has collapsed"
