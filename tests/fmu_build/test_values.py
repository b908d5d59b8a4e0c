"""Values of a unit, and what it refuses, by FMPy. Every message names quantity, value and expectation."""

import re
from ctypes import POINTER, byref, c_double, c_uint32
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.fmu_plants import (
    DISCARD,
    ERROR,
    OK,
    Fmu,
    NotInstantiatedError,
    Plant,
    plant,
    refused,
)
from tests.support.lagrangian import FloatArray
from tests.support.steppers import CLOCKS
from tests.support.uneven import MOVING, STATE, UNEVEN

HOME = {"position": UNEVEN.home_position, "orientation": UNEVEN.home_orientation}
FIXED = ("base_points", "leg_lower_mass", "position", "fixed_step_size")
COMPUTED = ("leg_length", "acceleration", "kinetic_energy", "joint_force", "der(velocity)")


def names_of(fmu: Fmu, *causalities: str) -> list[str]:
    return [name for name, whole in fmu.variables.items() if whole.declared[0].causality in causalities]


BAD_VALUES = [
    ("actuator_force", [1, 2, np.nan, 4, 5, 6], "actuator_force[3] = nan N", "finite"),
    ("position", [0, np.inf, 3], "position[2] = inf m", "finite"),
    ("orientation", [0, 1.5699, 0], "orientation[2] = 1.5699 rad", "pitch"),
    ("orientation", [0.1, -1.5699, 0.2], "orientation[2] = -1.5699 rad", "pitch"),
    ("platform_mass", -1.0, "platform_mass = -1 kg", "> 0"),
    ("platform_mass", 0.0, "platform_mass = 0 kg", "> 0"),
    ("leg_lower_mass", -0.1, "leg_lower_mass", ">= 0"),
    ("leg_upper_inertia", -1e-9, "leg_upper_inertia", ">= 0"),
    ("leg_viscous_friction", -2.0, "leg_viscous_friction = -2 N.s/m", ">= 0"),
    ("leg_friction_velocity", 0.0, "leg_friction_velocity", "> 0"),
    ("base_points", -1e31 * np.eye(6, 3, -3), "base_points[4,1] = -1e+31 m", "below 1e+30"),
    ("fixed_step_size", -1e-3, "fixed_step_size = -0.001 s", ">= 0"),
]


def test_a_value_that_no_platform_has_is_discarded_by_name(fmu: Fmu) -> None:
    """Expected: what is in the table, and the same refusal by the stepping model, which has no fixed_step_size."""
    with plant(fmu) as p:
        for name, value, shown, expected in BAD_VALUES:
            before = p.get(name)
            assert refused(p.set, name, value) == DISCARD
            assert np.array_equal(p.get(name), before)
            message = p.messages.pop()
            assert p.messages == []
            assert message.instance == ("plant" if p.is_fmi2 else None)
            assert (message.status, message.category) == (DISCARD, "logStatusDiscard")
            assert shown in message.text
            assert expected in message.text
            if name != "fixed_step_size":
                with pytest.raises(gs.GoughStewartError):
                    gs.SteppingModel(UNEVEN).set(name, value)


def test_what_is_fixed_or_computed_cannot_be_set(fmu: Fmu) -> None:
    with plant(fmu) as p:
        for name in (*COMPUTED, *names_of(fmu, "independent")):
            p.refuses("computed", ERROR, p.set, name, p.get(name))
        p.start()
        for name in FIXED:
            p.refuses(name, ERROR, p.set, name, p.get(name))
            assert "step mode" in p.messages[-1].text


def inertia(moments: list[float], seed: int, size: float) -> FloatArray:
    """With these principal moments about axes of no special direction."""
    axes, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    J = size * axes @ np.diag(moments) @ axes.T
    return np.asarray((J + J.T) / 2)


