"""Workspace analysis: reachability, conditioning, static load capacity and stiffness, at poses and on grids of them.

Functions of poses are NumPy only and broadcast over leading axes of poses.

With motors that hold, a compliant leg i is a spring k along its direction, so that a wrench w at Op moves the platform
by the small twist K⁻¹ w, K = Jᵀ k J. What gravity adds by turning the legs is left out: mg/L, a millionth of k.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from gough_stewart.model.dynamics import LARGEST_CONDITION_NUMBER, mass_matrix, platform_side, static_leg_forces
from gough_stewart.model.errors import PlatformError, WorkspaceError
from gough_stewart.model.interface import Variant
from gough_stewart.model.kinematics import (
    LARGEST_PITCH,
    LegGeometry,
    conditioning_of_legs,
    jacobian_of_legs,
    joint_angles,
    leg_geometry,
    side_of_singular_poses,
)
from gough_stewart.model.parameters import Parameters, of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation, nearest_angle
from gough_stewart.model.vectors import Array, FloatArray, apply

# Poses per chunk: enough for fast NumPy loops, with tens of MB of intermediate results.
CHUNK = 4096
# In the order of position and orientation, with their units.
COORDINATES: Mapping[str, str] = {"x": "m", "y": "m", "z": "m", "roll": "rad", "pitch": "rad", "yaw": "rad"}
LARGEST_ANGLES: Mapping[str, float] = {"roll": np.pi, "pitch": np.pi / 2, "yaw": np.pi}
# Default number of points per coordinate, for two and three swept coordinates.
POINTS = {2: 101, 3: 31}
# Larger results would give files that programs cannot open.
LARGEST_GRID = 250_000
# Ranges for unbounded platforms: about home, in characteristic lengths and in rad.
UNBOUNDED_LENGTH, UNBOUNDED_ANGLE = 1.0, np.pi / 2
# Search for a range: points per coordinate, and number of refinements.
_SEARCH, _ROUNDS = {2: 101, 3: 21}, 3
# Margin around the reachable region, as a fraction of its size on either side.
_BEYOND = 0.06
# A range is made symmetric if its parts on either side of home differ by less than this.
_NEARLY = 0.75

Range = tuple[float, float]


class Limit(IntEnum):
    """The limit that makes a pose unreachable; if there are several, the first in this order."""

    text: str  # description

    def __new__(cls, code: int, text: str = "") -> Self:
        """A member with its number and description."""
        limit = int.__new__(cls, code)
        limit._value_, limit.text = code, text
        return limit

    NONE = 0, "reachable"
    PITCH = 1, "pitch at ±90°"
    SINGULAR = 2, "beyond a singular pose"
    LEG_TOO_SHORT = 3, "a leg too short"
    LEG_TOO_LONG = 4, "a leg too long"
    BASE_JOINT = 5, "angle of a base joint"
    PLATFORM_JOINT = 6, "angle of a platform joint"


class PoseQualities(NamedTuple):
    """Results at poses, each (...); None if the platform does not state the limit, or has rigid legs."""

    limit: NDArray[np.int8]  # a `Limit`, 0 if the pose is reachable
    leg_length_margin: FloatArray | None  # of the leg nearest to an end of its stroke [m], negative beyond
    joint_angle_margin: FloatArray | None  # of the joint nearest to `joint_angle_max` [rad], negative beyond
    singular_margin: FloatArray  # smallest singular value of the scaled leg Jacobian, negative beyond a singular pose
    condition_number: FloatArray  # of the same; infinite at a singular pose
    payload: FloatArray | None  # largest point mass at Op that the actuators hold at rest [kg]
    force_margin: FloatArray | None  # largest force at Op in any direction that they hold at rest [N]
    largest_speed: FloatArray | None  # of the twist [v; ρ ω] in any direction, limited by `leg_velocity_max` [m/s]
    # of compliant legs, 0 at singular poses: force at Op over displacement along it, in the softest and the stiffest
    # direction [N/m], torque over rotation about it [N m/rad], lowest natural frequency with motors that hold [Hz]
    translational_stiffness: FloatArray | None
    translational_stiffness_max: FloatArray | None
    rotational_stiffness: FloatArray | None
    rotational_stiffness_max: FloatArray | None
    first_mode: FloatArray | None

    @property
    def reachable(self) -> NDArray[np.bool_]:
        """Whether the pose is within all limits."""
        return np.asarray(self.limit == Limit.NONE)


# Results of compliant legs.
STIFFNESS = PoseQualities._fields[-5:]


def evaluate_poses(
    platform: Platform, position: Array, orientation: Array, progress: Callable[[int], None] | None = None
) -> PoseQualities:
    """Reachability, conditioning and static load capacity at poses.

    A pose is reachable if all leg lengths are between `leg_length_min` and `leg_length_max`, no joint deviates more
    than `joint_angle_max` from its direction in the home pose, |pitch| is below 90°, and det J has the same sign as at
    home (otherwise every path from home passes a singular pose). Payload and force margin are static, for leg forces
    within ±`actuator_force_max`; they are 0 where the actuators cannot hold the platform, and at poses with a condition
    number of J above `LARGEST_CONDITION_NUMBER`. The largest speed is the s for which no leg exceeds
    V = `leg_velocity_max` in any direction of motion with √(|v|² + ρ² |ω|²) = s: s = min_i V/|row_i|, with the rows of
    the scaled leg Jacobian (by the Cauchy–Schwarz inequality). For translation alone it would be V at every pose.

    Parameters
    ----------
    platform
        The platform with its limits; limits that it does not state are not checked.
    position, orientation
        Poses (..., 3) [m], (..., 3) [rad]; leading axes broadcast.
    progress
        Called with the number of completed poses.

    Returns
    -------
    PoseQualities
        Arrays with the poses' leading axes, each None if the platform does not state its limit: `limit`, 0 if the
        pose is reachable; `leg_length_margin` [m] and `joint_angle_margin` [rad], negative beyond; `singular_margin`,
        the smallest singular value of the scaled leg Jacobian, negative beyond a singular pose; `condition_number`;
        `payload` [kg]; `force_margin` [N]; `largest_speed` [m/s]. Of elastic legs, whose motors hold: the stiffness
        at Op in the softest and the stiffest direction, `translational_stiffness` and `translational_stiffness_max`
        [N/m], `rotational_stiffness` and `rotational_stiffness_max` [N m/rad], and `first_mode`, the lowest natural
        frequency [Hz].

    Raises
    ------
    ArgumentError
        An argument of another type, shape or unit.
    WorkspaceError
        A pose that is not finite.

    See Also
    --------
    sweep, compliance, forward_kinematics

    Examples
    --------
    >>> qualities = gs.evaluate_poses(gs.load_preset("motion_base"), [[0, 0, 2.0], [0, 0, 3.5]], [0, 0.1, 0])
    >>> qualities.reachable, qualities.condition_number, qualities.payload
    """
    position, orientation = np.broadcast_arrays(np.asarray(position, float), np.asarray(orientation, float))
    shape = position.shape[:-1]
    positions, orientations = position.reshape(-1, 3), orientation.reshape(-1, 3)
    undefined = np.flatnonzero(~np.isfinite(np.hstack([positions, orientations])).all(axis=1))
    if undefined.size:
        pose = [*positions[undefined[0]].tolist(), *orientations[undefined[0]].tolist()]
        raise WorkspaceError(f"pose {undefined[0] + 1} is {pose}; expected finite numbers: leave such poses out")
    parts = []
    # without poses, there is one empty chunk
    for first in range(0, max(len(positions), 1), CHUNK):
        chunk = slice(first, first + CHUNK)
        parts.append(_evaluated(platform, positions[chunk], orientations[chunk]))
        if progress is not None:
            progress(min(first + CHUNK, len(positions)))
    columns: list[Any] = [None if c[0] is None else np.concatenate(c) for c in zip(*parts, strict=True)]
    return PoseQualities._make(None if column is None else column.reshape(shape) for column in columns)


def limits_at(platform: Platform, position: Array, orientation: Array) -> NDArray[np.int8]:
    """The `Limit` at poses (..., 3) only, at a third of the cost of `evaluate_poses`."""
    position, orientation = np.broadcast_arrays(np.asarray(position, float), np.asarray(orientation, float))
    return _reach(platform, position, orientation)[0]


def _reach(
    platform: Platform, position: FloatArray, orientation: FloatArray
) -> tuple[NDArray[np.int8], LegGeometry, FloatArray, dict[Limit, FloatArray]]:
    """The `Limit`, legs, side of singular poses, and margin of the worst leg [m] or joint [rad] by limit, at poses."""
    margins = {}
    with np.errstate(all="ignore"):  # a leg of length 0 has no direction
        legs = leg_geometry(platform, position, orientation)
        side = side_of_singular_poses(platform, legs)
        if platform.leg_length_min is not None:
            margins[Limit.LEG_TOO_SHORT] = np.asarray((legs.length - platform.leg_length_min).min(axis=-1))
        if platform.leg_length_max is not None:
            margins[Limit.LEG_TOO_LONG] = np.asarray((platform.leg_length_max - legs.length).min(axis=-1))
        if platform.joint_angle_max is not None:
            angles = joint_angles(platform, position, orientation, platform.home_position, platform.home_orientation)
            for limit, angle in zip((Limit.BASE_JOINT, Limit.PLATFORM_JOINT), angles, strict=True):
                margins[limit] = np.asarray(platform.joint_angle_max - angle.max(axis=-1))
    is_kept = {Limit.PITCH: np.abs(orientation[..., 1]) < LARGEST_PITCH, Limit.SINGULAR: side == 1}
    is_kept |= {limit: margin >= 0 for limit, margin in margins.items()}
    first = np.zeros(orientation.shape[:-1], np.int8)
    for limit in sorted(is_kept, reverse=True):
        first[~is_kept[limit]] = limit
    return first, legs, side, margins


def compliance(parameters: Parameters, position: Array, orientation: Array) -> Array:
    """Compliance K⁻¹ (..., 6, 6) of a platform whose motors hold: small twist [m, rad] per wrench at Op [N, N m].

    K⁻¹ = J⁻¹ diag(1/k_i) J⁻ᵀ with the leg Jacobian J and k = `leg_stiffness`, in world components: Gosselin,
    "Stiffness mapping for parallel manipulators", IEEE Trans. Robotics and Automation 6(3), 1990.

    Parameters
    ----------
    parameters
        A platform, or a batch of them from `stack`.
    position, orientation
        Pose (..., 3) [m], (..., 3) [rad]; leading axes broadcast.

    Returns
    -------
    ndarray
        K⁻¹ (..., 6, 6), symmetric: blocks [m/N], [rad/N] = [1/N] and [rad/(N m)].

    Raises
    ------
    PlatformError
        Rigid legs, `leg_stiffness` is 0.

    See Also
    --------
    leg_jacobian, static_leg_forces, evaluate_poses

    Examples
    --------
    >>> soft = gs.load_preset("motion_base").with_parameters({"leg_stiffness": 2e7})
    >>> 1e6 * gs.compliance(soft, soft.home_position, soft.home_orientation)[2, 2]  # µm/N
    """
    k = np.asarray(of_legs(parameters, "leg_stiffness"), dtype=float)
    if not (k > 0).all():
        raise PlatformError("leg_stiffness", "is 0, rigid legs, which have no stiffness; expected a number > 0 [N/m]")
    J = jacobian_of_legs(leg_geometry(parameters, position, orientation))
    inverse = np.linalg.inv(J)
    return np.asarray(inverse @ (inverse.mT / k[..., :, None]))


def _stiffness(platform: Platform, position: FloatArray, orientation: FloatArray, J: FloatArray) -> list[FloatArray]:
    """The `STIFFNESS` at poses (n, 3) with leg Jacobians J (n, 6, 6).

    In all directions but one the platform is free to move: stiffness is the inverse of an eigenvalue of a 3×3 block of
    the compliance, λ(K⁻¹_tt) or λ(K⁻¹_rr). Natural frequencies with damping left out are det(Jᵀ k J − ω² M) = 0 with M
    without armature: ω² are eigenvalues of √k J M⁻¹ Jᵀ √k.
    """
    root = np.sqrt(of_legs(platform, "leg_stiffness"))
    regular = np.isfinite(J).all(axis=(-2, -1)) & (np.linalg.det(np.nan_to_num(J)) != 0)
    stiffness = []
    with np.errstate(all="ignore"):
        inverse = np.linalg.inv(np.where(regular[:, None, None], J, np.eye(6))) / root
        for rows in (inverse[:, :3], inverse[:, 3:]):
            sigma = np.linalg.svd(rows, compute_uv=False)
            stiffness += [np.where(regular, 1 / sigma[:, edge] ** 2, 0.0) for edge in (0, -1)]
    frequency = np.zeros(len(J))
    M = mass_matrix(platform_side(Variant(springs=True), platform), position[regular], orientation[regular])
    J = root[:, None] * J[regular]
    mobility = np.nan_to_num(J @ np.linalg.solve(M, J.mT))
    squares = np.linalg.eigvalsh((mobility + mobility.mT) / 2)[:, 0]
    frequency[regular] = np.sqrt(np.maximum(squares, 0.0)) / (2 * np.pi)
    return [*stiffness, frequency]


def _evaluated(platform: Platform, position: FloatArray, orientation: FloatArray) -> PoseQualities:
    """Results at poses (n, 3)."""
    limit, legs, side, margins = _reach(platform, position, orientation)
    number, smallest = conditioning_of_legs(legs)
    speed = payload = force_margin = None
    if platform.leg_velocity_max is not None:
        with np.errstate(all="ignore"):
            rows = jacobian_of_legs(legs, scaled=True)
            speed = np.nan_to_num((platform.leg_velocity_max / np.sqrt((rows * rows).sum(axis=-1))).min(axis=-1))
    if platform.actuator_force_max is not None:
        payload, force_margin = np.zeros((2, len(position)))
        regular = number < LARGEST_CONDITION_NUMBER
        payload[regular], force_margin[regular] = _load_capacity(
            platform, position[regular], orientation[regular], platform.actuator_force_max
        )
    stiffness: Sequence[FloatArray | None] = (None,) * len(STIFFNESS)
    if platform.leg_stiffness > 0:
        stiffness = _stiffness(platform, position, orientation, np.asarray(jacobian_of_legs(legs), dtype=float))

    def least(*limits: Limit) -> FloatArray | None:
        of_limits = [margins[limit] for limit in limits if limit in margins]
        return np.minimum.reduce(of_limits) if of_limits else None

    return PoseQualities(
        limit,
        least(Limit.LEG_TOO_SHORT, Limit.LEG_TOO_LONG),
        least(Limit.BASE_JOINT, Limit.PLATFORM_JOINT),
        np.where(side == 1, smallest, -smallest),
        number,
        payload,
        force_margin,
        speed,
        *stiffness,
    )


def _load_capacity(
    platform: Platform, position: FloatArray, orientation: FloatArray, F: float | FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Largest payload [kg] and largest force in any direction [N] that leg forces within ±F hold at rest.

    With A = J⁻ᵀ[:, :3] and the static leg forces f0, a force f at Op requires leg forces f0 − A f. A point mass m at Op
    adds m f1, f1 = −A g, so m = min_i (F − sign(f1_i) f0_i)/|f1_i|, which is infinite if no leg force changes. The
    worst direction for leg i is ±A_i, so the force margin is min_i (F − |f0_i|)/|A_i|. Both are 0 where |f0_i| > F for
    some leg.
    """

    def solve(transposed: Array, held: Array) -> Array:
        unit_forces = np.broadcast_to(np.eye(6)[:, :3], (len(held), 6, 3))
        return np.linalg.solve(transposed, np.concatenate([held[..., None], unit_forces], axis=-1))

    forces = static_leg_forces(platform, position, orientation, solve=solve)
    f0, A = forces[..., 0], forces[..., 1:]
    f1 = -apply(A, platform.gravity)
    holds = (np.abs(f0) <= F).all(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        # 0/0: the leg is already at its limit, and the load does not change its force
        masses = np.where(f1 == 0, np.inf, (F - np.sign(f1) * f0) / np.abs(f1))
        reserves = (F - np.abs(f0)) / np.sqrt((A * A).sum(axis=-1))
    margin = np.where(np.isnan(reserves), np.inf, reserves).min(axis=-1)
    return np.where(holds, masses.min(axis=-1), 0.0), np.where(holds, margin, 0.0)


# --- grids of poses over two or three coordinates ---------------------------------------------------------------


@dataclass(frozen=True, eq=False, repr=False)
class Workspace:
    """Workspace results on a grid of poses; arrays have one axis per swept coordinate, in order."""

    platform: Platform
    swept: Mapping[str, FloatArray]  # the grid's values by coordinate, two or three [m or rad]
    fixed: Mapping[str, float]  # all other coordinates
    found: tuple[str, ...]  # swept coordinates with a range derived from the platform's limits
    assumed: tuple[str, ...]  # swept coordinates without limits, with a default range about home
    qualities: PoseQualities

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of points of each swept coordinate."""
        return tuple(len(values) for values in self.swept.values())

    @property
    def home(self) -> dict[str, float]:
        """The home pose by coordinate [m or rad], with angles in the turns of the grid."""
        middle = {**self.fixed, **{name: values.mean() for name, values in self.swept.items()}}
        home = home_of(self.platform)
        return home | {name: float(nearest_angle(np.array(home[name]), middle[name])) for name in LARGEST_ANGLES}

    def __repr__(self) -> str:
        """The swept ranges and the reachable share, on one line."""
        ranges = ", ".join(f"{name} {v[0]:.4g} to {v[-1]:.4g} {COORDINATES[name]}" for name, v in self.swept.items())
        reachable = self.qualities.reachable
        share = f"{100 * reachable.mean():.3g} % of {reachable.size} poses can be reached"
        return f"<Workspace of {self.platform.name} over {ranges}: {share}>"

    def coordinates(self) -> FloatArray:
        """Poses (…, 6): position [m], orientation [rad]."""
        return _poses(self.swept, self.fixed)


def sweep(
    platform: Platform,
    over: Mapping[str, Range | None] | None = None,
    at: Mapping[str, float] | None = None,
    points: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Workspace:
    """Workspace of a platform: `evaluate_poses` on a grid.

    Parameters
    ----------
    platform
        The platform with its limits; limits that it does not state are not checked.
    over
        Two or three coordinates and their ranges [m or rad]; with None the range is derived from the limits. Default:
        x and y, or roll and pitch where the platform states no `leg_length_max`: singular poses bound angles, but not
        lengths.
    at
        Values of other coordinates [m or rad]; by default those of the home pose.
    points
        Number of points per swept coordinate; by default 101 for two coordinates, 31 for three.
    progress
        Called with the number of completed poses.

    Returns
    -------
    Workspace
        `swept`, the values of each swept coordinate; `fixed`, the other coordinates; `qualities` as of
        `evaluate_poses`, with one axis for each swept coordinate.

    Raises
    ------
    WorkspaceError
        Coordinates, ranges or a number of points that do not define a grid.

    See Also
    --------
    evaluate_poses, check

    Examples
    --------
    >>> space = gs.sweep(gs.load_preset("motion_base"), {"x": None, "pitch": (-0.2, 0.2)}, {"z": 2.2}, points=21)
    >>> space.qualities.reachable.mean(), space.swept["x"][[0, -1]]
    """
    # a map over x and y would be empty where no leg has an end
    usual = ("roll", "pitch") if platform.leg_length_max is None else ("x", "y")
    over = dict.fromkeys(usual) if over is None else dict(over)
    at = {} if at is None else dict(at)
    home = home_of(platform)
    for name in (*over, *at):
        if name not in COORDINATES:
            raise WorkspaceError(f"unknown coordinate '{name}'; expected one of {', '.join(COORDINATES)}")
    if len(over) not in POINTS:
        raise WorkspaceError(f"{len(over)} swept coordinates; expected two for maps, or three for a volume")
    for name in (name for name in over if name in at):
        raise WorkspaceError(f"{name} is both swept and fixed; expected one of them: leave it out of the other")
    ends = [(name, end) for name, limits in over.items() for end in limits or ()]
    for name, value in (*ends, *at.items()):
        if not np.isfinite(value):
            raise WorkspaceError(f"{name} is {value}; expected a finite number of {COORDINATES[name]}")
        # of a frame that is turned round at home, as many half turns as a quarter turn on either side of home needs
        turns = max(1.0, np.ceil(abs(home[name]) / np.pi + 0.5)) if name != "pitch" else 1.0
        most = LARGEST_ANGLES.get(name, np.inf) * turns
        if abs(value) > most * (1 + 1e-12):
            stated, limit = f"{name} is {value:g} rad, {np.degrees(value):g}°", f"{np.degrees(most):g}°"
            raise WorkspaceError(f"{stated}; expected from −{limit} to {limit}; numbers without a unit are in rad")
    for name, limits in over.items():
        if limits is not None and not limits[0] < limits[1]:
            low, high = (f"{end:g} {COORDINATES[name]}" for end in limits)
            raise WorkspaceError(f"{name} goes from {low} to {high}; expected a range from low to high")
    count, largest = POINTS[len(over)] if points is None else points, int(round(LARGEST_GRID ** (1 / len(over)), 9))
    if not 2 <= count <= largest:
        total = f", in all {count ** len(over):,} poses," if count > largest else ""
        raise WorkspaceError(
            f"{count} points per coordinate{total} for {len(over)} swept coordinates; expected from 2 to {largest}"
        )
    fixed = {name: float(at.get(name, home[name])) for name in COORDINATES if name not in over}
    without_range = [name for name, limits in over.items() if limits is None]
    bounded = _bounded(platform)
    assumed = tuple(name for name in without_range if name not in bounded)
    found = tuple(name for name in without_range if name in bounded)
    ranges = default_ranges(platform, over, fixed)
    swept = {name: np.linspace(*ranges[name], count) for name in over}
    poses = _poses(swept, fixed)
    qualities = evaluate_poses(platform, poses[..., :3], poses[..., 3:], progress)
    return Workspace(platform, swept, fixed, found, assumed, qualities)


def home_of(platform: Platform) -> dict[str, float]:
    """The home pose by coordinate [m or rad]."""
    return dict(zip(COORDINATES, [*platform.home_position, *platform.home_orientation], strict=True))


def default_ranges(
    platform: Platform, over: Mapping[str, Range | None], fixed: Mapping[str, float]
) -> dict[str, Range]:
    """Ranges [m or rad] about the reachable region with the other coordinates fixed, rounded outward.

    A coarse grid over the box that limits leave finds the region, and two finer ones its ends; a tip that is thinner
    than a step of the coarse one can be missed. Coordinates without limits have `UNBOUNDED_LENGTH` or `UNBOUNDED_ANGLE`
    about home. Given ranges are not changed.
    """
    home = home_of(platform)
    free = [name for name, limits in over.items() if limits is None and name in _bounded(platform)]
    box = {name: limits or _outer_range(platform, name, home[name], over, fixed) for name, limits in over.items()}
    ranges = dict(box)
    for _ in range(_ROUNDS if free else 0):
        swept = {name: np.linspace(*ranges[name], _SEARCH[len(over)]) for name in over}
        # a region too thin for the grid still contains home
        around = [name for name in free if ranges[name][0] <= home[name] <= ranges[name][1]]
        swept |= {name: np.union1d(swept[name], home[name]) for name in around}
        poses = _poses(swept, fixed)
        reached = limits_at(platform, poses[..., :3], poses[..., 3:]) == Limit.NONE
        if not reached.any():
            return {name: _rounded(name, *box[name]) if name in free else box[name] for name in over}
        for axis, name in enumerate(over):
            if name in free:
                # the ends of the region, extended by one point on either side
                rows, values = rows_reached(reached, axis), swept[name]
                ranges[name] = float(values[max(rows[0] - 1, 0)]), float(values[min(rows[-1] + 1, len(values) - 1)])
    for name in free:
        low, high = ranges[name]
        low, high = low - _BEYOND * (high - low), high + _BEYOND * (high - low)
        below, above = home[name] - low, high - home[name]
        if min(below, above) >= _NEARLY * max(below, above):  # so that home is in the middle and on the grid
            low, high = home[name] - max(below, above), home[name] + max(below, above)
        low, high = _rounded(name, low, high)
        ranges[name] = (max(low, box[name][0]), min(high, box[name][1]))
    return ranges


def rows_reached(reached: NDArray[np.bool_], axis: int) -> NDArray[np.intp]:
    """Indices along one axis of a grid at which any of its points is reached."""
    return np.flatnonzero(reached.any(axis=tuple(k for k in range(reached.ndim) if k != axis)))


def _bounded(platform: Platform) -> set[str]:
    """The coordinates that limits of a platform bound."""
    if platform.leg_length_max is not None:
        return {*COORDINATES}
    return set() if platform.joint_angle_max is None else {*LARGEST_ANGLES}


def _outer_range(
    platform: Platform, name: str, home: float, over: Mapping[str, Range | None], fixed: Mapping[str, float]
) -> Range:
    size, longest, is_angle = platform.characteristic_length, platform.leg_length_max, name in LARGEST_ANGLES
    if is_angle:
        half = np.pi if name in _bounded(platform) else UNBOUNDED_ANGLE
        low, high = float(home - half), float(home + half)
        return (max(low, -np.pi / 2), min(high, np.pi / 2)) if name == "pitch" else (low, high)
    if longest is None:
        return home - UNBOUNDED_LENGTH * size, home + UNBOUNDED_LENGTH * size
    k = list(COORDINATES).index(name)
    if any(angle in over for angle in LARGEST_ANGLES):
        centres, radii = platform.base_points[:, k], longest + np.sqrt((platform.platform_points**2).sum(axis=1))
    else:
        R = matrix_from_orientation(np.array([fixed[angle] for angle in LARGEST_ANGLES]))
        centres, radii = (platform.base_points - platform.platform_points @ R.T)[:, k], np.full(6, longest)
    low, high = float((centres - radii).max()), float((centres + radii).min())
    # no pose fits all legs: use a range to display nonetheless
    return (low, high) if low < high else (home - size, home + size)


def _rounded(name: str, low: float, high: float) -> Range:
    """Round outward to 1, 2 or 5 times a power of ten, in degrees for angles."""
    unit = np.pi / 180 if name in LARGEST_ANGLES else 1.0
    rough = (high - low) / unit / 40
    decade = 10.0 ** np.floor(np.log10(rough))
    step = next(k * decade for k in (1, 2, 5, 10) if k * decade >= rough * (1 - 1e-9))
    # digits of the step, so that 3 · 0.1 is 0.3
    digits = max(0, -int(np.floor(np.log10(step))))
    first, last = (round(float(f(end / unit / step) * step), digits) for f, end in ((np.floor, low), (np.ceil, high)))
    return unit * first, unit * last


def _poses(swept: Mapping[str, FloatArray], fixed: Mapping[str, float]) -> FloatArray:
    """(…, 6) with one leading axis per swept coordinate."""
    grid = dict(zip(swept, np.meshgrid(*swept.values(), indexing="ij"), strict=True))
    return np.stack(
        np.broadcast_arrays(*(grid[name] if name in grid else np.array(fixed[name]) for name in COORDINATES)), axis=-1
    )
