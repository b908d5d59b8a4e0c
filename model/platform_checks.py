"""What is impossible in a platform, and what is hardly meant; and parameters given per leg.

Every check has its own message (value, expectation, remedy). Its conditions broadcast over leading axes, so that they
hold for one platform and for a batch; messages are of one. Hints are of suspicious units, touching legs, a wrong order
of joints, and friction that is not passive.
"""

from collections.abc import Collection, Mapping
from functools import cache
from itertools import combinations, permutations
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.model.errors import PlatformError
from gough_stewart.model.friction import law_of_bristles, static_friction
from gough_stewart.model.interface import LUGRE, Variant
from gough_stewart.model.kinematics import LARGEST_PITCH, SINGULAR_CONDITION_NUMBER, conditioning_of_legs, leg_geometry
from gough_stewart.model.parameters import FACTOR_OF, TABLE, Bound, Parameters, PlatformFields, of_legs
from gough_stewart.model.vectors import Array, FloatArray, dot, real_array

# Relative tolerance of symmetry and of the triangle inequality, for rounded published inertias.
INERTIA_SLACK = 1e-9
# Joints closer than this fraction of the largest joint distance are one joint.
COINCIDENCE = 1e-6
# A longer presliding distance is that of a soft leg, not of stiction: the unit is wrong [m].
LONGEST_PRESLIDING = 1e-3
# Below 1, since the bristle needs a range over which it begins to slide.
LARGEST_SHARE = 0.99
# By which a leg's spring may be stretched at the start, over the leg's length: more is a pose without its motors.
LARGEST_STRETCH = 0.01
# Slower than the mode of a platform on its legs can be [Hz].
SLOWEST_MODE = 1.0
_WITHIN: Mapping[Bound, np.ufunc] = {"> 0": np.greater, ">= 0": np.greater_equal}
_GEOMETRY = ("base_points", "platform_points", "home_position", "home_orientation")
_OF_BRISTLES = [name for name, row in TABLE.items() if row.part == "bristles"]
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