INERTIAS: list[tuple[Any, str | None]] = [
    ([[5, 1, 0], [0, 5, 0], [0, 0, 10]], "[1,2] = 1 but [2,1] = 0 kg.m2"),
    ([[5, 0, 0.5], [0, 5, 0], [0.25, 0, 10]], "[1,3] = 0.5 but [3,1] = 0.25 kg.m2"),
    ([[5, 0, 0], [0, 5, 0], [0, -0.5, 10]], "[2,3] = 0 but [3,2] = -0.5 kg.m2"),
    ([[5, 1, 0], [1 + 1e-9, 5, 0], [0, 0, 10]], None),
    ([[5, 1, 0], [1 + 2e-8, 5, 0], [0, 0, 10]], "not symmetric"),
    (np.zeros((3, 3)), "not positive definite"),
    (np.diag([1.0, 1.0, 2.0]), None),  # a flat disk is a body
    *(
        (inertia(moments, seed, size), expected)
        for seed, size in ((0, 1e-6), (1, 1.0), (2, 1e5))
        for moments, expected in (
            ([1.0, 2.0, 2.99], None),
            ([1.0, 2.0, 3.01], "triangle"),
            ([0.001, 1.0, 1.0005], None),
            ([-0.001, 1.0, 1.0], "not positive definite"),
            ([-1.0, -2.0, 3.0], "not positive definite"),
        )
    ),
]


def test_an_inertia_is_symmetric_and_that_of_a_body(fmu: Fmu) -> None:
    """Expected: principal moments decide, whatever their axes: all above 0, none above the sum of the others."""
    for value, expected in INERTIAS:
        with plant(fmu) as p:
            assert refused(p.start, {"platform_inertia": value}) == (ERROR if expected else OK), value
            assert (expected or "") in p.take_messages()
    with plant(fmu) as p:  # a tunable one is looked at before the next step
        p.start()
        p.set("platform_inertia", np.diag([1.0, 1.0, 3.0]))
        assert refused(p.do_step, 0.0, 0.01) == DISCARD
        assert "triangle" in p.take_messages()
        p.set("platform_inertia", np.diag([1.0, 1.0, 1.5]))
        p.do_step(0.0, 0.01)


@pytest.mark.parametrize("co_simulation", [True, False])
def test_results_that_are_not_finite_are_discarded_only_where_fmi_2_knows_that(fmu: Fmu, co_simulation: bool) -> None:
    """Expected: FMI 2.0, 2.1.3, lists fmi2GetReal for Model Exchange, and directional derivatives for nobody."""
    tiny: dict[str, Any] = {
        "platform_mass": 1e-300,
        "platform_inertia": 1e-300 * np.eye(3),
        "platform_com": 0.0,
        "leg_armature": 0.0,
    }
    tiny |= {f"leg_{part}_{kind}": 1e-300 for part in ("lower", "upper") for kind in ("mass", "inertia")}
    with plant(fmu, co_simulation) as p:
        p.start(tiny)
        p.set("actuator_force", [1e29, -1e29, 1e29, 1e29, 1e29, 1e29])
        assert refused(p.get, "acceleration") == (ERROR if p.is_fmi2 and co_simulation else DISCARD)
        assert refused(p.directional, "acceleration", "position", [1, 2, 3]) == (ERROR if p.is_fmi2 else DISCARD)
        assert "not finite" in p.messages[-1].text
        p.set("actuator_force", 0.0)
        assert refused(p.get, "position") == OK


NEAR = np.pi / 2 - 1e-3 - 1e-6
FAILURES: list[tuple[dict[str, Any], dict[str, Any], float, str]] = [
    # start, inputs after a millisecond, step, message
    ({}, {"external_torque": [0, 0, 2000.0]}, 1.5, "singular"),
    ({"fixed_step_size": 1e-3}, {"external_torque": [0, 0, 2000.0]}, 1.5, "singular"),
    ({}, {"external_torque": [0, 2000.0, 0]}, 0.5, "at time"),
    ({}, {"actuator_force": -3000.0}, 1.0, "at time"),
    ({}, {"actuator_force": 1e29}, 0.1, "at time"),
    ({"fixed_step_size": 1e-3}, {"actuator_force": 1e29}, 0.1, "at time"),
    *(
        (
            {**HOME, "orientation": [0, sign * (NEAR - 2e-3), 0], "angular_velocity": [0, sign, 0], **fixed},
            {}, 0.01, "90 degrees",
        )
        for sign in (1.0, -1.0)
        for fixed in ({}, {"fixed_step_size": 1e-3})
    ),
]  # fmt: skip


