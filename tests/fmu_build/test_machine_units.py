"""Units of machines that stick or give, beside the stepping model; massless legs and shared joints, by mechanics."""

import re
from typing import Any

import numpy as np
import pytest
from fmpy import simulate_fmu
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from tests.support.fmu_plants import ERROR, OK, STATES, Fmu, Plant, by_element, plant, refused
from tests.support.lagrangian import FloatArray
from tests.support.real_platforms import real_platform
from tests.support.uneven import INPUT_VALUES, MOVING, STATE, UNEVEN

OWN_STATES = ("leg_bristle", "motor_position", "motor_velocity")


def at_home(platform: gs.Platform) -> dict[str, Any]:
    home = {name: getattr(platform, f"home_{name}") for name in ("position", "orientation", "actuator_force")}
    return home | ({"motor_position": platform.home_motor_position} if platform.leg_stiffness else {})


@pytest.mark.parametrize("kind", ["model", "fmu3"])
def test_a_loop_takes_steps_of_1_ms_where_friction_sticks_and_no_longer_ones(kind: str) -> None:
    """Expected: the loop on the model under error control; errors of steps are corrected as by any feedback."""
    settings = {
        "platform.parameters": {"leg_friction_model": "lugre", "leg_coulomb_friction": 100.0},
        "loop.duration": 0.3,
        "plant.kind": kind,
    }
    exact = gs.run("heave_step", {**settings, "plant.kind": "model", "plant.tolerance": 1e-10})
    found = gs.run("heave_step", {**settings, "plant.fixed_step_size": "1 ms"})
    assert np.ptp(exact["position"][:, 2]) > 0.02
    # encoders of 10 µm may tell two equal lengths apart
    assert np.abs(found["position"] - exact["position"]).max() < 3e-6
    long = gs.run("heave_step", {**settings, "loop.sample_time": "2 ms", "plant.fixed_step_size": "2 ms"})
    assert len(long["position"]) == 1
    assert re.search(r"0\.002 .*too large for legs with stiction.*at most 0\.001 s", long.metadata["outcome"]["cause"])


def test_states_have_nominals_of_their_size(whole: dict[str, Fmu]) -> None:
    """Expected: 1e-5 m for bristles, for CVODE's accuracy, else a millimetre; in XML and in C."""
    for fmu in whole.values():
        with plant(fmu, co_simulation=False) as p:
            p.start()
            assert p.nominals(30).tolist() == [*[1e-3] * 12, *[1e-5] * 6, *[1e-3] * 12]
        declared = {name: float(w.declared[0].nominal) for name, w in fmu.variables.items() if w.declared[0].nominal}
        assert declared == {name: 1e-5 if name == "leg_bristle" else 1e-3 for name in (*STATES, *OWN_STATES)}


def test_under_cvode_bristles_are_as_exact_as_their_nominal_says(sticking: Fmu) -> None:
    """Legs reverse at up to 0.06 m/s, by FMPy in Model Exchange at 1e-6. Expected: the model at 1e-11."""
    friction = {"leg_friction_model": "elasto_plastic", "leg_coulomb_friction": 100.0, "leg_static_friction": 150.0}
    platform = gs.load_preset("motion_base").with_parameters(friction)
    start = {"velocity": np.array([0.01, -0.02, -0.03]), "angular_velocity": np.array([0.01, 0.02, -0.01])}
    start["actuator_force"] = platform.home_actuator_force + np.array([300.0, -200, 250, 120, -60, 350])
    model, exact = gs.SteppingModel(platform, 1e-11, integrator="scipy"), list[FloatArray]()
    model.set_many(start)
    for k in range(200):
        model.do_step(2e-3 * k, 2e-3)
        exact.append(model.state[[*range(6), *range(12, 18)]])
    values = {name: getattr(platform, name) for name in sticking.variables if hasattr(platform, name)}
    output = ["position", "orientation", "leg_bristle"]
    result = simulate_fmu(
        str(sticking.path),
        fmi_type="ModelExchange",
        start_values=by_element(sticking, values | at_home(platform) | start),
        output=output,
        stop_time=0.4,
        output_interval=2e-3,
        relative_tolerance=1e-6,
    )
    found = np.concatenate([result[name] for name in output], axis=1)[1:]
    error = np.sqrt(((found - exact) ** 2).mean(axis=0))
    assert error[:6].max() < 3e-8
    assert error[6:].max() < 3e-10
    assert (np.ptp(np.sign(np.array(exact)[:, 6:]), axis=0) == 2).sum() >= 3


