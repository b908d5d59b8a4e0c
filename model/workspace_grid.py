"""Workspace analysis on a grid of poses over two or three coordinates."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from gough_stewart.model.errors import WorkspaceError
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation, nearest_angle
from gough_stewart.model.vectors import FloatArray
from gough_stewart.model.workspace import Limit, PoseQualities, evaluate_poses, limits_at

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
    _check(over, at, home)
    count, largest = POINTS[len(over)] if points is None else points, int(round(LARGEST_GRID ** (1 / len(over)), 9))
    if not 2 <= count <= largest:
        total = f", in all {count ** len(over):,} poses," if count > largest else ""
        raise WorkspaceError(
            f"{count} points per coordinate{total} for {len(over)} swept coordinates; expected from 2 to {largest}"
        )
    fixed = {name: float(at.get(name, home[name])) for name in COORDINATES if name not in over}
    without_range = [name for name, limits in over.items() if limits is None]
    assumed = tuple(name for name in without_range if not _is_bounded(platform, name))
    found = tuple(name for name in without_range if name not in assumed)
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

    P_i stays within `leg_length_max` of B_i, which bounds Op by a box; roll and yaw are bounded by half turns from
    home, pitch by ±90°. A coarse grid over this box finds the region, and two finer ones its ends. A tip thinner than
    a step of the coarse grid, a hundredth of the box (a twentieth for three coordinates), can be missed. If no limit
    of the platform bounds a coordinate, the range is `UNBOUNDED_LENGTH` or `UNBOUNDED_ANGLE` about home. Given ranges
    are not changed.
    """
    home = home_of(platform)
    free = [name for name, limits in over.items() if limits is None and _is_bounded(platform, name)]
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
                rows = np.flatnonzero(reached.any(axis=tuple(k for k in range(reached.ndim) if k != axis)))
                values = swept[name]
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


def _is_bounded(platform: Platform, name: str) -> bool:
    if name in LARGEST_ANGLES:
        return platform.leg_length_max is not None or platform.joint_angle_max is not None
    return platform.leg_length_max is not None


def _outer_range(
    platform: Platform, name: str, home: float, over: Mapping[str, Range | None], fixed: Mapping[str, float]
) -> Range:
    if name in LARGEST_ANGLES and _is_bounded(platform, name):
        return (-np.pi / 2, np.pi / 2) if name == "pitch" else (home - np.pi, home + np.pi)
    longest = platform.leg_length_max
    if name in LARGEST_ANGLES or longest is None:
        size = UNBOUNDED_ANGLE if name in LARGEST_ANGLES else UNBOUNDED_LENGTH * platform.characteristic_length
        low, high = float(home - size), float(home + size)
        return (max(low, -np.pi / 2), min(high, np.pi / 2)) if name == "pitch" else (low, high)
    k = list(COORDINATES).index(name)
    if any(angle in over for angle in LARGEST_ANGLES):
        arms = np.sqrt((platform.platform_points**2).sum(axis=1))
        centres, radii = platform.base_points[:, k], longest + arms
    else:
        R = matrix_from_orientation(np.array([fixed[angle] for angle in LARGEST_ANGLES]))
        centres, radii = (platform.base_points - platform.platform_points @ R.T)[:, k], np.full(6, longest)
    low, high = float((centres - radii).max()), float((centres + radii).min())
    # no pose fits all legs: use a range to display anyway
    return (low, high) if low < high else (home - platform.characteristic_length, home + platform.characteristic_length)


def _rounded(name: str, low: float, high: float) -> Range:
    """Round outward to 1, 2 or 5 times a power of ten, in degrees for angles."""
    unit = np.pi / 180 if name in LARGEST_ANGLES else 1.0
    rough = (high - low) / unit / 40
    decade = 10.0 ** np.floor(np.log10(rough))
    step = next(k * decade for k in (1, 2, 5, 10) if k * decade >= rough * (1 - 1e-9))
    # digits of the step, so that 3 · 0.1 is 0.3
    digits = max(0, -int(np.floor(np.log10(step))))
    ends = (round(float(f(end / unit / step) * step), digits) for f, end in ((np.floor, low), (np.ceil, high)))
    first, last = (unit * end for end in ends)
    return first, last


def _poses(swept: Mapping[str, FloatArray], fixed: Mapping[str, float]) -> FloatArray:
    """(…, 6) with one leading axis per swept coordinate."""
    grid = dict(zip(swept, np.meshgrid(*swept.values(), indexing="ij"), strict=True))
    shape = next(iter(grid.values())).shape
    return np.stack([grid[name] if name in grid else np.full(shape, fixed[name]) for name in COORDINATES], axis=-1)


def _check(over: Mapping[str, Range | None], at: Mapping[str, float], home: Mapping[str, float]) -> None:
    for name in (*over, *at):
        if name not in COORDINATES:
            raise WorkspaceError(f"unknown coordinate '{name}'; expected one of {', '.join(COORDINATES)}")
    if len(over) not in POINTS:
        raise WorkspaceError(f"{len(over)} swept coordinates; expected two for maps, or three for a volume")
    for name in over:
        if name in at:
            raise WorkspaceError(f"{name} is both swept and fixed; expected one of them: leave it out of the other")
    for name, limits in over.items():
        for end in limits or ():
            _check_value(name, end, home[name])
        if limits is not None and not limits[0] < limits[1]:
            low, high = (f"{end:g} {COORDINATES[name]}" for end in limits)
            raise WorkspaceError(f"{name} goes from {low} to {high}; expected a range from low to high")
    for name, value in at.items():
        _check_value(name, value, home[name])


def _check_value(name: str, value: float, home: float) -> None:
    if not np.isfinite(value):
        raise WorkspaceError(f"{name} is {value}; expected a finite number of {COORDINATES[name]}")
    # of a frame that is turned round at home, as many half turns as a quarter turn on either side of home needs
    turns = max(1.0, np.ceil(abs(home) / np.pi + 0.5)) if name != "pitch" else 1.0
    most = LARGEST_ANGLES.get(name, np.inf) * turns
    if abs(value) > most * (1 + 1e-12):
        largest = np.degrees(most)
        raise WorkspaceError(
            f"{name} is {value:g} rad, {np.degrees(value):g}°; expected from −{largest:g}° to {largest:g}°; "
            "numbers without a unit are in rad"
        )
