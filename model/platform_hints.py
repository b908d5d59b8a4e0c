"""Likely mistakes in a platform: suspicious units, touching legs, wrong order of joints, active friction."""

from itertools import combinations, permutations
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.model.friction import law_of_bristles
from gough_stewart.model.interface import LUGRE, Variant
from gough_stewart.model.kinematics import conditioning_of_legs, leg_geometry
from gough_stewart.model.parameters import PlatformFields, of_legs
from gough_stewart.model.platform_checks import shared_joints
from gough_stewart.model.vectors import FloatArray, dot

# Mass of the platform over the cube of its joints' radius [kg/m³]: machines have 10 to 1e5, in mm a billionth of it.
_LEAST_DENSITY = 0.1
# Radius of gyration over the joints' radius: machines have 0.2 to 5. An inertia in kg mm² makes it a thousand times as
# large, in g mm² 30,000 times, beside a mass in g 30 and 1,000 times; a mass in g alone makes it 32 times as small.
_LEAST_RATIO, _MOST_RATIO = 0.06, 8.0
# The same of a leg's part over the leg's length, at most 1/2 for a rod.
_MOST_OF_LEG = 3.0
# More than the pull of any planet [m/s²].
_MOST_GRAVITY = 100.0
# Legs whose axes come closer than this fraction of the shorter one.
_CLOSEST = 0.05
# Another order is named if its condition number is this many times smaller.
_BETTER = 3.0
_PAIRS = np.array([*combinations(range(6), 2)])


