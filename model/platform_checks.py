"""Validation of platforms: every check has its own message (value, expectation, remedy); parameters given per leg.

Conditions broadcast over leading axes, so that they hold for one platform and for a batch; messages are of one.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.model.errors import PlatformError
from gough_stewart.model.kinematics import LegGeometry, conditioning_of_legs, leg_geometry
from gough_stewart.model.parameters import FACTOR_OF, TABLE, PlatformFields
from gough_stewart.model.pose_limits import LARGEST_PITCH, SINGULAR_CONDITION_NUMBER
from gough_stewart.model.vectors import Array, FloatArray, dot, real_array, transpose

# Relative tolerance of symmetry and of the triangle inequality, for rounded published inertias.
INERTIA_SLACK = 1e-9
# Joints closer than this fraction of the largest joint distance coincide.
COINCIDENCE = 1e-6
# A longer presliding distance is that of a soft leg, not of stiction: the unit is wrong [m].
LONGEST_PRESLIDING = 1e-3
# Below 1, since the bristle needs a range over which it begins to slide.
LARGEST_SHARE = 0.99
# By which a leg's spring may be stretched at the start, over the leg's length: more is a pose without its motors.
LARGEST_STRETCH = 0.01
# Slower than the mode of a platform on its legs can be [Hz].
SLOWEST_MODE = 1.0
_GEOMETRY = {"base_points", "platform_points", "home_position", "home_orientation"}
_BOUNDED = [name for name, row in TABLE.items() if row.lower_bound is not None]

# The legs in the home pose, evaluated if a check needs them.
_Home = Callable[[], LegGeometry]
# Whether a condition is violated (...), the name of the parameter, and what is wrong with that of a single platform.
_Conditions = Iterator[tuple[Any, str, Callable[[], str]]]


def check(platform: PlatformFields, changed: Collection[str] = TABLE) -> None:
    """Raise `PlatformError` for the first invalid parameter, or combination with one of those that have changed."""
    for name in _BOUNDED:
        value = getattr(platform, name) if name in changed else None
        if value is not None:
            check_bound(name, value)
    for is_violated, field, text in _conditions(platform, changed):
        if is_violated:
            raise PlatformError(field, text())


def doubtful(platforms: PlatformFields, changed: Collection[str]) -> NDArray[np.bool_]:
    """Which of N platforms (N,) `check` may refuse, from fields with a leading axis; a limit that one lacks is NaN."""
    wrong: list[NDArray[np.bool_]] = [np.zeros(len(platforms.base_points), dtype=bool)]
    for name in _BOUNDED:
        value = getattr(platforms, name) if name in changed else None
        if value is not None:
            wrong.append(np.asarray(_beyond_bound(name, value.reshape(len(value), -1)).any(axis=-1)))
    with np.errstate(all="ignore"):
        wrong += [np.asarray(is_violated) for is_violated, _, _ in _conditions(platforms, changed)]
    return np.asarray(np.logical_or.reduce(wrong))


def check_bound(name: str, value: float | FloatArray) -> None:
    """Raise `PlatformError` for the first number of a parameter that violates its bound in the table."""
    row = TABLE[name]
    if type(value) is float and value > 0:  # the usual case, a shortcut
        return
    numbers = np.ravel(value)
    for k in np.flatnonzero(_beyond_bound(name, numbers)).tolist():
        remedy = ", or leave it out" if row.is_optional else ""
        which = f"{name}[{k + 1}]" if numbers.size > 1 else name
        unit = "" if row.unit == "1" else f" {row.unit}"
        raise PlatformError(which, f"is {numbers[k]:g}{unit}; expected {row.lower_bound}{remedy}: {row.description}")


def check_leg_com_offsets(platform: PlatformFields, shortest: float, pose: str) -> None:
    """The centres of mass of both parts are on the leg, also on the shortest one [m] of a pose."""
    for is_violated, field, text in _leg_com_offsets(platform, shortest, pose):
        if is_violated:
            raise PlatformError(field, text())


def by_leg(values: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters by name, with six values of a parameter replaced by their mean and six factors.

    `leg_viscous_friction` = (c_1 … c_6) becomes c = Σ c_i / 6 and `leg_viscous_friction_factor` = c_i / c. The
    parameter stays a scalar: in a batch, six values would be ambiguous between six platforms and six legs. All other
    values are unchanged.

    Raises
    ------
    PlatformError
        Six values together with factors, or a value below the bound of the table.
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
        mean = float(six.mean()) if np.ptp(six) > 0 else float(six[0])
        spread |= {name: mean, factor: six / mean if mean > 0 else np.ones(6)}
    return spread


def _beyond_bound(name: str, numbers: FloatArray) -> NDArray[np.bool_]:
    within = numbers > 0 if TABLE[name].lower_bound == "> 0" else numbers >= 0
    return np.asarray(~within)


def _conditions(platform: PlatformFields, changed: Collection[str]) -> _Conditions:
    """The conditions that concern one of these parameters, in the order in which they are reported."""
    home = cache(lambda: leg_geometry(platform, platform.home_position, platform.home_orientation))
    for conditions, names in _CHECKS:
        if not names.isdisjoint(changed):
            yield from conditions(platform, home)


def _inertia(platform: PlatformFields, _home: _Home) -> _Conditions:
    """The platform's inertia is symmetric, positive definite and satisfies the triangle inequality."""
    J, field = platform.platform_inertia, "platform_inertia"
    asymmetry = np.abs(J - transpose(J))

    def not_symmetric() -> str:
        a, b = (int(i) for i in np.unravel_index(asymmetry.argmax(), (3, 3)))
        return (
            f"is not symmetric: [{a + 1},{b + 1}] = {J[a, b]:g} but [{b + 1},{a + 1}] = {J[b, a]:g} kg m²; set both to "
            "the same value (minus the product of inertia)"
        )

    yield asymmetry.max(axis=(-2, -1)) > INERTIA_SLACK * np.abs(J).max(axis=(-2, -1)), field, not_symmetric
    moments = np.linalg.eigvalsh(J)
    least, middle, most = np.moveaxis(moments, -1, 0)
    yield (
        ~np.greater(least, 0),
        field,
        lambda: f"is not positive definite: principal moments {_list(moments)} kg m²; expected all > 0",
    )
    yield (
        most > (least + middle) * (1 + INERTIA_SLACK),
        field,
        lambda: (
            f"is unphysical: principal moments {_list(moments)} kg m², the largest exceeds the sum of the others "
            "(triangle inequality); check the units and that they are about the centre of mass"
        ),
    )


