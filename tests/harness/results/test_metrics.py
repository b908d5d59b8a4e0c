"""Metrics of records against closed forms and against loops over the rows, and records that lack something."""

import json
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import control
import numpy as np
import polars
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gough_stewart as gs
from gough_stewart.fmu_build.cache import BuildError
from tests.support.metric_definitions import defined_metrics, same_to_rounding
from tests.support.motions import write_log
from tests.support.orientations import rotation_vectors
from tests.support.records import Floats, columns

SIZES = {"position": 3, "orientation": 3, "leg_length": 6, "leg_velocity": 6, "actuator_force": 6}
STEP = 1e-3
LIMITS: dict[str, Any] = {
    "leg_length_min": 0.9,
    "leg_length_max": 2.4,
    "leg_velocity_max": 1.9,
    "actuator_force_max": 2.3,
    "actuator_power_max": 4.0,
}


def record_of(n: int, values: dict[str, Any] | None = None, status: str = "completed", **platform: Any) -> gs.Record:
    """A record of n rows: what is given, broadcast to (n, size), and zeros for the rest of the plant's columns."""
    table = {"time": STEP * np.arange(n)}
    for name, value in {**dict.fromkeys(SIZES, 0.0), **(values or {})}.items():
        table |= columns(name, np.broadcast_to(np.asarray(value), (n, SIZES.get(name.split(".")[-1], 6))))
    cause = None if status == "completed" else "too far from the reference"
    outcome = {"status": status, "time": STEP * (n - 1), "cause": cause}
    return gs.Record(polars.DataFrame(table), {"title": "test", "outcome": outcome, "platform": dict(platform)})


def following(wanted: Floats, actual: Floats) -> gs.Record:
    """A record whose pose (n, 6) is to follow another; of (n,), along z."""
    whole = [np.outer(pose, np.eye(6)[2]) if pose.ndim == 1 else pose for pose in (wanted, actual)]
    values: dict[str, Any] = {}
    for name, part in (("position", slice(3)), ("orientation", slice(3, 6))):
        meant, there = (pose[:, part] for pose in whole)
        error = meant - there if name == "position" else rotation_vectors(there, meant)
        values |= {name: there, f"reference.{name}": meant, f"error.{name}": error}
    return record_of(len(wanted), values)


def metrics_of(record: gs.Record, has_compiler: bool = True) -> dict[str, Any]:
    """The metrics, of which the outcome is tested elsewhere."""
    with pytest.MonkeyPatch.context() as patch:
        if not has_compiler:
            failing = Mock(side_effect=BuildError("no compiler"))
            patch.setattr("gough_stewart.harness.results.metrics.metric_kernels", failing)
        return {name: value for name, value in gs.metrics(record).items() if name != "outcome"}


@given(st.data())
@settings(max_examples=20, deadline=None)
def test_every_number_is_its_definition_leg_by_leg(data: st.DataObject) -> None:
    """Expected: plain loops over the rows before the first that is not finite; of noise that steps on three axes."""
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    n, at = data.draw(st.sampled_from([1, 2, 3, 41])), data.draw(st.integers(1, 12))
    lacking = data.draw(st.sampled_from([(), ("leg_length_min",), ("leg_length_max", "leg_velocity_max"), LIMITS]))
    limits = {name: value for name, value in LIMITS.items() if name not in lacking}
    wanted, actual = rng.normal(size=(2, n, 6))
    wanted[:] = 0.1
    wanted[at:] += [0.5, -0.3, 0, 0, 0.2, 0]
    actual[9:, 0] = 0.1 + 0.5 * rng.uniform(0.97, 1.02, max(n - 9, 0))
    (length, wanted_length), amounts = rng.uniform(0.8, 2.5, (2, n, 6)), np.arange(1, 7)
    values = {
        **{"leg_length": length, "leg_velocity": rng.normal(size=(n, 6))},
        **{"actuator_force": rng.normal(size=(n, 6)) * amounts / 3, "error.leg_length": wanted_length - length},
        **{f"flag.{name}_limited": rng.random((n, 6)) < amounts / 30 for name in ("force", "rate")},
        "reference.leg_length": wanted_length,
        "flag.stroke_exceeded": (length < 0.9) | (length > 2.4),
    }
    record = following(wanted, actual)
    made = {k: v for name, value in values.items() for k, v in columns(name, value).items()}
    table = record.table.with_columns(**made)
    table = table.with_columns(polars.col("time") + data.draw(st.sampled_from([0.0, 7.3])))
    whole = gs.Record(table, {**record.metadata, "platform": limits})
    has_compiler = data.draw(st.booleans())
    same_to_rounding(metrics_of(whole, has_compiler), defined_metrics(table, limits))
    if n == 1:
        return
    row, name = data.draw(st.integers(1, n - 1)), data.draw(st.sampled_from([*SIZES, "error.leg_length"]))
    last, lost = whole.columns_of(name)[-1], data.draw(st.sampled_from([np.nan, np.inf, -np.inf]))
    broken = table.with_columns(polars.Series(last, np.where(np.arange(n) >= row, lost, table[last])))
    expected = defined_metrics(table.head(row), limits, is_whole=False)
    same_to_rounding(metrics_of(gs.Record(broken, whole.metadata), has_compiler), expected)