@np.errstate(all="ignore")
def check(platform: PlatformFields, changed: Collection[str] = TABLE) -> NDArray[np.bool_]:  # noqa: PLR0912, PLR0915
    """Raise `PlatformError` for the first invalid parameter, or combination with one of those that have changed.

    From the fields of N platforms, with a leading axis, it raises none, and returns which of them (N,) it may refuse
    one by one; a limit that one of them lacks is NaN.
    """
    wrong, leg, concerned = np.zeros(np.shape(platform.platform_mass), dtype=bool), 0, set(changed)
    concerned |= {name for name, factor in FACTOR_OF.items() if factor in concerned}

    def refused(is_wrong: Any) -> bool:
        """Note what is wrong of platforms (...), or of their legs (..., 6); of one, whether it is, and in which leg."""
        nonlocal wrong, leg
        if np.ndim(is_wrong) > wrong.ndim:
            leg, is_wrong = int(np.argmax(is_wrong)), is_wrong.any(axis=-1)
        wrong = wrong | is_wrong
        return wrong.ndim == 0 and bool(wrong)

    for name, row in TABLE.items():
        value = getattr(platform, name) if row.lower_bound and name in changed else None
        if value is not None and refused(~_WITHIN[row.lower_bound](value, 0)):
            check_bound(name, value)

    if "platform_inertia" in concerned:
        J, field = platform.platform_inertia, "platform_inertia"
        asymmetry = np.abs(J - J.mT)
        if refused(asymmetry.max(axis=(-2, -1)) > INERTIA_SLACK * np.abs(J).max(axis=(-2, -1))):
            a, b = divmod(int(asymmetry.argmax()), 3)
            elements = f"[{a + 1},{b + 1}] = {J[a, b]:g} but [{b + 1},{a + 1}] = {J[b, a]:g} kg m²"
            raise PlatformError(
                field, f"is not symmetric: {elements}; set both to the same value (minus the product of inertia)"
            )
        moments = np.linalg.eigvalsh(J)
        least, middle, most = np.moveaxis(moments, -1, 0)
        if refused(~(least > 0)):
            text = f"is not positive definite: principal moments {_list(moments)} kg m²; expected all > 0"
            raise PlatformError(field, text)
        if refused(most > (least + middle) * (1 + INERTIA_SLACK)):
            raise PlatformError(
                field,
                f"is unphysical: principal moments {_list(moments)} kg m², the largest exceeds the sum of the others "
                "(triangle inequality); check the units and that they are about the centre of mass",
            )

    base, tips = platform.base_points, platform.platform_points
    if concerned & {"base_points", "platform_points"}:
        is_same = shared_joints(base) & shared_joints(tips)
        if refused(is_same.any(axis=(-2, -1))):
            i, j = divmod(int(is_same.argmax()), 6)
            raise PlatformError(
                "base_points, platform_points",
                f"legs {i + 1} and {j + 1} share both joints, at {_list(base[i])} m and {_list(tips[i])} m; expected "
                "at most one of the two, so that no two legs are one",
            )

    home = cache(lambda: leg_geometry(platform, platform.home_position, platform.home_orientation))
    if concerned & {*_GEOMETRY}:
        pitch, lengths = platform.home_orientation[..., 1], home().length
        if refused(~(np.abs(pitch) < LARGEST_PITCH)):
            raise PlatformError("home_orientation", f"has pitch {pitch:g} rad; expected less than ±90°")
        if refused(lengths.min(axis=-1) <= COINCIDENCE * np.abs(base).max(axis=(-2, -1))):
            which = f"base joint and platform joint {int(lengths.argmin()) + 1}"
            raise PlatformError("home_position", f"{which} coincide in the home pose; raise home_position")
        number = conditioning_of_legs(home()).condition_number
        if refused(~(number < SINGULAR_CONDITION_NUMBER)):
            raise PlatformError(
                ", ".join(_GEOMETRY),
                f"the leg Jacobian is singular at the home pose (condition number {number:.3g}, expected below "
                f"{SINGULAR_CONDITION_NUMBER:g}): the legs cannot hold the platform there; choose different azimuths "
                "for base and platform joints or another home pose",
            )

    if concerned & {*_GEOMETRY, "leg_lower_com", "leg_upper_com", "platform_com"}:
        refused(check_leg_com_offsets(platform, home().length, "home"))
        reach, offset = np.linalg.norm(tips, axis=-1).max(axis=-1), np.linalg.norm(platform.platform_com, axis=-1)
        if refused(offset > 10 * reach):
            far = f"more than ten times the farthest platform joint ({reach:g} m)"
            raise PlatformError("platform_com", f"is {offset:g} m from Op, {far}; check units")

    if concerned & {*_GEOMETRY, "leg_length_min", "leg_length_max", "joint_angle_max"}:
        lengths, angle = home().length, platform.joint_angle_max
        low, high = of_legs(platform, "leg_length_min", np.nan), of_legs(platform, "leg_length_max", np.nan)
        if refused(low >= high):
            text = f"is {low[leg]:g} m; expected below leg_length_max = {high[leg]:g} m"
            raise PlatformError("leg_length_min", text)
        for name, end, beyond in (("leg_length_min", low, low - lengths), ("leg_length_max", high, lengths - high)):
            if refused((beyond > 0).any(axis=-1)):
                k = int(beyond.argmax())
                raise PlatformError(name, f"is {end[k]:g} m, but a home leg is {lengths[k]:g} m long")
        if angle is not None and refused(np.greater(angle, np.pi)):
            raise PlatformError("joint_angle_max", f"is {angle:g} rad; expected at most π (radians, not degrees)")

    if concerned & {"leg_coulomb_friction", *_OF_BRISTLES}:
        model, words = np.asarray(platform.leg_friction_model), TABLE["leg_friction_model"].words
        if refused(~np.isin(model, np.arange(len(words)))):
            raise PlatformError("leg_friction_model", f"is {model:g}; expected {', '.join(words)}")
        sticks, static = (model != 0)[..., None], static_friction(platform)
        coulomb = of_legs(platform, "leg_coulomb_friction")
        if refused((static > 0) & (static < coulomb)):
            # without factors of its own, as it is stated
            is_by_leg = platform.leg_static_friction_factor.any()
            of_stated = 1.0 if is_by_leg else platform.leg_coulomb_friction_factor[leg]
            raise PlatformError(
                "leg_static_friction",
                f"is {static[leg] / of_stated:g} N, below leg_coulomb_friction = {coulomb[leg] / of_stated:g} N"
                f"{f' in leg {leg + 1}' if is_by_leg else ''}; expected at least that, or 0 for the same friction at "
                "rest as in motion",
            )
        if refused((sticks & ~(coulomb > 0)).any(axis=-1)):
            raise PlatformError(
                "leg_coulomb_friction",
                f"is {coulomb.min():g} N in a leg; stiction needs > 0 in each: set leg_coulomb_friction, "
                "or leg_friction_model = 'smooth'",
            )
        stiffness, share = of_legs(platform, "leg_bristle_stiffness"), of_legs(platform, "leg_breakaway_share")
        breakaway = np.maximum(static, coulomb)
        distance = breakaway / np.where(stiffness > 0, stiffness, np.inf)
        if refused(sticks & (distance > LONGEST_PRESLIDING)):
            raise PlatformError(
                "leg_bristle_stiffness",
                f"is {stiffness[leg]:g} N/m: legs would stick over {distance[leg]:.3g} m before they slide"
                f"{_where(distance, leg)}; expected at most {LONGEST_PRESLIDING:g} m, that is "
                f"{breakaway[leg] / LONGEST_PRESLIDING:g} N/m or more (real legs: 5 to 10 um), or 0 to derive it",
            )
        if refused(share > LARGEST_SHARE):
            expected = f"expected at most {LARGEST_SHARE:g}, or 0 for the default"
            raise PlatformError("leg_breakaway_share", f"is {share[leg]:g}{_where(share, leg)}; {expected}")

    if concerned & {"leg_stiffness", "leg_damping", "leg_armature", "leg_upper_mass", "platform_mass"}:
        is_elastic = (np.asarray(platform.leg_stiffness) > 0)[..., None]
        spring, damping = of_legs(platform, "leg_stiffness"), of_legs(platform, "leg_damping")
        mass = of_legs(platform, "leg_upper_mass") + np.asarray(platform.platform_mass)[..., None] / 6
        armature, frequency = of_legs(platform, "leg_armature"), np.sqrt(spring / mass) / (2 * np.pi)
        if refused(is_elastic & ~(armature > 0)):
            raise PlatformError(
                "leg_armature",
                f"is 0 kg{_where(armature, leg)}; a leg with leg_stiffness needs a motor with inertia: set "
                "leg_armature = J (2 pi/lead)^2, or leg_stiffness = 0, which is rigid",
            )
        if refused(is_elastic & (frequency < SLOWEST_MODE)):
            least = (2 * np.pi * SLOWEST_MODE) ** 2 * mass[leg]
            raise PlatformError(
                "leg_stiffness",
                f"is {spring[leg]:g} N/m{_where(frequency, leg)}: the platform would bounce at about "
                f"{frequency[leg]:.2g} Hz; expected {least:.3g} N/m ({SLOWEST_MODE:g} Hz) or more, or 0 for rigid legs",
            )
        if refused((damping > 0) & ~is_elastic):
            text = f"is {damping[leg]:g} N s/m, but legs are rigid; set leg_stiffness, or remove leg_damping"
            raise PlatformError("leg_damping", text)
    return wrong


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