def _joints(platform: PlatformFields, _home: _Home) -> _Conditions:
    """No two joints of base or platform coincide."""
    for field in ("base_points", "platform_points"):
        points = getattr(platform, field)
        distance = np.linalg.norm(points[..., :, None, :] - points[..., None, :, :], axis=-1)
        apart = distance + np.diag(np.full(6, np.inf))

        def coincide(points: FloatArray = points, apart: FloatArray = apart) -> str:
            i, j = divmod(int(apart.argmin()), 6)
            return (
                f"joints {i + 1} and {j + 1} coincide at {_list(points[i])} m; expected six different points "
                "(an idealised double joint needs a small offset)"
            )

        yield apart.min(axis=(-2, -1)) <= COINCIDENCE * distance.max(axis=(-2, -1)), field, coincide


def _home_pose(platform: PlatformFields, home: _Home) -> _Conditions:
    """The home pose has legs of nonzero length, a pitch below 90° and a regular leg Jacobian."""
    pitch = platform.home_orientation[..., 1]
    yield (
        ~np.less(np.abs(pitch), LARGEST_PITCH),
        "home_orientation",
        lambda: f"has pitch {pitch:g} rad; expected less than ±90°",
    )
    lengths = home().length
    yield (
        lengths.min(axis=-1) <= COINCIDENCE * np.abs(platform.base_points).max(axis=(-2, -1)),
        "home_position",
        lambda: (
            f"base joint and platform joint {int(lengths.argmin()) + 1} coincide in the home pose; raise home_position"
        ),
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        number = conditioning_of_legs(home()).condition_number
    yield (
        ~np.less(number, SINGULAR_CONDITION_NUMBER),
        "base_points, platform_points, home_position, home_orientation",
        lambda: (
            f"the leg Jacobian is singular at the home pose (condition number {number:.3g}, expected below "
            f"{SINGULAR_CONDITION_NUMBER:g}): the legs cannot hold the platform there; choose different azimuths for "
            "base and platform joints or another home pose"
        ),
    )


def _com_offsets(platform: PlatformFields, home: _Home) -> _Conditions:
    """Centres of mass are on the legs and near the platform."""
    yield from _leg_com_offsets(platform, home().length.min(axis=-1), "home")
    reach = np.sqrt(dot(platform.platform_points, platform.platform_points)).max(axis=-1)
    offset = np.sqrt(dot(platform.platform_com, platform.platform_com))
    yield (
        offset > 10 * reach,
        "platform_com",
        lambda: f"is {offset:g} m from Op, more than ten times the farthest platform joint ({reach:g} m); check units",
    )


def _leg_com_offsets(platform: PlatformFields, shortest: Any, pose: str) -> _Conditions:
    for field, end in (("leg_lower_com", "base"), ("leg_upper_com", "platform")):
        value = getattr(platform, field)

        def beyond(end: str = end, value: Any = value) -> str:
            return (
                f"is {value:g} m from the {end} joint; expected between 0 and the shortest leg of the {pose} pose, "
                f"{shortest:g} m"
            )

        yield value > shortest, field, beyond  # never below 0, by its bound


def _limits(platform: PlatformFields, home: _Home) -> _Conditions:
    """The home pose is within the stroke and joint limits."""
    low, high, angle = platform.leg_length_min, platform.leg_length_max, platform.joint_angle_max
    shortest, longest = home().length.min(axis=-1), home().length.max(axis=-1)
    least, most, joints = "leg_length_min", "leg_length_max", "joint_angle_max"
    if low is not None and high is not None:
        yield ~np.less(low, high), least, lambda: f"is {low:g} m; expected below leg_length_max = {high:g} m"
    if low is not None:
        yield shortest < low, least, lambda: f"is {low:g} m, but a home leg is {shortest:g} m long"
    if high is not None:
        yield longest > high, most, lambda: f"is {high:g} m, but a home leg is {longest:g} m long"
    if angle is not None:
        yield angle > np.pi, joints, lambda: f"is {angle:g} rad; expected at most π (radians, not degrees)"


def _friction(platform: PlatformFields, _home: _Home) -> _Conditions:
    """The law of friction is one that exists, static friction at least Coulomb's, and a bristle is short."""
    model, coulomb = np.asarray(platform.leg_friction_model), np.asarray(platform.leg_coulomb_friction)
    static, stiffness = np.asarray(platform.leg_static_friction), np.asarray(platform.leg_bristle_stiffness)
    words, sticks = TABLE["leg_friction_model"].words, model != 0
    yield (
        ~np.isin(model, np.arange(len(words))),
        "leg_friction_model",
        lambda: f"is {model:g}; expected {', '.join(words)}",
    )
    yield (
        (static > 0) & (static < coulomb),
        "leg_static_friction",
        lambda: (
            f"is {static:g} N, below leg_coulomb_friction = {coulomb:g} N; expected at least that, or 0 for the same "
            "friction at rest as in motion"
        ),
    )
    least = coulomb * np.asarray(platform.leg_coulomb_friction_factor).min(axis=-1)
    yield (
        sticks & ~(least > 0),
        "leg_coulomb_friction",
        lambda: (
            f"is {least:g} N in a leg; friction that sticks needs > 0 in each: set leg_coulomb_friction, or "
            "leg_friction_model = 'smooth'"
        ),
    )
    distance = np.maximum(static, coulomb) / np.where(stiffness > 0, stiffness, np.inf)
    yield (
        sticks & (distance > LONGEST_PRESLIDING),
        "leg_bristle_stiffness",
        lambda: (
            f"is {stiffness:g} N/m: legs would stick over {distance:.3g} m before they slide; expected at most "
            f"{LONGEST_PRESLIDING:g} m, that is {np.maximum(static, coulomb) / LONGEST_PRESLIDING:g} N/m or more "
            "(real legs: 5 to 10 um), or 0 to derive it"
        ),
    )
    share = np.asarray(platform.leg_breakaway_share)
    yield (
        share > LARGEST_SHARE,
        "leg_breakaway_share",
        lambda: f"is {share:g}; expected at most {LARGEST_SHARE:g}, or 0 for the default",
    )


def _springs(platform: PlatformFields, _home: _Home) -> _Conditions:
    """Compliant legs have motors with inertia, and are no softer than a machine that stands."""
    stiffness, damping = np.asarray(platform.leg_stiffness), np.asarray(platform.leg_damping)
    yield (
        (stiffness > 0) & ~(np.asarray(platform.leg_armature) > 0),
        "leg_armature",
        lambda: (
            "is 0 kg; a leg with leg_stiffness needs a motor with inertia: set leg_armature = J (2 pi/lead)^2, or "
            "leg_stiffness = 0, which is rigid"
        ),
    )
    mass = np.asarray(platform.leg_upper_mass) + np.asarray(platform.platform_mass) / 6
    frequency = np.sqrt(stiffness / mass) / (2 * np.pi)
    yield (
        (stiffness > 0) & (frequency < SLOWEST_MODE),
        "leg_stiffness",
        lambda: (
            f"is {stiffness:g} N/m: the platform would bounce at about {frequency:.2g} Hz; expected "
            f"{(2 * np.pi * SLOWEST_MODE) ** 2 * mass:.3g} N/m ({SLOWEST_MODE:g} Hz) or more, or 0 for rigid legs"
        ),
    )
    yield (
        (damping > 0) & ~(stiffness > 0),
        "leg_damping",
        lambda: f"is {damping:g} N s/m, but legs are rigid; set leg_stiffness, or remove leg_damping",
    )


# What a check depends on; bounds come first.
_CHECKS: tuple[tuple[Callable[[PlatformFields, _Home], _Conditions], set[str]], ...] = (
    (_inertia, {"platform_inertia"}),
    (_joints, {"base_points", "platform_points"}),
    (_home_pose, _GEOMETRY),
    (_com_offsets, _GEOMETRY | {"leg_lower_com", "leg_upper_com", "platform_com"}),
    (_limits, _GEOMETRY | {"leg_length_min", "leg_length_max", "joint_angle_max"}),
    (
        _friction,
        {"leg_coulomb_friction", "leg_coulomb_friction_factor"}
        | {name for name, row in TABLE.items() if row.part == "bristles"},
    ),
    (_springs, {"leg_stiffness", "leg_damping", "leg_armature", "leg_upper_mass", "platform_mass"}),
)


def _list(values: Array) -> str:
    return "(" + ", ".join(f"{v:g}" for v in values) + ")"