@pytest.mark.parametrize(("start", "inputs", "step", "expected"), FAILURES)
def test_a_step_that_cannot_be_completed_is_discarded_with_the_state_as_before(
    fmu: Fmu, start: dict[str, Any], inputs: dict[str, Any], step: float, expected: str
) -> None:
    """Expected: then a shorter step goes on as if nothing had been."""
    with plant(fmu) as p, plant(fmu) as q:
        for each in (p, q):
            each.start({**MOVING, **start})
            each.do_step(0.0, 0.001)
            for name, value in inputs.items():
                each.set(name, value)
        before, shown = p.serialized(), p.everything()
        assert refused(p.do_step, 0.001, step) == DISCARD
        message = p.messages[-1]
        assert expected in message.text
        assert message.category == "logStatusDiscard"
        if "90" in expected:
            pitch = float(message.text.partition("orientation[2] = ")[2].partition(" ")[0])
            assert NEAR < abs(pitch) < NEAR + 0.01
        assert p.serialized() == before
        assert all(np.array_equal(value, shown[name]) for name, value in p.everything().items())
        assert p.time == 0.001
        if p.is_fmi2:
            assert p.fmu.getStatus(0) == DISCARD  # fmi2DoStepStatus
            assert p.fmu.getBooleanStatus(3)  # fmi2Terminated
            p.restore(before)
            assert (p.fmu.getStatus(0), bool(p.fmu.getBooleanStatus(3))) == (OK, False)
        for each in (p, q):
            each.set("actuator_force", 50.0)
            each.do_step(0.001, 1e-5)
        assert np.array_equal(p.pose, q.pose)


NONSENSE = (
    *((0.0, step, "step > 0") for step in (0.0, -0.1, np.nan, np.inf)),
    *((time, 0.1, "current time") for time in (0.5, np.nan)),
    *((0.0, step, "stop time") for step in (2.1, 2.0 + 2e-9)),
)


def test_a_step_that_makes_no_sense_is_an_error(fmu: Fmu) -> None:
    """Expected: a clock may round a little: 1e-9 s for times about a second pass the stop time."""
    with plant(fmu) as p:
        p.refuses("not allowed in the instantiated state", ERROR, p.do_step, 0.0, 0.1)
        p.refuses("start time 1 s, stop time 0.5 s rejected", ERROR, p.initialise, None, 1.0, 0.5)
        p.start(stop=2.0)
        before = p.serialized()
        for time, step, expected in NONSENSE:
            p.refuses(expected, ERROR, p.do_step, time, step)
            assert p.serialized() == before
        assert refused(p.do_step, 0.0, 2.0 + 0.5e-9) == OK
        p.fmu.terminate()
        assert refused(p.do_step, p.time, 0.1) == ERROR


def test_an_importers_clock_may_round_a_little(fmu: Fmu) -> None:
    """Expected: early and late, before time 0 as after it."""
    for now, step, inside, outside in CLOCKS:
        for begin, side in ((now, 1), (now, -1), (-now, 1), (-now, -1)):
            with plant(fmu) as p:
                p.start(time=begin)
                assert p.time == begin
                p.refuses("current time", ERROR, p.do_step, begin + side * outside, step)
                p.do_step(begin + side * inside, step)


def test_a_tolerance_is_from_1e_13_to_1e_2_and_in_model_exchange_the_importers_business(fmu: Fmu) -> None:
    for tolerance, status in ((0.0, ERROR), (-1e-8, ERROR), (np.nan, ERROR), (1.0, ERROR), (1e-13, OK), (1e-2, OK)):
        with plant(fmu) as p:
            assert refused(p.start, tolerance=tolerance) == status
            assert ("tolerance" in p.take_messages()) == (status == ERROR)
    with plant(fmu, co_simulation=False) as p:
        p.start(tolerance=0.1)


def test_unknown_references_wrong_counts_and_null_pointers_are_errors(fmu: Fmu) -> None:
    with plant(fmu) as p:
        one, tail, c = (c_double * 1)(), () if p.is_fmi2 else (1,), p.fmu.component
        get = p.fmu.fmi2GetReal if p.is_fmi2 else p.fmu.fmi3GetFloat64
        beyond = 1 + max(reference for whole in p.variables.values() for reference in whole.references)
        unknown, scalar = (c_uint32 * 1)(beyond), (c_uint32 * 1)(*p.references("kinetic_energy"))
        p.refuses(f"no variable has value reference {beyond}", ERROR, get, c, unknown, 1, one, *tail)
        p.refuses("null", ERROR, get, c, POINTER(c_uint32)(), 1, one, *tail)
        p.refuses("null", ERROR, get, c, scalar, 1, POINTER(c_double)(), *tail)
        assert refused(get, None, unknown, 1, one, *tail) == ERROR
        if not p.is_fmi2:
            p.refuses("found 5 values; expected 6", ERROR, get, c, (c_uint32 * 1)(0), 1, (c_double * 6)(), 5)