def shared_joints(points: FloatArray) -> NDArray[np.bool_]:
    """Which pairs of joints (…, 6, 3) are one joint that two legs share (…, 6, 6); a joint is no pair with itself."""
    distance = np.linalg.norm(points[..., :, None, :] - points[..., None, :, :], axis=-1)
    return np.asarray((distance <= COINCIDENCE * distance.max(axis=(-2, -1), keepdims=True)) & ~np.eye(6, dtype=bool))


def check_bound(name: str, value: float | FloatArray) -> None:
    """Raise `PlatformError` for the first number of a parameter that violates its bound in the table."""
    row, numbers = TABLE[name], np.ravel(value)
    for k in np.flatnonzero(~_WITHIN[row.lower_bound](numbers, 0)).tolist():
        which = f"{name}[{k + 1}]" if numbers.size > 1 else name
        unit, remedy = "" if row.unit == "1" else f" {row.unit}", ", or leave it out" if row.default is None else ""
        raise PlatformError(which, f"is {numbers[k]:g}{unit}; expected {row.lower_bound}{remedy}: {row.description}")


def check_leg_com_offsets(parameters: Parameters, lengths: FloatArray, pose: str) -> NDArray[np.bool_]:
    """Raise `PlatformError` if a part's centre of mass is beyond its leg, of lengths (6,) [m] in a pose.

    Of N platforms, with lengths (N, 6), it raises none, and returns those (N,) of which it is.
    """
    are_beyond = np.zeros(lengths.shape[:-1], dtype=bool)
    for field, end in (("leg_lower_com", "base"), ("leg_upper_com", "platform")):
        offsets = of_legs(parameters, field)
        are_beyond = are_beyond | (offsets > lengths).any(axis=-1)
        if are_beyond.ndim == 0 and are_beyond:
            k = int(np.argmax(offsets - lengths))
            leg = f"leg {k + 1} in the {pose} pose" if np.ptp(offsets) else f"the shortest leg of the {pose} pose"
            raise PlatformError(
                field, f"is {offsets[k]:g} m from the {end} joint; expected between 0 and {leg}, {lengths[k]:g} m"
            )
    return are_beyond


