"""Members prepared side by side: each as if it were alone, what they share once, and why others cannot run."""

from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from numpy.random import SeedSequence

import gough_stewart as gs
from gough_stewart.harness.experiment.batch import Prepared
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.overrides import experiment_with
from gough_stewart.harness.experiment.preparation import Preparation, Stages, Values, prepare
from gough_stewart.harness.loop.seeds import as_numbers
from gough_stewart.harness.plants.lanes import Stepping

SHORT: dict[str, Any] = {
    "loop.duration": 0.05,
    "loop.plant_step": "0.25 ms",
    "reference.at": 0.01,
    "reference.duration": 0.03,
    "reference.position_change": [0, 0, 2e-4],
}
# In every table something that differs from member to member.
EVERYTHING: dict[str, Any] = {
    **SHORT,
    "plant.parameters": {"leg_viscous_friction": [500, 400, 300, 300, 300, 250], "leg_armature": 20.0},
    "start.orientation": [0, 0, 0.01],
    "loop.jitter": "0.3 ms",
    "change": [
        {"at": 0.02, "factors": {"platform_mass": 1.2}},
        {"at": 0.03, "parameters": {"leg_coulomb_friction": 9}},
    ],
    "disturbance": [{"at": 0.01, "duration": 0.02, "force": [100, 20, -3]}],
    "injection": {"type": "chirp", "leg": 3, "amplitude": "50 N", "band": ["100 Hz", "400 Hz"], "period": "10 ms"},
    "ensemble": {
        "members": 40,
        "seed": 3,
        "platform_mass": {"factor": {"uniform": [0.8, 1.3]}},
        "platform_points": {"normal": "0.2 mm"},
        "platform": {"platform_com": {"normal": "1 mm"}},
        "start": {"orientation": {"normal": "0.1 deg"}},
        "reference": {"amplitude_scale": {"choice": [0.5, 0.7, 1.0]}},
        "controller": {"bandwidth": {"uniform": ["1 Hz", "3 Hz"]}, "feedforward": {"choice": ["none", "gravity"]}},
        "loop": {"delay": {"choice": [0, 1, 2]}, "jitter": {"choice": ["0 ms", "0.3 ms", "0.5 ms"]}},
        "sensors": {"noise": {"leg_length": {"choice": ["0 um", "5 um", "7 um"]}}},
        "actuators": {"lag": {"uniform": ["0 ms", "2 ms"]}, "force_limit": {"choice": ["15 kN", "18 kN"]}},
        "limits": {"position_error": {"uniform": ["0.1 m", "0.5 m"]}},
        "change": {"1": {"at": {"choice": [0.015, 0.02]}, "factors": {"platform_mass": {"uniform": [0.9, 1.2]}}}},
        "disturbance": {"1": {"force": {"normal": "20 N"}}},
        "injection": {"amplitude": {"uniform": ["10 N", "60 N"]}},
    },
}


@pytest.fixture(scope="module")
def everything() -> Members:
    return Members(gs.load_experiment("heave_tolerances", EVERYTHING))


def numbers_in(thing: Any) -> Any:
    """All numbers of a loop, or of a part of it."""
    if isinstance(thing, np.ndarray | np.generic):
        return thing.tolist()
    if isinstance(thing, SeedSequence):
        return as_numbers(thing)
    if hasattr(thing, "__dataclass_fields__"):
        return {each.name: numbers_in(getattr(thing, each.name)) for each in fields(thing)}
    if isinstance(thing, dict):
        return {name: numbers_in(value) for name, value in thing.items()}
    return [numbers_in(each) for each in thing] if isinstance(thing, list | tuple) else thing


def assert_equal(one: Prepared, other: Prepared) -> None:
    assert numbers_in(one.loop) == numbers_in(other.loop)
    assert one.platform == other.platform
    assert one.machine == other.machine
    assert numbers_in(tuple(one.start)) == numbers_in(tuple(other.start))
    assert one.jacobians.tobytes() == other.jacobians.tobytes()
    assert one.warnings == other.warnings
    assert one.motion is not None
    assert other.motion is not None
    assert numbers_in(tuple(one.motion)) == numbers_in(tuple(other.motion))
    matrices = [[getattr(each.controller.system, name).tolist() for name in "ABCD"] for each in (one, other)]  # type: ignore[union-attr]
    assert matrices[0] == matrices[1]


def test_a_member_is_its_own_experiment_whoever_else_is_there(everything: Members) -> None:
    """Expected: to the last bit `prepare` of the experiment with the member's values, in any company and order."""
    values = everything.draws(0, 12).values
    found = everything.prepared_with(values, range(12))
    assert not found.errors
    reversed_ = everything.prepared_with(values[::-1], range(11, -1, -1)).batch
    for k in range(12):
        member = found.batch.member(k)
        assert_equal(member, everything.prepared(k, k + 1).batch.member(0))
        assert_equal(member, reversed_.member(11 - k))
        own = experiment_with(everything.nominal, values[k])
        seeds = [SeedSequence(3, spawn_key=(k,))]
        assert_equal(member, Preparation(own).members([{}], seeds).batch.member(0))
        assert member.loop.start_force.tolist() == prepare(own).loop.start_force.tolist()


