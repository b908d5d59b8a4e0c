"""Hints at joints in the wrong order: legs that nearly touch, or an order in which they would hold far better."""

from itertools import combinations, permutations

import numpy as np

from gough_stewart.model.kinematics import conditioning_of_legs, leg_geometry
from gough_stewart.model.parameters import PlatformFields
from gough_stewart.model.platform_checks import Joints
from gough_stewart.model.vectors import FloatArray, dot

# Legs whose axes come closer than this fraction of the shorter one.
CLOSEST = 0.05
# Another order is named if its condition number is this many times smaller.
BETTER = 3.0
_PAIRS = tuple(combinations(range(6), 2))


def joint_order_hints(platform: PlatformFields) -> tuple[str, ...]:
    """One line each for legs that nearly touch at home, and for an order of joints that conditions them far better.

    The order of the joints is the pairing of base and platform joints; a permuted list often still assembles.
    """
    legs = leg_geometry(platform, platform.home_position, platform.home_orientation)
    base, tip = platform.base_points, platform.base_points + legs.direction * legs.length[:, None]
    hints = []
    i, j, share = _closest(base, tip)
    better = _better_order(platform)
    remedy = "check the order of base_points and platform_points: joint i of one belongs to joint i of the other"
    if share < CLOSEST:
        hints.append(
            f"legs {i + 1} and {j + 1} come within {100 * share:.2g} % of their length of each other at home, so real "
            f"legs would collide; {remedy}"
        )
    if better is not None:
        order, now, then = better
        hints.append(
            f"the leg Jacobian has a condition number of {now:.3g} at home, and of {then:.3g} with the platform joints "
            f"in the order {', '.join(str(k + 1) for k in order)}; {remedy}"
        )
    return tuple(hints)


def segment_distances(base: FloatArray, tip: FloatArray) -> FloatArray:
    """Least distances (15,) [m] of the six segments from base to tip (6, 3), for all pairs of two.

    For p + s d and q + t e with s, t in [0, 1]: the least of the distance between the lines, where both feet are on
    the segments, and of the four distances of an end from the other segment.
    """
    i, j = np.array(_PAIRS).T
    p, d, q, e = base[i], (tip - base)[i], base[j], (tip - base)[j]
    distances = [
        _from_segment(p, q, e),
        _from_segment(p + d, q, e),
        _from_segment(q, p, d),
        _from_segment(q + e, p, d),
    ]
    # feet of the common perpendicular: [d·d −d·e; d·e −e·e] [s; t] = [d·(q − p); e·(q − p)]
    dd, de, ee, r = dot(d, d), dot(d, e), dot(e, e), q - p
    with np.errstate(divide="ignore", invalid="ignore"):  # parallel legs have no single foot
        s = (ee * dot(d, r) - de * dot(e, r)) / (dd * ee - de * de)
        t = (de * dot(d, r) - dd * dot(e, r)) / (dd * ee - de * de)
        gap = np.linalg.norm(p + s[:, None] * d - q - t[:, None] * e, axis=-1)
        inside = (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    return np.asarray(np.min([*distances, np.where(inside, gap, np.inf)], axis=0))


def _closest(base: FloatArray, tip: FloatArray) -> tuple[int, int, float]:
    """The two closest legs, and their distance as a fraction of the shorter one."""
    length = np.linalg.norm(tip - base, axis=-1)
    shares = segment_distances(base, tip) / np.array([min(length[i], length[j]) for i, j in _PAIRS])
    k = int(shares.argmin())
    return *_PAIRS[k], float(shares[k])


def _better_order(platform: PlatformFields) -> tuple[tuple[int, ...], float, float] | None:
    """The best order of the platform joints if it is far better, with both condition numbers; None if there is none.

    Only orders whose legs keep their distance and the stroke are considered.
    """
    orders = np.array(list(permutations(range(6))))
    joints = Joints(np.broadcast_to(platform.base_points, (len(orders), 6, 3)), platform.platform_points[orders])
    legs = leg_geometry(joints, platform.home_position, platform.home_orientation)  # type: ignore[arg-type]
    numbers = conditioning_of_legs(legs).condition_number
    low = 0.0 if platform.leg_length_min is None else platform.leg_length_min
    high = np.inf if platform.leg_length_max is None else platform.leg_length_max
    fits = np.all((legs.length >= low) & (legs.length <= high), axis=-1)
    for k in np.argsort(numbers, kind="stable"):
        if not BETTER * numbers[k] <= numbers[0]:
            break
        tip = platform.base_points + legs.direction[k] * legs.length[k, :, None]
        if fits[k] and _closest(platform.base_points, tip)[2] >= CLOSEST:
            return tuple(orders[k].tolist()), float(numbers[0]), float(numbers[k])
    return None


def _from_segment(point: FloatArray, start: FloatArray, along: FloatArray) -> FloatArray:
    """Distances (n,) of points (n, 3) from segments."""
    share = np.clip(dot(point - start, along) / dot(along, along), 0.0, 1.0)
    return np.asarray(np.linalg.norm(point - start - share[:, None] * along, axis=-1))
