"""Errors of the harness: what each is caught as, and what it knows."""

import pytest

from gough_stewart.harness import errors
from gough_stewart.model.errors import GoughStewartError

# By name: other errors of the harness that it is one of, and whether it is a ValueError.
KINDS: dict[str, tuple[set[str], bool]] = {
    "UsageError": (set(), False),
    "MissedError": (set(), False),
    "RequirementError": ({"UsageError"}, True),
    "PlantError": (set(), False),
    "ControllerError": (set(), True),
    "SharedMemoryError": ({"ControllerError"}, True),
    "ExportError": (set(), True),
    "RecordError": (set(), True),
    "LogError": (set(), True),
    "IdentificationError": (set(), True),
    "TableError": (set(), True),
    "MotionError": (set(), True),
    "ReachError": (set(), True),
    "TuningError": (set(), True),
    "SearchError": ({"TuningError", "UsageError"}, True),
    "NoCandidateError": ({"TuningError", "MissedError"}, True),
    "ExperimentError": (set(), True),
    "SettingError": ({"ExperimentError", "UsageError"}, True),
    "EnsembleError": (set(), True),
    "UnstableLoopError": (set(), True),
}


def test_each_error_is_caught_as_what_it_is() -> None:
    """Expected: the table above, which has all of them; wrong usage and missed bounds have exit codes of their own."""
    found = {
        name: kind
        for name, kind in vars(errors).items()
        if isinstance(kind, type) and kind.__module__ == errors.__name__ and not issubclass(kind, Warning)
    }
    assert list(found) == list(KINDS)
    for name, kind in found.items():
        others = {other for other, base in found.items() if issubclass(kind, base) and other != name}
        assert (others, issubclass(kind, ValueError)) == KINDS[name], name
        assert issubclass(kind, GoughStewartError)


@pytest.mark.parametrize("kind", [errors.ExperimentError, errors.SettingError])
def test_an_experiment_says_where_and_which_key(kind: type[errors.ExperimentError]) -> None:
    for parts, text in (
        (("a.toml", "loop.delay", "is -1"), "a.toml: loop.delay: is -1"),
        (("a.toml", "", "is empty"), "a.toml: is empty"),
        (("", "loop.delay", "is -1"), "loop.delay: is -1"),
        (("", "", "is -1"), "is -1"),
    ):
        error = kind(*parts)
        assert (str(error), error.where, error.key) == (text, *parts[:2])


def test_errors_know_what_they_are_about() -> None:
    reach = errors.ReachError("too far", 7.3, "leg_velocity", 1.9, 4)
    assert (str(reach), reach.time, reach.quantity, reach.value, reach.leg) == ("too far", 7.3, "leg_velocity", 1.9, 4)
    assert errors.ReachError("singular", 7.3, "condition_number", 1e9).leg is None
    unstable = errors.UnstableLoopError("unstable", 1.2 - 0.3j)
    assert (str(unstable), unstable.eigenvalue) == ("unstable", 1.2 - 0.3j)
    undetermined = errors.IdentificationError("two", ["platform_mass", "gravity"])
    assert (str(undetermined), undetermined.names) == ("two", ("platform_mass", "gravity"))
    assert errors.IdentificationError("none").names == ()
