"""What looks like a mistake: numbers of CAD programs in mm, g, kg mm², g mm², mm/s²; joints in the wrong order."""

from dataclasses import replace
from functools import cache
from itertools import combinations, permutations
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq, lsq_linear
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from gough_stewart import leg_geometry
from tests.support.lagrangian import FloatArray
from tests.support.nano import HEAVY, NANO
from tests.support.real_platforms import real_platform
from tests.support.shared_joints import THREE_THREE
from tests.support.uneven import UNEVEN

MACHINES = {name: gs.load_preset(name) for name in ("liu2000", "motion_base", "motion_base_screws", "desktop_hexapod")}
MACHINES |= {"nano": NANO, "heavy": HEAVY}
# What the exponent of each unit is multiplied by: lengths, masses, inertias, gravity.
_UNITS: dict[str, tuple[float, float, float, float, str]] = {
    "inertia in kg mm²": (1, 1, 1e6, 1, "in kg mm2 or g mm2"),
    "inertia in g mm²": (1, 1, 1e9, 1, "in kg mm2 or g mm2"),
    "mass in g, inertia in g mm²": (1, 1e3, 1e9, 1, "in kg mm2 or g mm2"),
    "mass in g, inertia in kg mm²": (1, 1e3, 1e6, 1, "in kg mm2 or g mm2"),
    "mass in g": (1, 1e3, 1, 1, "in g?"),
    "gravity in mm/s²": (1, 1, 1, 1e3, "in mm/s2"),
    "lengths in mm": (1e3, 1, 1, 1, "lengths in mm"),
    "lengths in mm, inertia in kg mm²": (1e3, 1, 1e6, 1, "lengths in mm"),
    "mm and g": (1e3, 1e3, 1e9, 1, "lengths in mm"),
}
_LENGTHS = ("base_points", "platform_points", "platform_com", "home_position", "leg_lower_com", "leg_upper_com")
_LIMITS = ("leg_length_min", "leg_length_max")


def in_units(platform: gs.Platform, length: float, mass: float, inertia: float, gravity: float) -> gs.Platform:
    """A platform with the numbers of other units."""
    values: dict[str, Any] = platform.as_dict()
    factors = dict.fromkeys((*_LENGTHS, *_LIMITS), length)
    factors |= dict.fromkeys(("platform_mass", "leg_lower_mass", "leg_upper_mass"), mass)
    factors |= dict.fromkeys(("platform_inertia", "leg_lower_inertia", "leg_upper_inertia"), inertia)
    factors["gravity"] = gravity
    changed = {name: values[name] * factor for name, factor in factors.items() if name in values}
    return gs.Platform(**{**values, **changed})


@pytest.mark.parametrize("units", _UNITS)
@pytest.mark.parametrize("machine", MACHINES)
def test_units_of_cad_programs_are_hinted_at(machine: str, units: str) -> None:
    """Expected: a hint that names the unit, for machines from 0.4 kg to 50 t."""
    *factors, said = _UNITS[units]
    assert any(said in hint for hint in in_units(MACHINES[machine], *factors).hints)


@pytest.mark.parametrize("machine", MACHINES)
def test_real_machines_have_no_such_hint(machine: str) -> None:
    """Expected: none; nor of one in space, with a load far above its joints, or with its mass in its middle."""
    platform = MACHINES[machine]
    radius, mass = float(np.linalg.norm(platform.platform_points, axis=1).mean()), platform.platform_mass
    tall, dense = (mass * (share * radius) ** 2 * np.diag([1.0, 1.0, 0.9]) for share in (4.0, 0.1))
    for changed in ({}, {"gravity": [0, 0, 0]}, {"platform_inertia": tall}, {"platform_inertia": dense}):
        assert platform.with_parameters(changed).hints == ()


def test_an_inertia_of_a_leg_alone_is_hinted_at() -> None:
    """Expected: kg mm² of one part of a leg, by its name; legs without inertia of their own are sound."""
    for part in ("lower", "upper"):
        name = f"leg_{part}_inertia"
        (hint,) = UNEVEN.with_parameters({name: 1e6 * getattr(UNEVEN, name)}).hints
        assert hint.startswith(name)
        assert UNEVEN.with_parameters({name: 0.0}).hints == ()


def test_hints_have_the_numbers_that_look_wrong() -> None:
    """Expected: by hand, of 1216.9 kg with √0.5 m of gyration on legs of 3.154 m; joints that legs share, by number."""
    for units, k, text in (
        ("inertia in kg mm²", 0, "platform_inertia has a radius of gyration of 707.1 m, with joints 1 m from the pla"),
        ("inertia in kg mm²", 1, "leg_lower_inertia is that of a rod longer than the legs, 3.154 m, with 92.1 kg: is "),
        ("mass in g", 0, "platform_inertia has a radius of gyration of 0.02236 m, with joints 1 m from the platform's "
                         "middle: is a mass of 1.217e+06 in g?"),
        ("gravity in mm/s²", 0, "gravity is 9810 m/s2; expected about 9.81, or 0: is it in mm/s2?"),
        ("lengths in mm", 0, "legs are 3154 m long and joints 1000 m from the platform's middle, with a mass of 1217 "),
    ):  # fmt: skip
        assert in_units(MACHINES["motion_base"], *_UNITS[units][:4]).hints[k].startswith(text)
    pairs = "a base joint (legs 1 and 2, 3 and 4, 5 and 6) and a platform joint (legs 1 and 4, 2 and 5, 3 and 6)"
    assert THREE_THREE.hints[0].startswith(f"legs share {pairs}; real joints need room")
    assert not any("come within" in hint for hint in THREE_THREE.hints)


