"""Units of machines that stick or give, beside the stepping model; massless legs and shared joints, by mechanics."""

import re
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.documented_loop import accelerations, twist_of_rates
from tests.support.fmu_plants import ERROR, OK, STATES, Fmu, Plant, plant, refused
from tests.support.real_platforms import real_platform
from tests.support.uneven import INPUT_VALUES, MOVING, STATE, UNEVEN

OWN_STATES = ("leg_bristle", "motor_position", "motor_velocity")


def at_home(platform: gs.Platform) -> dict[str, Any]:
    home = {name: getattr(platform, f"home_{name}") for name in ("position", "orientation", "actuator_force")}
    return home | ({"motor_position": platform.home_motor_position} if platform.leg_stiffness else {})


@pytest.mark.parametrize("kind", ["model", "fmu3"])
def test_a_loop_ends_with_the_reason_where_steps_are_too_long_for_friction_that_sticks(kind: str) -> None:
    """Expected: 2 ms are refused, and the longest are named."""
    friction = {"leg_friction_model": "lugre", "leg_coulomb_friction": 100.0}
    settings = {"platform.parameters": friction, "plant.kind": kind, "plant.fixed_step_size": "2 ms"}
    record = gs.run("heave_step", {**settings, "loop.duration": 0.3, "loop.sample_time": "2 ms"})
    assert len(record["position"]) == 1
    cause = record.metadata["outcome"]["cause"]
    assert re.search(r"0\.002 .*too large for legs with stiction.*at most 0\.001 s", cause)


def test_states_have_nominals_of_their_size(whole: dict[str, Fmu]) -> None:
    """Expected: 1e-5 m for bristles, for CVODE's accuracy, else a millimetre; in XML and in C."""
    for fmu in whole.values():
        with plant(fmu, co_simulation=False) as p:
            p.start()
            assert p.nominals(30).tolist() == [*[1e-3] * 12, *[1e-5] * 6, *[1e-3] * 12]
        declared = {name: float(w.declared[0].nominal) for name, w in fmu.variables.items() if w.declared[0].nominal}
        assert declared == {name: 1e-5 if name == "leg_bristle" else 1e-3 for name in (*STATES, *OWN_STATES)}


REFUSED: dict[str, tuple[float, str]] = {
    "leg_friction_model": (0.0, "leg_friction_model is 0; expected 1"),
    "leg_coulomb_friction": (0.0, "leg_coulomb_friction is 0 N"),
    "leg_static_friction": (1.0, "leg_static_friction is 1 N, below leg_coulomb_friction"),
    "leg_bristle_stiffness": (1.0, "leg_bristle_stiffness is 1 N/m: legs would stick over"),
    "leg_breakaway_share": (1.0, "leg_breakaway_share is 1; expected at most 0.99"),
    "leg_armature": (0.0, "leg_armature is 0 kg; a leg with leg_stiffness"),
    "leg_stiffness": (1.0, "leg_stiffness is 1 N/m; expected"),
    "motor_position": (1.0, "motor_position[1] is 1 m, but leg_length[1]"),
}


def test_what_a_platform_refuses_the_unit_refuses(whole: dict[str, Fmu]) -> None:
    platform = real_platform("lugre", springs=True)
    for name, (value, message) in REFUSED.items():
        with Plant(whole["2.0"]) as p:
            assert refused(p.start, {**at_home(platform), name: value}, platform=platform) == ERROR
            assert message in p.take_messages()


_ZEROS = ("leg_lower_mass", "leg_upper_mass", "leg_lower_inertia", "leg_upper_inertia", "leg_armature")
MASSLESS = UNEVEN.with_parameters(dict.fromkeys((*_ZEROS, "leg_viscous_friction", "leg_coulomb_friction"), 0.0))


def test_a_platform_on_massless_legs_is_a_rigid_body_under_forces_along_them(fmu: Fmu) -> None:
    """Expected: a Lagrangian's acceleration; joints carry the actuators' forces alone."""
    q, twist = np.concatenate(STATE[:2]), np.concatenate(STATE[2:])
    rate = np.asarray(np.linalg.solve(twist_of_rates(q), twist))
    u = [*INPUT_VALUES.values()]
    along = gs.leg_geometry(MASSLESS, *STATE[:2]).direction
    expected = {
        "acceleration": accelerations(MASSLESS, q, rate, u[0], np.concatenate(u[1:]))[:3],
        "joint_force": u[0][:, None] * along,
    }
    model = gs.SteppingModel(MASSLESS)
    model.set_many(MOVING)
    with plant(fmu) as p:
        p.start(MOVING, platform=MASSLESS)
        for name, value in expected.items():
            assert np.asarray(model.get(name)) == pytest.approx(value, rel=1e-9, abs=1e-9), name
            assert p.get(name) == pytest.approx(value, rel=1e-9, abs=1e-9), name


@pytest.mark.parametrize(("one", "other"), [(0, 5), (1, 3), (4, 2)])
@pytest.mark.parametrize("name", ["base_points", "platform_points"])
def test_legs_that_share_both_joints_are_named(fmu: Fmu, name: str, one: int, other: int) -> None:
    """Expected: closer than a millionth of the largest distance is one joint; one end may be shared."""
    low, high = sorted((one + 1, other + 1))
    elsewhere = {"base_points", "platform_points"} - {name}
    for share, shares_both, is_one in ((0.9, False, False), (0.9, True, True), (1.1, True, False)):
        points = {key: np.array(getattr(UNEVEN, key)) for key in ("base_points", "platform_points")}
        for key in (name, *elsewhere) if shares_both else (name,):
            points[key][other] = points[key][one]
        widest = max(np.linalg.norm(a - b) for a in points[name] for b in points[name])
        points[name][other] += share * 1e-6 * widest * np.array([0.6, 0.0, -0.8])
        if is_one:
            where = rf"legs {low} and {high} share both joints, at \({points['base_points'][one][0]:g}, "
            with pytest.raises(gs.GoughStewartError, match=where):
                UNEVEN.with_parameters({**points, "leg_length_min": None, "leg_length_max": None})
        elif shares_both:
            UNEVEN.with_parameters({**points, "leg_length_min": None, "leg_length_max": None})
        with plant(fmu) as p:
            status = refused(p.start, {**MOVING, **points})
            assert (f"legs {low} and {high} share both joints" in p.take_messages()) == is_one
        assert is_one or shares_both or status == OK
        assert not is_one or status == ERROR