def platform_hints(platform: PlatformFields) -> tuple[str, ...]:
    """One line for each thing that looks like a mistake."""
    base, mass, (i, j) = platform.base_points, platform.platform_mass, _PAIRS.T

    # lengths, inertias, mass and gravity as a CAD program writes them: in mm, kg mm² or g mm², g, and mm/s²
    points = platform.platform_points - platform.platform_points.mean(axis=0)
    radius, pull = float(np.linalg.norm(points, axis=1).mean()), float(np.linalg.norm(platform.gravity))
    length = float(leg_geometry(platform, platform.home_position, platform.home_orientation).length.mean())
    gyration = float(np.sqrt(np.linalg.eigvalsh(platform.platform_inertia)[-1] / mass))
    hints = [f"gravity is {pull:.4g} m/s2; expected about 9.81, or 0: is it in mm/s2?"] if pull > _MOST_GRAVITY else []
    is_in_mm = mass < _LEAST_DENSITY * radius**3
    if is_in_mm:
        joints = f"legs are {length:.4g} m long and joints {radius:.4g} m from the platform's middle"
        hints.append(f"{joints}, with a mass of {mass:.4g} kg: are lengths in mm? Expected m, and inertias in kg m2")
    elif not _LEAST_RATIO < gyration / radius < _MOST_RATIO:
        is_large = gyration > radius
        question = (
            "is it in kg mm2 or g mm2? Expected kg m2" if is_large else f"is a mass of {mass:.4g} in g? Expected kg"
        )
        hints.append(
            f"platform_inertia has a radius of gyration of {gyration:.4g} m, with joints {radius:.4g} m from the "
            f"platform's middle: {question}"
        )
    for part in ("lower", "upper"):
        part_mass, inertia = (float(getattr(platform, f"leg_{part}_{name}")) for name in ("mass", "inertia"))
        # with lengths in mm, radii of gyration would be compared in two units
        if not is_in_mm and inertia > part_mass * (_MOST_OF_LEG * length) ** 2:
            hints.append(
                f"leg_{part}_inertia is that of a rod longer than the legs, {length:.4g} m, with {part_mass:.4g} kg: "
                "is it in kg mm2 or g mm2? Expected kg m2"
            )

    # joints that legs share: exact in textbooks, while real joints have a size
    kinds = []
    for kind, joints_of_kind in (("base", base), ("platform", platform.platform_points)):
        pairs = ", ".join(f"{a + 1} and {b + 1}" for a, b in _PAIRS[shared_joints(joints_of_kind)[i, j]])
        if pairs:
            kinds.append(f"a {kind} joint (legs {pairs})")
    if kinds:
        hints.append(
            f"legs share {' and '.join(kinds)}; real joints need room: give each leg its own point, some joint "
            "diameters from the other, unless yours are compound joints; whether legs that share a joint collide is "
            "not looked at"
        )

    # the order of joints pairs those of base and platform, and a permuted list often still assembles: legs that nearly
    # touch at home, except where they share a joint
    remedy = "check the order of base_points and platform_points: joint i of one belongs to joint i of the other"
    orders = np.array(list(permutations(range(6))))
    joints_in_order: Any = SimpleNamespace(base_points=base, platform_points=platform.platform_points[orders])
    legs = leg_geometry(joints_in_order, platform.home_position, platform.home_orientation)
    meet = shared_joints(base)[i, j] | shared_joints(platform.platform_points)[orders[:, i], orders[:, j]]
    pair, share = _closest(base, base + legs.vector[0], meet[0])
    if share < _CLOSEST:
        hints.append(
            f"legs {pair[0] + 1} and {pair[1] + 1} come within {100 * share:.2g} % of their length of each other at "
            f"home, so real legs would collide; {remedy}"
        )

    # another order that conditions the legs far better, and keeps their distance and the stroke
    numbers = conditioning_of_legs(legs).condition_number
    low, high = of_legs(platform, "leg_length_min", 0.0), of_legs(platform, "leg_length_max", np.inf)
    fits = np.all((legs.length >= low) & (legs.length <= high), axis=-1)
    better = np.argsort(numbers, kind="stable")
    for k in better[_BETTER * numbers[better] <= numbers[0]]:
        if fits[k] and _closest(base, base + legs.vector[k], meet[k])[1] >= _CLOSEST:
            order = ", ".join(str(joint + 1) for joint in orders[k])
            hints.append(
                f"the leg Jacobian has a condition number of {numbers[0]:.3g} at home, and of {numbers[k]:.3g} with "
                f"the platform joints in the order {order}; {remedy}"
            )
            break

    # LuGre friction that is not passive, σ1 < σ2 F_c/(F_s − F_c), in the leg where that is most exceeded: N. Barahanov,
    # R. Ortega, "Necessary and sufficient conditions for passivity of the LuGre friction model", IEEE Trans. Automatic
    # Control 45(4), 2000
    if platform.leg_friction_model == LUGRE:
        law = law_of_bristles(Variant.of(platform), platform)
        excess = law.static - law.coulomb
        with np.errstate(divide="ignore", invalid="ignore"):
            bound = np.where(excess > 0, law.viscous * law.coulomb / excess, np.inf)
        if not (law.damping < bound).all():
            k = int(np.argmax(law.damping - bound))
            hints.append(
                f"LuGre friction is not passive: its bristles' damping is {law.damping[k]:.3g} N s/m, and passive is "
                f"below sigma2 F_c/(F_s - F_c) = {bound[k]:.3g} N s/m, so that it may drive a leg for a moment; lower "
                "leg_bristle_damping or leg_static_friction, or use leg_friction_model = 'elasto_plastic'"
            )
    return tuple(hints)


def _closest(base: FloatArray, tip: FloatArray, meet: NDArray[np.bool_]) -> tuple[FloatArray, float]:
    """The pair of legs, from base to tip (6, 3), that come nearest, and that distance over the length of the shorter.

    Pairs (15,) that meet in a shared joint are left out.
    The least |r + s d − t e| for s, t in [0, 1]: s of the common perpendicular, clipped, then t for it, then s for t.
    """
    i, j = _PAIRS.T
    d, e, r = (tip - base)[i], (tip - base)[j], base[i] - base[j]
    dd, de, ee, dr, er = dot(d, d), dot(d, e), dot(e, e), dot(d, r), dot(e, r)
    with np.errstate(divide="ignore", invalid="ignore"):  # parallel legs have no single foot
        s = np.clip(np.nan_to_num((de * er - dr * ee) / (dd * ee - de * de)), 0.0, 1.0)
    t = np.clip((de * s + er) / ee, 0.0, 1.0)
    s = np.clip((de * t - dr) / dd, 0.0, 1.0)
    shares = np.linalg.norm(r + s[:, None] * d - t[:, None] * e, axis=-1) / np.sqrt(np.minimum(dd, ee))
    shares = np.where(meet, np.inf, shares)
    k = int(shares.argmin())
    return _PAIRS[k], float(shares[k])