def test_the_loop_of_members_has_what_each_has(everything: Members) -> None:
    """Expected: along the axis of members the numbers of each, in all parts of the loop."""
    batch = everything.prepared(5, 16).batch
    loop = batch.in_parallel(Stepping()).loop
    members = [batch.member(k) for k in range(11)]
    n = loop.timing.steps + 1
    assert loop.shape == (11,)
    assert loop.reference is not None
    assert loop.injection is not None
    assert loop.reference.shape == (n, 11, 30)
    lates = loop.timing.rows_of_samples
    for k, own in enumerate(each.loop for each in members):
        assert own.reference is not None
        assert own.injection is not None
        for name in ("reference", "feedforward", "injection"):
            assert np.array_equal(getattr(loop, name)[:, k], getattr(own, name)), name
        assert np.array_equal(loop.start_force[k], own.start_force)
        for name in ("force_limit", "lag", "delay"):
            assert getattr(loop.actuators, name)[k] == getattr(own.actuators, name), name
        assert loop.actuators.rate_limit is own.actuators.rate_limit is None
        assert loop.limits.largest_position_error[k] == own.limits.largest_position_error
        assert np.array_equal(lates[:, k], own.timing.rows_of_samples)
        assert loop.sensors.noise["leg_length"][k] == own.sensors.noise["leg_length"]
        assert loop.sensors.quantisation == own.sensors.quantisation
        if own.sensors.noise["leg_length"]:
            assert as_numbers(loop.sensors.seed[k]) == as_numbers(own.sensors.seed)  # type: ignore[index]
        changes = [each for each in loop.changes if each.members is None or each.members[k]]
        assert [(each.time, sorted(each.parameters)) for each in changes] == [
            (each.time, sorted(each.parameters)) for each in sorted(own.changes, key=lambda each: each.time)
        ]
        masses = [each.parameters["platform_mass"][k] for each in changes if "platform_mass" in each.parameters]  # type: ignore[index]
        assert masses == [
            each.parameters["platform_mass"] for each in own.changes if "platform_mass" in each.parameters
        ]
    assert len(set(np.ravel(lates - lates[:, :1]).tolist())) > 1
    assert len({each.loop.changes[0].time for each in members}) == 2