# Numbers: 25.9 N in 1 mm, (2π · 1 Hz)² (1.2 + 11.5/6) kg.
REFUSED: dict[str, tuple[Any, str]] = {
    "leg_friction_model": (0.0, "leg_friction_model is 0; expected 1"),
    "leg_coulomb_friction_factor": ([1, 1, 0, 1, 1, 1], "leg_coulomb_friction is 0 N in leg 3"),
    "leg_static_friction": (1.0, "leg_static_friction is 1 N, below leg_coulomb_friction"),
    "leg_bristle_stiffness_factor": ([1, 1e-6, 1, 1, 1, 1], "is 2.9 N/m: legs would stick .* 25918 N/m or .*leg 2"),
    "leg_breakaway_share_factor": ([1, 1, 1, 1, 1, 1.7], "leg_breakaway_share is 1.054; expected at most 0.99.*leg 6"),
    "leg_armature_factor": ([1, 1, 1, 1, 0, 1], "leg_armature is 0 kg; a leg with leg_stiffness .*leg 5"),
    "leg_stiffness_factor": ([1, 1, 1, 1e-6, 1, 1], "leg_stiffness is 3.1 N/m; expected 123 N/m or more.*leg 4"),
    "motor_position": (1.0, r"motor_position\[1\] is 1 m, but leg_length\[1\]"),
}


def test_what_a_platform_refuses_the_unit_refuses(whole: dict[str, Fmu]) -> None:
    platform = real_platform("lugre", springs=True)
    for name, (value, message) in REFUSED.items():
        with Plant(whole["2.0"]) as p:
            assert refused(p.start, {**at_home(platform), name: value}, platform=platform) == ERROR
            assert re.search(message, p.take_messages()), name


_ZEROS = ("leg_lower_mass", "leg_upper_mass", "leg_lower_inertia", "leg_upper_inertia", "leg_armature")
MASSLESS = UNEVEN.with_parameters(dict.fromkeys((*_ZEROS, "leg_viscous_friction", "leg_coulomb_friction"), 0.0))


def test_a_platform_on_massless_legs_is_a_rigid_body_under_forces_along_them(fmu: Fmu) -> None:
    """Expected: Newton and Euler for one body under the actuators' forces; at rest six of them balance the weight."""
    R = Rotation.from_euler("xyz", STATE.orientation).as_matrix()
    arms, com = MASSLESS.platform_points @ R.T, R @ MASSLESS.platform_com
    u = STATE.position + arms - MASSLESS.base_points
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    forces, omega = INPUT_VALUES["actuator_force"][:, None] * u, STATE.angular_velocity
    total = forces.sum(axis=0) + INPUT_VALUES["external_force"]
    moment = np.cross(arms - com, forces).sum(axis=0) + INPUT_VALUES["external_torque"]
    moment = moment - np.cross(com, INPUT_VALUES["external_force"])
    inertia = R @ MASSLESS.platform_inertia @ R.T
    turning = np.linalg.solve(inertia, moment - np.cross(omega, inertia @ omega))
    of_com = total / MASSLESS.platform_mass + MASSLESS.gravity
    acceleration = of_com - np.cross(turning, com) - np.cross(omega, np.cross(omega, com))
    expected = {"acceleration": acceleration, "angular_acceleration": turning, "joint_force": forces}
    model = gs.SteppingModel(MASSLESS)
    model.set_many(MOVING)
    with plant(fmu) as p:
        p.start(MOVING, platform=MASSLESS)
        for name, value in expected.items():
            assert np.asarray(model.get(name)) == pytest.approx(value, rel=1e-9, abs=1e-9), name
            assert p.get(name) == pytest.approx(value, rel=1e-9, abs=1e-9), name
    weight = MASSLESS.platform_mass * MASSLESS.gravity
    held = np.linalg.solve(np.vstack([u.T, np.cross(arms, u).T]), -np.concatenate([weight, np.cross(com, weight)]))
    assert gs.static_leg_forces(MASSLESS, STATE.position, STATE.orientation) == pytest.approx(held, rel=1e-10)


@pytest.mark.parametrize(("one", "other"), [(0, 5), (1, 3), (4, 2)])
@pytest.mark.parametrize("name", ["base_points", "platform_points"])
def test_legs_that_share_both_joints_are_named(fmu: Fmu, name: str, one: int, other: int) -> None:
    """Expected: closer than a millionth of the largest distance is one joint; one end may be shared."""
    low, high = sorted((one + 1, other + 1))
    elsewhere = {"base_points", "platform_points"} - {name}
    for share, shares_both, is_one in ((0.5, False, False), (0.5, True, True), (2.0, True, False)):
        points = {key: np.array(getattr(UNEVEN, key)) for key in ("base_points", "platform_points")}
        for key in (name, *elsewhere) if shares_both else (name,):
            points[key][other] = points[key][one]
        widest = max(np.linalg.norm(a - b) for a in points[name] for b in points[name])
        points[name][other] += share * 1e-6 * widest * np.array([0.6, 0.0, -0.8])
        with plant(fmu) as p:
            status = refused(p.start, {**MOVING, **points})
            assert (f"legs {low} and {high} share both joints" in p.take_messages()) == is_one
        assert is_one or shares_both or status == OK
        assert not is_one or status == ERROR
