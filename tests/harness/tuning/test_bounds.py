"""Bounds of a search and of its conditions, from both sides; expected values by hand."""

import pytest

from gough_stewart import GoughStewartError, load_experiment
from gough_stewart.harness.errors import SearchError
from gough_stewart.harness.tuning.candidates import members_for
from gough_stewart.harness.tuning.goal import condition_of
from gough_stewart.harness.tuning.space import SearchAxis, axes_of


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


def axis(text: str, **settings: object) -> SearchAxis:
    """The axis of a text in a shipped experiment with these settings."""
    (found,) = axes_of([text], members_for(load_experiment("heave_step", dict(settings)), 1, None))
    return found


@pytest.mark.parametrize(("now", "expected"), [(0.99, False), (1.0, True), (3.0, True), (6.0, True), (6.01, False)])
def test_a_value_is_within_from_the_lower_bound_to_the_upper(now: float, expected: bool) -> None:
    found = axis("controller.bandwidth=1..6Hz", **{"controller.bandwidth": now})
    assert (found.now, found.is_within) == (now, expected)
    assert found.share(found.low) == 0.0
    assert found.share(found.high) == 1.0
    assert found.value(0.25) == pytest.approx(2.25)


_DISTURBANCES = [{"at": 0, "duration": 0.1, "force": [1, 2, 3]}, {"at": 0.2, "duration": 0.25, "force": [1, 2, 3]}]

_CHANGES = [{"at": 0.1, "parameters": {"platform_mass": 7}}, {"at": 0.2, "parameters": {"platform_mass": 12}}]


@pytest.mark.parametrize(
    ("text", "settings", "expected"),
    [
        ("disturbance.2.duration=0.01..0.3s", {"disturbance": _DISTURBANCES}, (0.01, 0.3, 0.25, "s", False, False)),
        ("plant.parameters.platform_mass=900kg..1.4t", {}, (900.0, 1400.0, 1216.9, "kg", False, False)),
        ("plant.parameters.platform_mass=0.9..1.4 t", {}, (900.0, 1400.0, 1216.9, "kg", False, False)),
        ("limits.position_error=1..300mm", {}, (1e-3, 0.3, None, "m", False, False)),
        ("actuators.force_limit=1e2..9e3", {}, (100.0, 9000.0, None, "N", False, False)),
        ("actuators.rate_limit=1..9kN/s", {"actuators.rate_limit": 20}, (1e3, 9e3, 20.0, "N/s", False, False)),
        ("loop.delay=+1..4", {}, (1.0, 4.0, 1, "", False, True)),
        ("loop.delay = 0 .. 4 , log", {}, None),
        ("controller.bandwidth= 120 rpm .. 6 Hz , log", {}, (2.0, 6.0, 2.0, "Hz", True, False)),
        # whole numbers that are quantities
        (
            "plant.platform_mass=900..1400kg",
            {"plant.parameters.platform_mass": 1200},
            (900.0, 1400.0, 1200.0, "kg", False, False),
        ),
        ("platform.leg_armature=.5..6kg", {"platform.parameters.leg_armature": 2}, (0.5, 6.0, 2.0, "kg", False, False)),
        ("change.2.parameters.platform_mass=9..14kg", {"change": _CHANGES}, (9.0, 14.0, 12.0, "kg", False, False)),
        ("controller.damping_ratio=.5..1.", {}, (0.5, 1.0, 0.8, "", False, False)),
        (
            "plant.platform_mass=-1e-1..2E+3",
            {"plant.parameters.platform_mass": 1234.5},
            (-0.1, 2000.0, 1234.5, "kg", False, False),
        ),
    ],
)
def test_a_range_has_bounds_value_unit_and_scale(
    text: str, settings: dict[str, object], expected: tuple[object, ...] | None
) -> None:
    """Expected: by hand, in SI units; the value of the experiment, of the second of two tables, too."""
    if expected is None:
        with pytest.raises(GoughStewartError, match="the lower bound is 0; expected > 0 for a logarithmic scale"):
            axis(text, **settings)
        return
    found = axis(text, **settings)
    assert (found.low, found.high, found.now, found.unit, found.is_log, found.is_whole) == pytest.approx(expected)
    assert isinstance(found.now, int) == found.is_whole
    assert found.key == text.partition("=")[0].strip()


@pytest.mark.parametrize(
    ("text", "expected", "violations"),
    [
        # metric, upper, strict, bound; violation at the bound, one below it, one above
        ("stroke.margin > 0", ("stroke.margin", False, True, 0.0), (1e-12, 1e6, 0.0)),
        ("stroke.margin<=-2 mm", ("stroke.margin", True, False, -0.002), (0.0, 0.0, 500.0)),
        ("  force.peak>=1e3 ", ("force.peak", False, False, 1000.0), (0.0, 1e-3, 0.0)),
        ("force.peak < 2 kN", ("force.peak", True, True, 2000.0), (1e-12, 0.0, 5e-4)),
        ("energy.net_total>-4 kJ", ("energy.net_total", False, True, -4000.0), (1e-12, 2.5e-4, 0.0)),
        ("disk_margin > 0.5", ("margins.disk", False, True, 0.5), (1e-12, 2.0, 0.0)),
        (
            "step_response.z.overshoot_percent < 5 %",
            ("step_response.z.overshoot_percent", True, True, 5.0),
            (1e-12, 0.0, 0.2),
        ),
        ("saturation.force_limited.any < 5 %", ("saturation.force_limited.any", True, True, 0.05), (1e-12, 0.0, 20.0)),
        ("saturation.force_limited.any < 0.05", ("saturation.force_limited.any", True, True, 0.05), (1e-12, 0.0, 20.0)),
    ],
)
def test_a_condition_has_its_metric_side_and_bound(
    text: str, expected: tuple[object, ...], violations: tuple[float, float, float]
) -> None:
    """Expected: by hand; a violation is a share of the bound, at most a million, and never 0 where it does not hold."""
    known = ["force.peak", "stroke.margin", "energy.net_total", "saturation.force_limited.any"]
    condition = condition_of(text, [*known, "step_response.z.overshoot_percent"])
    assert (condition.metric, condition.requirement.is_upper, condition.requirement.is_strict) == expected[:3]
    assert condition.bound == pytest.approx(expected[3])
    assert condition.text == text.strip()
    at = (condition.bound, condition.bound - 1, condition.bound + 1)
    assert [condition.violation(value) for value in at] == pytest.approx(list(violations))


EXPECTED = "expected PATH <= NUMBER UNIT, as in 'tracking.position.norm_peak <= 1 mm' or '… for 95 % of members'"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("force.peak > ", f"cannot be read; {EXPECTED}"),
        ("a b < 3", f"cannot be read; {EXPECTED}"),
        ("force.peak << 3", f"cannot be read; {EXPECTED}"),
        ("stroke.margin > inf", f"cannot be read; {EXPECTED}"),
        ("force.peak < 3 mm", "has the unit 'mm'; expected N, kN"),
        ("disk_margin > 5 %", "has the unit '%'; expected no unit"),
    ],
)
def test_what_is_no_condition_says_what_is_one(text: str, says: str) -> None:
    with pytest.raises(SearchError) as caught:
        condition_of(text, ["force.peak", "stroke.margin"])
    assert str(caught.value) == f"--subject-to: the requirement '{text}' {says}"


def test_a_condition_has_no_share_of_its_own() -> None:
    with pytest.raises(GoughStewartError, match=r"is on a share of members; expected a condition without one"):
        condition_of("force.peak < 3 N for 90 % of members", ["force.peak"])
