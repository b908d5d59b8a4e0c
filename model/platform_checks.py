"""Validation of platforms: every check has its own message (value, expectation, remedy); parameters given per leg.

Conditions broadcast over leading axes, so that they hold for one platform and for a batch; messages are of one.
"""

from collections.abc import Collection, Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.model.errors import PlatformError
from gough_stewart.model.friction import static_friction
from gough_stewart.model.kinematics import LARGEST_PITCH, SINGULAR_CONDITION_NUMBER, conditioning_of_legs, leg_geometry
from gough_stewart.model.parameters import FACTOR_OF, TABLE, Bound, Parameters, PlatformFields, of_legs
from gough_stewart.model.vectors import Array, FloatArray, real_array

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
        if refused(are_too_short(platform, home().length)):
            check_leg_com_offsets(platform, home().length, "home")
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


def are_too_short(parameters: Parameters, lengths: FloatArray) -> NDArray[np.bool_]:
    """Whether a leg of lengths (..., 6) [m] is shorter than the distance to a centre of mass of its parts (...)."""
    farthest = np.maximum(of_legs(parameters, "leg_lower_com"), of_legs(parameters, "leg_upper_com"))
    return np.asarray((farthest > lengths).any(axis=-1))


def check_leg_com_offsets(platform: PlatformFields, lengths: FloatArray, pose: str) -> None:
    """Raise `PlatformError` if a part's centre of mass is beyond its leg, of lengths (6,) [m] in a pose."""
    for field, end in (("leg_lower_com", "base"), ("leg_upper_com", "platform")):
        offsets = of_legs(platform, field)
        k = int(np.argmax(offsets - lengths))
        if offsets[k] > lengths[k]:
            leg = f"leg {k + 1} in the {pose} pose" if np.ptp(offsets) else f"the shortest leg of the {pose} pose"
            raise PlatformError(
                field, f"is {offsets[k]:g} m from the {end} joint; expected between 0 and {leg}, {lengths[k]:g} m"
            )


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