def test_stages_are_evaluated_once_per_distinct_value(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: of 30 members with three delays and two amplitudes two references, six feedforwards, one controller.

    Other members with the same values take no new ones.
    """
    counts = dict.fromkeys(("platform", "reference", "planned", "warnings", "feedforward", "controller", "limits"), 0)

    def counted(name: str) -> Any:
        original = getattr(Stages, name)

        def stage(*arguments: Any) -> Any:
            counts[name] += 1
            return original(*arguments)

        return stage

    for name in counts:
        monkeypatch.setattr(Stages, name, counted(name))
    grid = {
        "loop": {"delay": {"grid": [0, 1, 2]}},
        "reference": {"amplitude_scale": {"grid": [0.5, 1.0]}},
        "platform_mass": {"factor": {"uniform": [0.8, 1.3]}},
    }
    members = Members(gs.load_experiment("heave_tolerances", {**SHORT, "ensemble": {**grid, "members": 60}}))
    counts |= dict.fromkeys(counts, 0)
    for first in (0, 30):
        batch = members.prepared(first, first + 30).batch
        assert len({each.platform_mass for each in batch.machine}) == 30
        assert counts == {
            "platform": 1, "reference": 2, "planned": 2, "warnings": 2, "feedforward": 6, "controller": 1, "limits": 1,
        }  # fmt: skip
    loop = batch.in_parallel(Stepping()).loop
    assert len(batch.controller.values) == 1
    assert loop.reference is not None
    assert loop.feedforward.shape[1:] == (30, 6)
    for k in range(30):
        own = batch.member(k).loop
        assert np.array_equal(loop.feedforward[:, k], own.feedforward)
        assert own.reference is not None
        assert np.array_equal(loop.reference[:, k], own.reference)
    assert loop.limits.largest_position_error == batch.member(3).loop.limits.largest_position_error


IMPOSSIBLE: dict[str, tuple[dict[str, Any], list[Any]]] = {
    "a table": ({"controller": {"bandwidth": {"choice": [2.0, -1.0, 3.0]}}}, [("controller", "bandwidth"), -1.0]),
    "the nominal model": (
        {"platform": {"platform_mass": {"choice": [1000.0, -5.0, 900.0]}}},
        [("platform", "parameters", "platform_mass"), -5.0],
    ),
    "the machine": (
        {"leg_lower_com": {"choice": [0.5, 40.0, 0.6]}},
        [("plant", "parameters", "leg_lower_com"), 40.0],
    ),
    "the clocks": ({"loop": {"jitter": {"choice": [0.0, 0.7, 3e-4]}}}, [("loop", "jitter"), 0.7]),
    "the reference": (
        {"reference": {"position_change": {"choice": [[0, 0, 1e-4], [0, 0, 2.0], [0, 0, 2e-4]]}}},
        [("reference", "position_change"), [0, 0, 2.0]],
    ),
    "a change": (
        {"change": {"1": {"at": {"choice": [0.01, 0.0101, 0.02]}}}},
        [("change", "1", "at"), 0.0101],
    ),
}  # fmt: skip


@pytest.mark.parametrize("stage", IMPOSSIBLE)
def test_an_impossible_member_has_the_error_of_its_own_experiment(stage: str) -> None:
    """Expected: the words of `prepare` for the members with that value, at every stage; the others run."""
    varied, (path, bad) = IMPOSSIBLE[stage]
    settings = {**SHORT, "change": [{"at": 0.02, "factors": {"platform_mass": 1.2}}]}
    mass = {"platform_mass": {"factor": {"uniform": [0.8, 1.3]}}}
    members = Members(
        gs.load_experiment("heave_tolerances", {**settings, "ensemble": {**mass, **varied, "members": 12}})
    )
    values = members.draws(0, 12).values
    found = members.prepared(0, 12)
    wrong = [k for k, each in enumerate(values) if each[path] == bad]
    assert 0 < len(wrong) < 12
    assert sorted(found.errors) == sorted(found.reasons) == wrong
    assert found.numbers.tolist() == [k for k in range(12) if k not in wrong]
    for k in wrong:
        with pytest.raises(gs.GoughStewartError) as caught:
            prepare(experiment_with(members.nominal, values[k]))
        assert str(found.errors[k]) == str(caught.value)
        assert found.reasons[k] == str(caught.value).removeprefix("experiment 'heave_tolerances': ")
    for at, k in enumerate(found.numbers.tolist()):
        assert found.batch.machine[at].platform_mass == values[k]["plant", "parameters", "platform_mass"]
    nobody = members.prepared(wrong[0], wrong[0] + 1)
    assert len(nobody.batch) == 0
    assert list(nobody.reasons.values()) == [found.reasons[wrong[0]]]


def test_a_machine_that_cannot_hold_its_start_is_alone_impossible() -> None:
    """Expected: of three machines only the one whose legs are all in one plane, which has no static forces."""
    experiment = gs.load_experiment("heave_step", {"loop.duration": 0.05, "reference.at": 0.01})
    machine = prepare(experiment).machine
    start = np.array(prepare(experiment).start.position)
    flat = np.array(machine.platform_points)
    # joints of base and platform in the plane of the platform at the start, but not in the home pose
    base = np.array(machine.base_points)
    base[:, 2] = start[2]
    flat[:, 2] = 0.0
    common = {"platform_points": flat.tolist(), "leg_length_min": None, "leg_length_max": None}
    differ: list[dict[str, Any]] = [
        {},
        {"base_points": base.tolist(), "home_position": [0, 0, 9.0]},
        {"platform_mass": 900.0},
    ]
    values: list[Values] = [
        {("plant", "parameters", name): value for name, value in {**each, **common}.items()} for each in differ
    ]
    found = Preparation(experiment).members(values)
    assert sorted(found.errors) == [1]
    assert "leg Jacobian has condition number" in found.reasons[1]
    assert [each.platform_mass for each in found.batch.machine] == [machine.platform_mass, 900.0]
    alone = Preparation(experiment).members(values[2:]).batch
    assert np.array_equal(found.batch.start_force[1], alone.start_force[0])


def test_members_start_with_forces_within_their_own_limits() -> None:
    """Expected: the forces that hold each machine without limits, cut off at each member's own."""
    settings = {
        **SHORT,
        "limits.reference": "warn",
        "ensemble": {
            "members": 9,
            "platform_com": {"normal": "0.2 m"},
            "actuators": {"force_limit": {"choice": ["1.5 kN", "1.6 kN", "9 kN"]}},
        },
    }
    members = Members(gs.load_experiment("heave_tolerances", settings))
    batch = members.prepared(0, 9).batch
    values = members.draws(0, 9).values
    free = Preparation(gs.load_experiment("heave_tolerances", {**settings, "actuators.force_limit": "none"}))
    held = free.members([{p: v for p, v in each.items() if p[0] == "plant"} for each in values]).batch.start_force
    limits = np.array([each["actuators", "force_limit"] for each in values])[:, None]
    beyond = np.abs(held) > limits
    assert beyond.any()
    assert not beyond.all()
    assert np.array_equal(batch.start_force, np.where(beyond, np.sign(held) * limits, held))
