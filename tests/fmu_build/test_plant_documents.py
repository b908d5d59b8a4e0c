"""What the plant adds to its unit: the page in full, terminals, reference results, dependencies, tables."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from gough_stewart.fmu_build import model_description
from gough_stewart.fmu_build.layout import PARAMETER_ROLES
from gough_stewart.fmu_build.plant.component import plant_component
from gough_stewart.fmu_build.plant.drawing import icon_png, icon_svg
from gough_stewart.fmu_build.plant.layout import PLANT
from gough_stewart.fmu_build.plant.reference_results import (
    ReferenceCase,
    reference_cases,
    reference_files,
    reference_results,
)
from gough_stewart.fmu_build.plant.tables import plant_header
from gough_stewart.model import interface
from gough_stewart.model.formulations import newton_euler
from gough_stewart.model.kernel import Kernel, parameter_vector
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.state import State
from tests.support.random_platforms import random_inputs, random_platform, random_state
from tests.support.uneven import INPUTS, STATE, UNEVEN

VERSIONS = ("2.0", "3.0")


# --- terminals and pictures ------------------------------------------------------------------------------------------


def test_terminals_and_their_members_are_in_the_order_of_use() -> None:
    """Expected: actuators by leg, then what others measure, then what loads the platform; force before length."""
    component = plant_component(UNEVEN, is_in_a_system=True)
    pose = ["position", "orientation", "velocity", "angular_velocity"]
    wrench = ["external_force", "external_torque"]
    arrays = [(t.name, list(t.members)) for t in component.terminals("3.0")]
    actuator = ["actuator_force", "leg_length", "leg_velocity"]
    assert arrays == [("actuators", actuator), ("pose", pose), ("external_wrench", wrench)]
    scalars = [(t.name, list(t.members.values())) for t in component.terminals("2.0")]
    assert scalars[:6] == [(f"actuator_{leg}", [f"{name}[{leg}]" for name in actuator]) for leg in range(1, 7)]
    assert scalars[6:] == [
        ("pose", [f"{name}[{k}]" for name in pose for k in (1, 2, 3)]),
        ("external_wrench", [f"{name}[{k}]" for name in wrench for k in (1, 2, 3)]),
    ]
    assert component.icon.png == icon_png(UNEVEN)
    assert component.icon.svg == icon_svg(UNEVEN)
    assert (component.identifier, component.name) == ("gough_stewart", "GoughStewart")
    assert component.file_stem == "gough_stewart"


# --- reference results -----------------------------------------------------------------------------------------------


def test_the_inputs_of_both_cases_are_those_that_their_description_gives() -> None:
    """Expected: leg k pushes with its static force ± 10 %, k periods of it; a wrench of one sine squared.

    The other case is the paper's by Froude's rule: lengths by λ, times by √λ, forces in its ratio of 55 to 49.5.
    """
    open_loop, varying = reference_cases(UNEVEN)
    assert [each.name for each in (open_loop, varying)] == ["open_loop", "varying_inputs"]
    turn = Rotation.from_euler("xyz", UNEVEN.home_orientation)
    legs = UNEVEN.home_position + turn.apply(UNEVEN.platform_points.copy()) - UNEVEN.base_points
    paper = load_preset("liu2000")
    paper_legs = paper.home_position + paper.platform_points - paper.base_points
    assert np.allclose(paper.home_orientation, 0)
    root = np.sqrt(np.linalg.norm(legs, axis=1).mean() / np.linalg.norm(paper_legs, axis=1).mean())
    for case in (open_loop, varying):
        assert case.platform is UNEVEN
        np.testing.assert_allclose(case.time, np.arange(101) * root / 100, rtol=1e-12, atol=1e-15)
    start = open_loop.start
    np.testing.assert_array_equal(start.position, UNEVEN.home_position)
    np.testing.assert_allclose(start.orientation, UNEVEN.home_orientation - [0, 0, 0.1])
    np.testing.assert_allclose(start.velocity, [0, 0.2 * root, 0])
    np.testing.assert_allclose(start.angular_velocity, [0, 0.1 / root, 0])
    hold = UNEVEN.home_actuator_force
    forces = hold * np.array([55 / 49.5, 1] * 3)
    np.testing.assert_allclose(open_loop.inputs, np.tile([*forces, *np.zeros(6)], (101, 1)))
    np.testing.assert_array_equal(varying.start.position, UNEVEN.home_position)
    np.testing.assert_array_equal(varying.start.orientation, UNEVEN.home_orientation)
    assert not np.any([varying.start.velocity, varying.start.angular_velocity])
    weight, size = 11.5 * 9.81, UNEVEN.characteristic_length
    wrench = weight * np.array([0.05, -0.03, 0.1, 0.01 * size, 0.02 * size, -0.01 * size])
    for k, row in enumerate(varying.inputs):
        share = k / 100
        for leg in range(6):
            expected = hold[leg] * (1 + np.sin(2 * np.pi * (leg + 1) * share) / 10)
            assert row[leg] == pytest.approx(expected, rel=1e-12)
        # sin² a = (1 − cos 2a)/2
        np.testing.assert_allclose(row[6:], wrench * (1 - np.cos(2 * np.pi * share)) / 2, atol=1e-12 * weight)


def test_reference_results_are_those_of_another_formulation_under_linear_inputs() -> None:
    """Expected: balances of every body (Newton–Euler) with a rotation matrix as state; uneven rows, from 7.3 s."""
    time = np.array([7.3, 7.34, 7.41])
    more = np.array([9.0, -7, 5, -6, 8, -4, 2, -1, 3, -2, 1, -3])
    inputs = INPUTS.to_vector() + np.outer([0, 1, -1], more)
    found = interface.unpack(interface.RESULTS, reference_results(ReferenceCase("own", UNEVEN, STATE, time, inputs)))

    def solved(t: float, y: np.ndarray) -> newton_euler.Solution:
        u = np.array([np.interp(t, time, column) for column in inputs.T])
        return newton_euler.solve(UNEVEN, y[:3], y[3:12].reshape(3, 3), y[12:15], y[15:], u[:6], u[6:9], u[9:])

    def derivatives(t: float, y: np.ndarray) -> np.ndarray:
        a = solved(t, y)
        return np.concatenate(
            [y[12:15], np.cross(y[15:], y[3:12].reshape(3, 3), axisb=0, axisc=0).ravel(), a.linear, a.angular]
        )

    turn = Rotation.from_euler("xyz", STATE.orientation)
    y = np.concatenate([STATE.position, turn.as_matrix().ravel(), STATE.velocity, STATE.angular_velocity])
    for k, t in enumerate(time):
        if k:
            y = solve_ivp(derivatives, (time[k - 1], t), y, rtol=1e-9, atol=1e-10).y[:, -1]
        a, R = solved(t, y), y[3:12].reshape(3, 3)
        legs = y[:3] + UNEVEN.platform_points @ R.T - UNEVEN.base_points
        expected = {
            "position": y[:3],
            "orientation": Rotation.from_matrix(R).as_euler("xyz"),
            "velocity": y[12:15],
            "angular_velocity": y[15:],
            "leg_length": np.linalg.norm(legs, axis=1),
            "acceleration": a.linear,
            "angular_acceleration": a.angular,
            "joint_force": a.joint_force,
        }
        for name, value in expected.items():
            np.testing.assert_allclose(found[name][k], value, rtol=1e-6, atol=1e-7, err_msg=name)


def test_the_read_me_of_the_references_names_files_and_accuracy() -> None:
    text = reference_files((), "own_name", "2.0")["extra/gough_stewart/README.txt"].decode()
    assert "values in own_name_start.csv" in text
    assert "integrated by SciPy's DOP853 at tolerance 1e-12" in text
    for name in ("open_loop ", "varying_inputs ", "*_in.csv ", "*_ref.csv ", "*_ref.opt ", "*_start.csv "):
        assert f"\n{name}" in text


# --- dependencies and tables -----------------------------------------------------------------------------------------


def test_dependencies_on_parameters_are_those_that_differences_show() -> None:
    """Expected: slots of parameters that change a result or a derivative, at three random points: no more, no less."""
    rng, kernel = np.random.default_rng(6), Kernel()
    unknowns = [*range(137, 149), *range(12, 62)]
    found: dict[int, set[int]] = {slot: set() for slot in unknowns}
    for _ in range(3):
        platform = random_platform(rng)
        x, u = random_state(platform, rng).to_vector(), random_inputs(platform, rng).to_vector()
        p = parameter_vector(platform)

        def values(p: np.ndarray, x: np.ndarray = x, u: np.ndarray = u) -> np.ndarray:
            return np.concatenate([kernel.derivatives(x, u, p), kernel.outputs(x, u, p)])

        base = values(p)
        for k in range(len(p)):
            changed = p.copy()
            changed[k] += 0.01 * max(0.1, abs(p[k]))
            different = np.abs(values(changed) - base) > 1e-9 * (1 + np.abs(base))
            for slot, differs in zip(unknowns, different, strict=True):
                if differs:
                    found[slot].add(62 + k)
    component = plant_component(UNEVEN, is_in_a_system=True)
    for slot, expected in found.items():
        assert set(model_description.dependencies_of_slot(component, slot, PARAMETER_ROLES)) == expected, PLANT.rows
        # the whole list is in ascending order
        assert list(component.dependencies[slot]) == sorted(component.dependencies[slot])


@cache
def defined() -> dict[str, float]:
    header = plant_header()
    return {name: float(text) for name, text in re.findall(r"^#define (\w+) (\S+)", header, re.M)}


def test_the_table_of_the_plant_has_the_places_and_limits_of_the_model() -> None:
    """Expected: by hand, from the sizes of the variables in their order, and the limits of the documentation."""
    found = dict(defined())
    vectors = {"X": dict(STATES), "R": dict(STATES + RESULTS), "P": dict(PARAMETERS)}
    for prefix, sizes in vectors.items():
        ends = np.cumsum([0, *sizes.values()])[:-1]
        for name, at in zip(sizes, ends, strict=True):
            assert found.pop(f"{prefix}_{name.upper()}") == at
    assert found == {
        "N_LEGS": 6,
        "HAS_BRISTLES": 0,
        "HAS_SPRINGS": 0,
        "FIXED_STEP_SIZE": 136,
        "X_PITCH": 4,
        "SMALLEST_TOLERANCE": 1e-13,
        "LARGEST_TOLERANCE": 1e-2,
        "MOST_INTERNAL_STEPS": 20_000,
        "MOST_FIXED_STEPS": 1_000_000,
        "LARGEST_PITCH": pytest.approx(np.pi / 2 - 1e-3),
        "SHORTEST_LEG": 1e-3,
        "SINGULAR_CONDITION_NUMBER": 1e8,
        "INERTIA_SLACK": 1e-9,
        "COINCIDENCE": 1e-6,
    }


STATES = [("position", 3), ("orientation", 3), ("velocity", 3), ("angular_velocity", 3)]
RESULTS = [("leg_length", 6), ("leg_velocity", 6), ("acceleration", 3), ("angular_acceleration", 3)]
RESULTS += [("joint_force", 18), ("kinetic_energy", 1), ("potential_energy", 1)]
PARAMETERS = [("base_points", 18), ("platform_points", 18), ("platform_mass", 1), ("platform_com", 3)]
PARAMETERS += [("platform_inertia", 9), ("leg_lower_mass", 1), ("leg_upper_mass", 1), ("leg_lower_com", 1)]
PARAMETERS += [("leg_upper_com", 1), ("leg_lower_inertia", 1), ("leg_upper_inertia", 1), ("leg_viscous_friction", 1)]
PARAMETERS += [("leg_coulomb_friction", 1), ("leg_friction_velocity", 1), ("gravity", 3), ("leg_armature", 1)]
PARAMETERS += [("leg_viscous_friction_factor", 6), ("leg_coulomb_friction_factor", 6)]


def test_the_component_takes_each_of_its_options() -> None:
    """Expected: what is passed in; without it, home at rest, the forces that hold it, the documented tolerance."""
    at_home = plant_component(UNEVEN)
    start = State(*(value + 0.25 for value in STATE))
    forces = np.arange(6.0) - 2
    own = plant_component(
        UNEVEN, start=start, actuator_force=forces, tolerance=2e-5, fixed_step_size=0.125, file_stem="mine"
    )
    for name, value in start._asdict().items():
        np.testing.assert_array_equal(own.starts[name], value)
    np.testing.assert_array_equal(own.starts["actuator_force"], forces)
    np.testing.assert_array_equal(at_home.starts["actuator_force"], UNEVEN.home_actuator_force)
    np.testing.assert_array_equal(at_home.starts["orientation"], UNEVEN.home_orientation)
    assert [float(each.starts["fixed_step_size"]) for each in (own, at_home)] == [0.125, 0]
    assert (own.experiment["tolerance"], at_home.experiment["tolerance"]) == ("2e-05", "1e-08")
    assert own.file_stem == "mine"
    assert own.code == at_home.code
    assert [dict(each.options) for each in (own, plant_component(UNEVEN, is_in_a_system=True))] == [
        {"ZEROS_ARE_UNSET_AT_START": False},
        {"ZEROS_ARE_UNSET_AT_START": True},
    ]
    assert own.settings == {"fixed_step_size"}
    assert replace(own, starts=at_home.starts).layout is PLANT
