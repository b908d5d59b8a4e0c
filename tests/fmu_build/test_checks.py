"""Where the unit's checks of pose and platform draw the line, and what their messages say, against NumPy."""

import re
from ctypes import c_double
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gough_stewart.model.kinematics import leg_geometry, scaled_jacobian_of_legs
from gough_stewart.model.pose_limits import SHORTEST_LEG, SINGULAR_CONDITION_NUMBER
from tests.fmu_build.test_trajectories import start_of
from tests.support.fmu_plants import ERROR, OK, Fmu, plant, refused
from tests.support.uneven import STATE, UNEVEN, uneven_case


def frobenius_condition(yaw: float) -> float:
    """‖J‖ ‖J⁻¹‖ in Frobenius norms, of the Jacobian with angles scaled to lengths."""
    J, _ = scaled_jacobian_of_legs(leg_geometry(UNEVEN, STATE.position, np.array([0.09, -0.14, yaw])))
    return float(np.linalg.norm(J) * np.linalg.norm(np.linalg.inv(J)))


def yaw_of_condition(wanted: float) -> float:
    """On this side of the singular pose, by bisection."""
    low, high = 0.21, 2.0
    for _ in range(200):
        middle = (low + high) / 2
        J, _ = scaled_jacobian_of_legs(leg_geometry(UNEVEN, STATE.position, np.array([0.09, -0.14, middle])))
        start, _ = scaled_jacobian_of_legs(leg_geometry(UNEVEN, STATE.position, np.array([0.09, -0.14, 0.21])))
        passed = np.linalg.det(J) * np.linalg.det(start) < 0
        low, high = (low, middle) if passed or frobenius_condition(middle) > wanted else (middle, high)
    return low


@pytest.mark.parametrize("share", [0.5, 0.97, 1.03, 2.0, 50.0])
def test_the_limit_of_the_condition_number_is_where_numpy_has_it(fmu: Fmu, share: float) -> None:
    """Expected: NumPy's inverse, in the Frobenius norms that the unit states; refused with its number above."""
    yaw = yaw_of_condition(share * SINGULAR_CONDITION_NUMBER)
    values = start_of(uneven_case()) | {"orientation": [0.09, -0.14, yaw]}
    with plant(fmu) as p:
        if share < 1:
            p.start(values)
            return
        assert refused(p.start, values) == ERROR
        number = re.search(r"condition number of the leg Jacobian = ([\d.e+]+):", p.messages[-1].text)
        assert number
        assert float(number[1]) == pytest.approx(frobenius_condition(yaw), rel=1e-4)


@pytest.mark.parametrize("leg", range(6))
def test_a_leg_that_leans_along_one_axis_only_is_no_singular_pose(fmu: Fmu, leg: int) -> None:
    """Expected: it starts; the Jacobian has zeros where elimination would begin."""
    base = UNEVEN.base_points.copy()
    base[leg, :2] = UNEVEN.platform_points[leg, :2]
    with plant(fmu) as p:
        values = {"base_points": base, "position": [0.0, 0.0, 3.0], "orientation": [0.0, 0.0, 0.0]}
        p.start(start_of(uneven_case()) | values)
        p.step(0.0, 0.01)


@pytest.mark.parametrize("leg", range(6))
def test_a_leg_shorter_than_its_share_of_the_platform_has_collapsed(fmu: Fmu, leg: int) -> None:
    """Expected: a thousandth of the root-mean-square arm; said of this leg, and with its length."""
    for share, is_refused in ((0.9, True), (1.1, False)):
        length = share * SHORTEST_LEG * UNEVEN.characteristic_length
        with plant(fmu, co_simulation=False) as p:
            p.start(start_of(uneven_case()) | {"orientation": [0.0, 0.0, 0.2]})
            x = np.concatenate([p.get(name) for name in ("position", "orientation", "velocity", "angular_velocity")])
            place = leg_geometry(UNEVEN, np.zeros(3), np.array([0.0, 0.0, 0.2])).arm[leg]
            x[:3] = UNEVEN.base_points[leg] - place + length * np.array([0.6, 0.0, 0.8])
            p.fmu.setContinuousStates((c_double * 12)(*x), 12)
            refused(p.fmu.completedIntegratorStep)
            said = f"leg_length[{leg + 1}] = {length:.6g} m: the leg has collapsed"
            assert (bool(p.messages) and said in p.messages[-1].text) == is_refused