def test_lugre_friction_that_is_not_passive_is_said() -> None:
    """Expected: σ1 < σ2 F_c/(F_s − F_c), by hand, with 4 N s/m · 20 N / 5 N = 16 N s/m."""
    one: dict[str, Any] = {
        "leg_viscous_friction": 4.0,
        "leg_viscous_friction_factor": np.ones(6),
        "leg_coulomb_friction": 20.0,
        "leg_coulomb_friction_factor": np.ones(6),
        "leg_static_friction": 25.0,
    }
    said = real_platform("lugre", **one, leg_bristle_damping=[15.9, 16.1, 15.9, 16.3, 16.2, 15.9]).hints[-1]
    assert "damping is 16.3 N s/m, and passive is below sigma2 F_c/(F_s - F_c) = 16 N s/m" in said
    assert not any("passive" in each for each in real_platform("lugre", **one, leg_bristle_damping=15.9).hints)
    assert not any("passive" in each for each in real_platform("elasto_plastic", **one).hints)


def _crossing(share: float, leg: int, aim: FloatArray) -> gs.Platform:
    """The uneven platform with the tip of leg 4 or 5 moved until it is from the other at a share of the shorter one."""
    base, home = UNEVEN.base_points, UNEVEN.home_position

    def moved(t: float) -> FloatArray:
        points = UNEVEN.platform_points.copy()
        points[leg] = R.inv().apply(TIPS[leg] + t * (aim - TIPS[leg]) - home)
        return points

    def gap(t: float) -> float:
        return _measured(base, home + R.apply(moved(t)), 3, 4) - share

    grid = np.linspace(0, 1, 80)
    k = next(k for k in range(1, 80) if gap(grid[k]) < 0)
    points = moved(brentq(gap, grid[k - 1], grid[k], xtol=1e-7))
    return replace(UNEVEN, platform_points=points, leg_length_min=None, leg_length_max=None)


def _measured(base: FloatArray, tip: FloatArray, i: int, j: int) -> float:
    """The least distance of two legs as a share of the shorter, by SciPy's bounded least squares."""
    d, e, r = tip[i] - base[i], tip[j] - base[j], base[j] - base[i]
    found = lsq_linear(np.stack([d, -e], axis=1), r, (0, 1), tol=1e-14)
    return float(np.sqrt(2 * found.cost) / min(np.linalg.norm(d), np.linalg.norm(e)))


R = Rotation.from_euler("xyz", UNEVEN.home_orientation)
TIPS = UNEVEN.home_position + R.apply(UNEVEN.platform_points.copy())
# Past the tip of the other leg, so that they cross, or to a point of it, from which the tip itself is nearest.
AIMS = [(3, TIPS[4] + [-0.8, 0, 0]), *((leg, (0.4 * UNEVEN.base_points + 0.6 * TIPS)[7 - leg]) for leg in (3, 4))]


@pytest.mark.parametrize(("leg", "aim"), AIMS)
def test_legs_that_nearly_touch_are_named_with_their_distance_from_5_percent_on(leg: int, aim: FloatArray) -> None:
    """Expected: the distance by another method, the numbers of the legs; nothing from just above 5 % on."""
    (first, *_) = _crossing(0.031, leg, aim).hints
    assert first == (
        "legs 4 and 5 come within 3.1 % of their length of each other at home, so real legs would collide; check the "
        "order of base_points and platform_points: joint i of one belongs to joint i of the other"
    )
    for share, is_hinted in ((0.0495, True), (0.0505, False)):
        hints = _crossing(share, leg, aim).hints
        assert any(hint.startswith("legs 4 and 5") for hint in hints) == is_hinted


def test_a_better_order_is_named_only_if_its_legs_fit_and_keep_their_distance() -> None:
    """Expected: the best of all orders by a search with NumPy's condition number, SciPy's distances and the stroke."""
    order = [1, 0, 3, 4, 5, 2]
    exchanged = replace(UNEVEN, platform_points=UNEVEN.platform_points[order], leg_length_min=None, leg_length_max=None)
    base, home = exchanged.base_points, exchanged.home_position
    orders = np.array(list(permutations(range(6))))
    arms = R.apply(exchanged.platform_points.copy())[orders]
    l = home + arms - base
    L = np.linalg.norm(l, axis=-1)
    u, rho = l / L[..., None], np.sqrt((arms[0] ** 2).sum() / 6)
    numbers = np.linalg.cond(np.concatenate([u, np.cross(arms, u) / rho], axis=-1))

    @cache
    def closest(k: int) -> float:
        return min(_measured(base, home + arms[k], *pair) for pair in combinations(range(6), 2))

    def searched(low: float, high: float) -> tuple[float, str]:
        """The least condition number of an order that fits, and its numbers of joints."""
        for k in np.argsort(numbers):
            fits = low <= L[k].min() and L[k].max() <= high
            if fits and closest(k) >= 0.05:
                return float(numbers[k]), ", ".join(str(j + 1) for j in orders[k])
        raise AssertionError("no order fits")

    now = gs.evaluate_poses(exchanged, home, exchanged.home_orientation).condition_number
    own = leg_geometry(exchanged, home, exchanged.home_orientation).length
    seen = set()
    for low, high in ((None, None), (None, float(own.max()) * 1.001), (float(own.min()) * 0.999, None)):
        platform = replace(exchanged, leg_length_min=low, leg_length_max=high)
        number, best = searched(low or 0.0, high or np.inf)
        seen.add(best)
        assert [hint for hint in platform.hints if "in the order" in hint] == [
            f"the leg Jacobian has a condition number of {now:.3g} at home, and of {number:.3g} with the platform "
            f"joints in the order {best}; check the order of base_points and platform_points: joint i of one belongs "
            "to joint i of the other"
        ]
    assert len(seen) == 3