@pytest.mark.parametrize("seed", range(3))
def test_step_numbers_are_python_controls(seed: int) -> None:
    """Expected: `control.step_info` from the jump on; responses that ring, with noise, cross a level more than once."""
    rng = np.random.default_rng(seed)
    t = STEP * np.arange(1000)
    rings = 1 - np.exp(-(6 + 3 * seed) * t) * np.cos(20 * t) + 0.003 * rng.normal(size=1000)
    (found,) = gs.metrics(following(np.r_[0.0, np.ones(999)], np.r_[0.0, rings[1:]]))["step_response"]
    # the jump is in the second row
    info = control.step_info(rings[1:], T=t[:-1], yfinal=1.0)
    names = {"overshoot_percent": "Overshoot", "rise_time": "RiseTime", "settling_time": "SettlingTime"}
    for name, theirs in names.items():
        assert found[name] == pytest.approx(info[theirs])


JUMP = np.r_[np.zeros(10), np.ones(90)]
# Reference and response, and what is said of the step; None where it is none.
STEPS: dict[str, tuple[Floats, Floats, dict[str, Any] | None]] = {
    "perfect": (JUMP, JUMP, {"at": 0.01, "overshoot_percent": 0, "rise_time": 0, "settling_time": 0, "final_error": 0}),
    "rings on": (JUMP, JUMP * (1 + 0.1 * np.cos(np.arange(2, 102))), {"rise_time": 0, "settling_time": None}),
    "half": (JUMP, JUMP / 2, {"overshoot_percent": 0, "rise_time": None, "settling_time": None, "final_error": 0.5}),
    "over rows": (np.r_[np.zeros(10), 0.3, 0.7, np.ones(88)], JUMP, {"at": 0.009}),
    "there, back and there": (np.r_[np.zeros(10), np.ones(10), np.zeros(10), np.ones(70)], JUMP, {"at": 0.03}),
    "constant": (0 * JUMP, JUMP, None),
    "ramp": (np.linspace(0, 1, 100), JUMP, None),
    "sine": (np.sin(np.arange(100)), JUMP, None),
    "rest too short": (np.r_[np.zeros(91), np.ones(9)], JUMP, None),
    "rest just long enough": (np.r_[np.zeros(90), np.ones(10)], JUMP, {"at": 0.09}),
    "single row": (np.ones(1), np.ones(1), None),
    "rounding": (1e-9 * JUMP, JUMP, None),
    "rounding of 30 m": (30 + 2e-8 * JUMP, JUMP, None),
    "more than rounding": (1.1e-9 * JUMP, JUMP, {"to": 1.1e-9}),
}  # fmt: skip


@pytest.mark.parametrize("case", STEPS)
def test_what_is_a_step_and_what_is_said_of_its_response(case: str) -> None:
    """Expected: the words of `gs.metrics`: from a first value to one that stays for a tenth of the rows."""
    wanted, actual, said = STEPS[case]
    found = gs.metrics(following(wanted, actual))["step_response"]
    assert len(found) == (said is not None)
    for key, value in (said or {}).items():
        assert found[0][key] == (None if value is None else pytest.approx(value)), key


