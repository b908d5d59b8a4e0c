"""Errors of the harness: what each is caught as, and what it knows."""

from gough_stewart import GoughStewartError
from gough_stewart.harness import errors

# Those with a base beside the common one; wrong usage and missed bounds have exit codes of their own.
BASES: dict[str, set[str]] = {
    "RequirementError": {"UsageError"},
    "SharedMemoryError": {"ControllerError"},
    "SearchError": {"TuningError", "UsageError"},
    "NoCandidateError": {"TuningError", "MissedError"},
    "SettingError": {"ExperimentError", "UsageError"},
}
NO_VALUE_ERRORS = {"UsageError", "MissedError", "PlantError"}


def test_each_error_is_caught_as_what_it_is() -> None:
    """Expected: the tables above."""
    kinds = {
        name: kind
        for name, kind in vars(errors).items()
        if isinstance(kind, type) and kind.__module__ == errors.__name__ and not issubclass(kind, Warning)
    }
    for name, kind in kinds.items():
        assert {other for other, base in kinds.items() if issubclass(kind, base)} == {name, *BASES.get(name, ())}
        assert issubclass(kind, GoughStewartError)
        assert issubclass(kind, ValueError) != (name in NO_VALUE_ERRORS)


def test_errors_know_what_they_are_about() -> None:
    for parts, text in (
        (("a.toml", "loop.delay", "is -1"), "a.toml: loop.delay: is -1"),
        (("a.toml", "", "is empty"), "a.toml: is empty"),
        (("", "loop.delay", "is -1"), "loop.delay: is -1"),
    ):
        error = errors.SettingError(*parts)
        assert (str(error), error.where, error.key) == (text, *parts[:2])
    reach = errors.ReachError("too far", 7.3, "leg_velocity", 1.9, 4)
    assert (str(reach), reach.time, reach.quantity, reach.value, reach.leg) == ("too far", 7.3, "leg_velocity", 1.9, 4)
    assert errors.UnstableLoopError("unstable", 1.2 - 0.3j).eigenvalue == 1.2 - 0.3j
    assert errors.IdentificationError("two", ["platform_mass", "gravity"]).names == ("platform_mass", "gravity")
