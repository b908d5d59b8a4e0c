"""Bounds of a search and of its conditions, from both sides; expected values by hand."""

import math
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs

SHORT: dict[str, Any] = {"loop.duration": 0.02, "loop.sample_time": "1 ms", "reference.at": 0.002}
ONCE: dict[str, Any] = {"members": 1, "fresh": 1, "generations": 1, "population": 5}
_DISTURBANCES = [{"at": 0, "duration": 0.1, "force": [1, 2, 3]}, {"at": 0.01, "duration": 0.25, "force": [1, 2, 3]}]
_CHANGES = [{"at": 0.004, "parameters": {"platform_mass": 1000}}, {"at": 0.005, "parameters": {"platform_mass": 1200}}]


@pytest.mark.parametrize(
    ("settings", "axes"),
    [
        (
            {"disturbance": _DISTURBANCES, "actuators.rate_limit": 20e3, "change": _CHANGES,
             "platform.parameters.leg_armature": 2},
            {
                "disturbance.2.duration=0.01..0.3s": (0.01, 0.3, 0.25, "s", False, False),
                "plant.parameters.platform_mass=900kg..1.4t": (900.0, 1400.0, 1216.9, "kg", False, False),
                "limits.position_error=200..300mm": (0.2, 0.3, None, "m", False, False),
                "actuators.force_limit=4e3..9e3": (4e3, 9e3, None, "N", False, False),
                "actuators.rate_limit=1..9kN/s": (1e3, 9e3, 2e4, "N/s", False, False),
                "loop.delay=+1..4": (1.0, 4.0, 1, "", False, True),
                "controller.bandwidth= 120 rpm .. 6 Hz , log": (2.0, 6.0, 2.0, "Hz", True, False),
                "controller.damping_ratio=.5..1.": (0.5, 1.0, 0.8, "", False, False),
                "platform.leg_armature=.5..6kg": (0.5, 6.0, 2.0, "kg", False, False),
                "change.2.parameters.platform_mass=900..1400kg": (900.0, 1400.0, 1200.0, "kg", False, False),
            },
        ),
        # whole numbers that are quantities, and one unit for both ends
        ({"plant.parameters.platform_mass": 1200},
         {"plant.platform_mass=0.9..1.4 t": (900.0, 1400.0, 1200.0, "kg", False, False)}),
        ({"plant.parameters.platform_mass": 1234.5},
         {"plant.platform_mass=-1e-1..2E+3": (-0.1, 2000.0, 1234.5, "kg", False, False)}),
    ],
)  # fmt: skip
def test_a_range_has_bounds_value_unit_and_scale(settings: dict[str, Any], axes: dict[str, tuple[object, ...]]) -> None:
    """Expected: by hand, in SI units; the value of the experiment, of the second of two tables, too."""

    def stop(_search: Any) -> None:
        raise KeyboardInterrupt

    found = gs.tune("heave_step", list(axes), "force.rms", {**SHORT, **settings}, **ONCE, status=stop).search.axes
    for axis, (text, expected) in zip(found, axes.items(), strict=True):
        numbers = (axis.low, axis.high, axis.now, axis.unit, axis.is_log, axis.is_whole)
        assert numbers == pytest.approx(expected), text
        assert isinstance(axis.now, int) == axis.is_whole
        assert axis.key == text.partition("=")[0].strip()


def test_candidates_fill_a_range_evenly_on_its_scale_from_the_lower_bound_to_the_upper() -> None:
    """Expected: of 40 candidates one in each fortieth; whole numbers in equal parts; the first is the experiment."""
    keys = ["controller.bandwidth=1..6Hz", "actuators.lag=0.5..50ms,log", "loop.delay=1..4"]
    settings = {**SHORT, "controller.bandwidth": 1, "actuators.lag": 0.05, "loop.delay": 4}
    found = gs.tune("heave_step", keys, "force.rms", settings, **{**ONCE, "population": 40}).candidates
    bandwidth, lag, delay = (found[name].to_numpy() for name in found.columns[1:4])
    assert (bandwidth[0], lag[0], delay[0]) == (1.0, 0.05, 4)
    for share in ((bandwidth - 1) / 5, np.log(lag / 5e-4) / math.log(100)):
        assert len(set(np.floor(40 * share[1:] + 1e-3))) >= 38
    assert all(float(f"{x:.5g}") == x for x in (*bandwidth, *lag))
    counts = np.bincount(delay[1:], minlength=5)[1:]
    assert sorted(counts.tolist()) == [9, 10, 10, 10]


KEYS, SLOW = ["controller.bandwidth=1..4Hz"], {**SHORT, "loop.duration": 0.05}


@pytest.fixture(scope="module")
def forces() -> list[float]:
    """RMS forces of the candidates, in order of size."""
    free = gs.tune("heave_step", KEYS, "power.peak", SLOW, subject_to=["force.rms > 0 N"], **ONCE)
    return free.candidates["force.rms"].sort().to_list()


@pytest.mark.parametrize(("sign", "holds"), [("<", (1, 0, 0)), ("<=", (1, 1, 0)), (">", (0, 0, 1)), (">=", (0, 1, 1))])
def test_a_condition_holds_on_its_side_and_at_its_bound_only_if_it_says_so(
    forces: list[float], sign: str, holds: tuple[int, ...]
) -> None:
    """Expected: below, at and above a value; a violation is the bound's share that lacks; failed members come first."""
    bound = forces[2]
    conditions = [f"force.rms {sign} {bound!r} N", "stroke.margin >= 10 um"]
    found = gs.tune("heave_step", KEYS, "power.peak", SLOW, subject_to=conditions, **ONCE)
    kept = dict(found.candidates.select("force.rms", "kept").iter_rows())
    assert [kept[force] for force in forces] == [bool(holds[k]) for k in (0, 0, 1, 2, 2)]
    best = found.candidates.filter("kept")["value"].min()
    assert found.seen.value == best
    goal, made = found.search.goal, found.seen
    for force, is_met in zip((0.5 * bound, bound, 1.5 * bound), holds, strict=True):
        lack = 0.0 if is_met else max(abs(force - bound) / bound, 1e-12)
        assert goal.violation(made._replace(conditions=(force, 1.0))) == pytest.approx(lack)
        assert goal.violation(made._replace(conditions=(force, 5e-6))) == pytest.approx(lack + 0.5)
    lost = made._replace(value=math.inf, conditions=(bound * (0.9 if "<" in sign else 1.1), 1.0))
    assert goal.violation(lost) == pytest.approx(1e6)
    assert goal.violation(lost._replace(failed=2)) == pytest.approx(3e6)
    assert goal.violation(made._replace(conditions=(math.nan, 1.0))) == 1e6