def test_parts_without_numbers_are_none_and_not_empty() -> None:
    """Expected: None for what the columns or the platform do not give; an empty list of steps for rest."""
    found = gs.metrics(record_of(20))
    names = ("tracking", "saturation", "limits", "step_response")
    assert {name: found[name] for name in names} == dict.fromkeys(names)
    assert (found["stroke"]["margin"], found["stroke"]["exceeded"], found["energy"]["net_total"]) == (None, None, 0)
    assert "Tracking" not in str(found)
    only = gs.metrics(record_of(20, {"flag.force_limited": True, "leg_length": 1.2}, leg_length_min=1.0))
    assert only["saturation"] == {"force_limited": {"legs": [1] * 6, "any": 1}}
    assert only["stroke"]["margin"] == pytest.approx(0.2)
    assert "force limited" in str(only)
    assert "force limited" not in str(gs.metrics(record_of(20, {"flag.force_limited": False})))
    for column, parts in (("actuator_force", ("force", "power", "energy")), ("leg_length", ("power", "stroke"))):
        lacking = gs.metrics(gs.Record((whole := record_of(20)).table.drop(whole.columns_of(column)), whole.metadata))
        assert [lacking[part] for part in parts] == [None] * len(parts)
        assert lacking["rows"] == 20
        assert "peak force" not in str(lacking)
    rest = following(np.zeros(5), np.zeros(5))
    assert gs.metrics(rest)["step_response"] == []
    for lacks in ("reference.position", "reference.orientation"):
        partly = gs.Record(rest.table.drop(rest.columns_of(lacks)), rest.metadata)
        assert gs.metrics(partly)["step_response"] is None
        lost = rest.table.with_columns(polars.Series(f"{lacks}[2]", [0.0, 0.0, 0.0, np.nan, 0.0]))
        assert gs.metrics(gs.Record(lost, rest.metadata))["rows"] == 3


def test_a_member_that_ends_on_a_landing_has_no_step_yet(tmp_path: Path) -> None:
    """Expected: x goes up by 20 mm and by 20 more, z up by 20 and back by 10; who ends between has no response."""
    time = np.arange(401) * STEP
    first, second = ((s := np.clip((time - at) / 0.04, 0, 1)) ** 3 * (10 - 15 * s + 6 * s * s) for at in (0.04, 0.3))
    pose = 0.02 * (np.outer(first, [1, 0, 1, 0, 0, 0]) + np.outer(second, [1, 0, -0.5, 0, 0, 0]))
    changes: dict[str, Any] = {
        "reference": {"type": "file", "file": str(write_log(tmp_path / "stairs.csv", time, pose)), "at_home": "start"},
        **{"loop.duration": 0.4, "limits.reference": "warn", "limits.position_error": 0.1},
        "disturbance": [{"at": 0.15, "duration": 0.2, "force": [0, 0, 0]}],
        "ensemble": {"members": 2, "disturbance.1.force": {"grid": [[0, 0, 0], [5e5, 0, 0]]}},
    }
    members = gs.ensemble("heave_step", changes, workers=1).members
    assert (members["outcome"].to_list(), 0.15 < members["ended"][1] < 0.29) == (["completed", "diverged"], True)
    found = [[value is None for value in members[f"step_response.{axis}.to"]] for axis in "xz"]
    assert found == [[False, True]] * 2


def test_what_is_not_finite_is_undefined() -> None:
    nothing = gs.metrics(record_of(1, {"leg_length": np.nan}, status="diverged"))
    assert (nothing["rows"], nothing["force"], nothing["step_response"]) == (0, None, None)
    assert "diverged at 0 s: too far from the reference" in str(nothing)
    found = gs.metrics(record_of(10, {"actuator_force": 1e300, "leg_velocity": 1e300, "error.position": 1e200}))
    assert (found["power"]["peak"], found["tracking"]["position"]["rms"]) == ([None] * 6, [None] * 3)
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert "–" in str(found)


def test_the_report_has_one_number_by_path() -> None:
    """Expected: of a list by leg the largest, of lengths and times the least; None where one is undefined."""
    k = np.arange(1, 7)
    velocity = np.zeros((4, 6))
    velocity[2:, 1], velocity[3, 4] = 0.6, 0.7
    record = record_of(4, {"actuator_force": k * 1.0, "leg_length": k * 1.0, "leg_velocity": velocity})
    platform = {**gs.load_preset("liu2000").as_dict(), "leg_velocity_max": 0.5}
    stated = gs.Record(record.table, {**record.metadata, "platform": platform})
    numbers = {number.path: number.value for number in stated.report(charts=False).numbers}
    assert (numbers["stroke.shortest"], numbers["stroke.longest"], numbers["force.peak"]) == (1, 6, 6)
    assert numbers["limits.leg_velocity_max.first_exceeded"] == pytest.approx(2 * STEP)
    assert (numbers["rows"], numbers["stroke.margin"]) == (4, None)
    assert numbers["power.mean"] == 0
    single = gs.Record(record.table.head(1), stated.metadata).report(charts=False)
    assert single.number("power.mean").value is None
