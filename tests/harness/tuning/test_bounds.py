"""Bounds of a search and of its conditions, from both sides; expected values by hand."""

import pytest

from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.tuning.candidates import members_for
from gough_stewart.harness.tuning.conditions import condition_of
from gough_stewart.harness.tuning.space import Axis, axes_of


@pytest.mark.parametrize(
    ("sign", "below", "at", "above"),
    [("<", True, False, False), ("<=", True, True, False), (">", False, False, True), (">=", False, True, True)],
)
def test_a_condition_holds_on_its_side_and_at_its_bound_only_if_it_says_so(
    sign: str, below: bool, at: bool, above: bool
) -> None:
    condition = condition_of(f"stroke.margin {sign} 12 mm", ["force.peak", "stroke.margin"])
    assert (condition.metric, condition.bound) == ("stroke.margin", 0.012)
    assert [condition.holds(value) for value in (0.0119, 0.012, 0.0121)] == [below, at, above]
    assert not condition.holds(float("nan"))
    violations = [condition.violation(value) for value in (0.006, 0.012, 0.018)]
    assert violations[0] == (0.0 if below else pytest.approx(0.5))
    assert violations[2] == (0.0 if above else pytest.approx(0.5))
    assert (violations[1] == 0.0) == at
    assert condition.violation(float("inf")) == (0.0 if sign[0] == ">" else 1e6)


def axis(text: str, **settings: object) -> Axis:
    """The axis of a text in a shipped experiment with these settings."""
    (found,) = axes_of([text], members_for(load_experiment("heave_step", dict(settings)), 1, None))
    return found


def test_each_bound_has_its_own_unit_or_that_of_the_other() -> None:
    """Expected: 900 kg to 1.4 t; a unit behind the upper bound alone is that of both."""
    both = axis("plant.parameters.platform_mass=900kg..1.4t")
    assert (both.low, both.high, both.unit) == (900.0, 1400.0, "kg")
    shared = axis("plant.parameters.platform_mass=0.9..1.4 t")
    assert (shared.low, shared.high) == (900.0, 1400.0)


@pytest.mark.parametrize(("now", "expected"), [(0.99, False), (1.0, True), (3.0, True), (6.0, True), (6.01, False)])
def test_a_value_is_within_from_the_lower_bound_to_the_upper(now: float, expected: bool) -> None:
    found = axis("controller.bandwidth=1..6Hz", **{"controller.bandwidth": now})
    assert (found.now, found.is_within) == (now, expected)
    assert found.share(found.low) == 0.0
    assert found.share(found.high) == 1.0
    assert found.value(0.25) == pytest.approx(2.25)