def by_leg(values: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters by name, with six values of a parameter that has factors replaced by their mean and the factors.

    (c_1 … c_6) become c = Σ c_i / 6 and c_i / c: in a batch, six values might be those of six platforms. All other
    values are unchanged. `PlatformError` for six values beside factors, or a value below its bound.
    """
    spread = dict(values)
    for name, factor in FACTOR_OF.items():
        try:
            is_by_leg = name in values and np.shape(values[name]) == (6,)
        except ValueError:  # ragged, rejected later with all other parameters
            is_by_leg = False
        if not is_by_leg:
            continue
        if factor in values:
            raise PlatformError(
                name,
                f"has six values beside {factor}; expected only one of the two; `Platform.with_parameters` replaces "
                "the factors of a platform",
            )
        try:
            six = real_array(values[name], (6,))
        except ValueError as error:
            raise PlatformError(name, str(error)) from None
        check_bound(name, six)
        # equal values stay exact, without the rounding of a mean
        mean, without = float(six.mean()) if np.ptp(six) > 0 else float(six[0]), np.array(TABLE[factor].default)
        if mean > 0 and six.min() == 0 == without.max():  # a factor of 0 has another meaning
            raise PlatformError(name, f"is {six.tolist()}; expected six values > 0, or 0 for all legs")
        spread |= {name: mean, factor: six / mean if mean > 0 else without}
    return spread


def _where(values: FloatArray, leg: int) -> str:
    """Where a value of six is, for a message; nothing if all are the same."""
    return f" in leg {leg + 1}" if np.ptp(values) > 0 else ""


def _list(values: Array) -> str:
    return "(" + ", ".join(f"{v:g}" for v in values) + ")"