@pytest.mark.parametrize(("pitch", "status"), [(1.5696, OK), (-1.5696, OK), (1.5699, ERROR), (-1.5699, ERROR)])
def test_a_motion_may_pitch_to_just_short_of_90_degrees(fmu: Fmu, pitch: float, status: int) -> None:
    """Expected: 1e-3 rad short of π/2 = 1.57080, as an importer's states and as start values."""
    with plant(fmu) as p:
        assert (refused(p.set, "orientation", [0.1, pitch, 0.2]) == OK) == (status == OK)


INERTIAS: list[tuple[Any, str | None]] = [
    ([[5, 1, 0], [0, 5, 0], [0, 0, 10]], "[1,2] = 1 but [2,1] = 0 kg.m2"),
    ([[5, 0, 0.5], [0, 5, 0], [0.25, 0, 10]], "[1,3] = 0.5 but [3,1] = 0.25 kg.m2"),
    ([[5, 0, 0], [0, 5, 0], [0, -0.5, 10]], "[2,3] = 0 but [3,2] = -0.5 kg.m2"),
    ([[5, 1, 0], [1 + 1e-9, 5, 0], [0, 0, 10]], None),
    ([[5, 1, 0], [1 + 2e-8, 5, 0], [0, 0, 10]], "not symmetric"),
    (np.zeros((3, 3)), "not positive definite"),
    (np.diag([-1.0, -1.0, 2.0]), "not positive definite"),
]


@pytest.mark.parametrize(("inertia", "expected"), INERTIAS)
def test_messages_about_an_inertia_name_its_elements(fmu: Fmu, inertia: Any, expected: str | None) -> None:
    with plant(fmu) as p:
        status = refused(p.start, start_of(uneven_case()) | {"platform_inertia": inertia})
        assert status == (ERROR if expected else OK)
        assert expected is None or expected in p.messages[-1].text


def turned(moments: list[float], seed: int) -> NDArray[np.float64]:
    """An inertia with these principal moments about axes of no special direction."""
    axes, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    J = axes @ np.diag(moments) @ axes.T
    return np.asarray((J + J.T) / 2)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("size", [1e-6, 1.0, 1e5])
@pytest.mark.parametrize(
    ("moments", "expected"),
    [
        ([1.0, 2.0, 2.99], None),
        ([1.0, 2.0, 3.01], "triangle"),
        ([0.001, 1.0, 1.0005], None),
        ([-0.001, 1.0, 1.0], "not positive definite"),
        ([-1.0, -2.0, 3.0], "not positive definite"),
    ],
)
def test_principal_moments_decide_whatever_their_axes(
    fmu2: Fmu, moments: list[float], expected: str | None, size: float, seed: int
) -> None:
    """Expected: all above 0, none above the sum of the others."""
    with plant(fmu2) as p:
        status = refused(p.start, start_of(uneven_case()) | {"platform_inertia": size * turned(moments, seed)})
        assert status == (ERROR if expected else OK)
        assert expected is None or expected in p.messages[-1].text


@pytest.mark.parametrize(("one", "other"), [(0, 5), (1, 3), (4, 2)])
@pytest.mark.parametrize("name", ["base_points", "platform_points"])
def test_joints_in_one_place_are_named(fmu: Fmu, name: str, one: int, other: int) -> None:
    """Expected: closer than a millionth of the largest distance between two is one place."""
    for share, is_refused in ((0.5, True), (2.0, False)):
        points = getattr(UNEVEN, name).copy()
        points[other] = points[one]
        widest = max(np.linalg.norm(a - b) for a in points for b in points)
        points[other] += share * 1e-6 * widest * np.array([0.6, 0.0, -0.8])
        with plant(fmu) as p:
            status = refused(p.start, start_of(uneven_case()) | {name: points})
            low, high = sorted((one + 1, other + 1))
            coincide = bool(p.messages) and f"{name}: joints {low} and {high} coincide" in p.messages[-1].text
            assert coincide == is_refused
            assert status == (ERROR if is_refused else OK)


@pytest.mark.parametrize(("name", "part"), [("leg_lower_com", "lower"), ("leg_upper_com", "upper")])
def test_a_centre_of_mass_lies_on_the_shortest_leg_of_the_start(fmu: Fmu, name: str, part: str) -> None:
    """Expected: the shortest home leg."""
    shortest = float(leg_geometry(UNEVEN, STATE.position, STATE.orientation).length.min())
    for share, status in ((0.999, OK), (1.001, ERROR)):
        with plant(fmu) as p:
            assert refused(p.start, start_of(uneven_case()) | {name: share * shortest}) == status
            if status == ERROR:
                message = p.messages[-1].text
                assert f"leg_{part}_com is {share * shortest:g} m; expected at most" in message
                assert f"the shortest leg length at the start, {shortest:g} m" in message