def test_an_importer_with_another_description_gets_no_instance_and_a_reason(fmu: Fmu) -> None:
    cases: list[tuple[dict[str, Any], str]] = [({"token": "another"}, r"wrong token 'another'; expected")]
    cases.append(({"name": " "}, "name"))
    if fmu.is_fmi2:
        with plant(fmu) as p:
            assert not p.fmu.dll.fmi2Instantiate(b"plant", 7, fmu.token.encode(), b"", byref(p.callbacks), 0, 0)
            assert "unknown FMU type 7" in p.messages[-1].text
    else:
        cases += [({"eventModeUsed": True}, "event mode is not offered")]
        for k in (4711, *fmu.variables["platform_mass"].references):
            cases += [({"requiredIntermediateVariables": [k]}, f"value reference {k} is not available in intermedia")]
    for options, expected in cases:
        with pytest.raises(NotInstantiatedError, match=expected):
            Plant(fmu, **options)


def test_messages_respect_logging_and_categories(fmu: Fmu) -> None:
    """Expected: of a refused value that category's message, if it is on; that of an error always."""
    names = [f"logStatus{kind}" for kind in ("Warning", "Discard", "Error")]
    for chosen in (None, [], *([name] for name in names), names[1:], ["logAll"]):
        with plant(fmu, logging=False) as p:
            if chosen is not None:
                p.fmu.setDebugLogging(True, chosen)
            for _ in range(2):
                refused(p.set, "platform_mass", -1.0)
                refused(p.do_step, 0.0, 0.1)
                discarded = names[1:2] if chosen == [] or {"logAll", names[1]} & {*(chosen or ())} else []
                assert [m.category for m in p.messages] == [*discarded, "logStatusError"]
                p.take_messages()
                assert refused(p.fmu.setDebugLogging, True, ["logStatusEror"]) == ERROR  # changes nothing
                assert "logStatusEror" in p.take_messages()
            p.fmu.setDebugLogging(False, [])
            refused(p.set, "platform_mass", -1.0)
            assert p.messages == []


@pytest.mark.parametrize("part", ["lower", "upper"])
def test_a_centre_of_mass_lies_on_the_shortest_leg_of_the_start(fmu: Fmu, part: str) -> None:
    lengths = gs.leg_geometry(UNEVEN, STATE.position, STATE.orientation).length
    shortest, factors = lengths.min(), {f"leg_{part}_com_factor": 1.0 + (lengths == lengths.min())}
    for share, status in ((0.999, OK), (1.001, ERROR)):
        with plant(fmu) as p:
            assert refused(p.start, {**MOVING, **factors, f"leg_{part}_com": share * shortest / 2}) == status
            told = f"leg_{part}_com is {share * shortest:g} m; expected at most the shortest leg length at the start"
            assert re.search(rf"{told}, {shortest:g} m \(leg {lengths.argmin() + 1}\)|^$", p.take_messages())


def test_a_message_that_is_too_long_ends_with_a_whole_character(fmu: Fmu) -> None:
    """Expected: as many whole characters as fit into 400 bytes with the zero at the end, for each length in UTF-8."""
    with plant(fmu) as p:
        for character in ("a", "\u0080", "\u07ff", "\u0800", "\uffff", "\U00010000", "\U0010ffff"):
            for shift in range(4):
                text = "x" * shift + character * 700
                assert refused(p.fmu.setDebugLogging, True, [text]) == ERROR
                shown = p.messages[-1].text
                assert shown.endswith(character)
                assert text.startswith(shown[shown.index("'") + 1 :])
                assert 399 - len(character.encode()) < len(shown.encode()) <= 399
        refused(p.fmu.setDebugLogging, True, ["100%s%n"])
        assert "%" not in p.messages[-1].text  # leaves nothing for the importer to format
