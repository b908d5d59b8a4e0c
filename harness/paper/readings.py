"""Ambiguities in the scan of the paper: the reading used here, and the effect of another."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from gough_stewart.harness.paper.open_loop import run_kernel
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.errors import PlatformError
from gough_stewart.model.formulations.cases import paper_case, with_pairs_swapped
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.vectors import FloatArray

# Sufficient for differences shown with three digits.
_RTOL = 1e-9


@dataclass(frozen=True)
class Reading:
    """One ambiguity: the reading used, another reading, and its effect at the end of the case."""

    point: str
    decided: str
    other: str
    position_change: float | None  # largest component [m]; None if the other reading cannot run
    orientation_change: float | None  # [rad]
    remark: str = ""
    height: float | None = None  # of the platform at the end [m]


def other_readings(minus_first: bool = False, progress: Callable[[], None] | None = None) -> list[Reading]:
    """Run the paper's case under each of the other readings, in the given order of its legs.

    `progress` is called after each run.
    """
    final = run_kernel(paper_case(minus_first), _RTOL).states[-1]
    rows = []
    for point, decided, other, make in _OTHERS:
        rows.append(_compare(point, decided, other, make, minus_first, final))
        if progress is not None:
            progress()
    return [*rows, _body_fixed_angles(final)]


def weight_of_the_published_forces() -> dict[str, float]:
    """The published forces compared with the weight: static forces at zero yaw, and the weight of all bodies.

    The even legs' 49.5 N is the axial share of the whole mechanism's weight, m_total g L / (6 z), although the
    base joints carry most of the lower parts. So the platform is far from equilibrium and rises.
    """
    case = paper_case()
    platform, t = case.platform, case.start.position
    level = np.zeros(3)
    held = float(static_leg_forces(platform, t, level).mean())
    arm = np.linalg.norm(t + platform.platform_points - platform.base_points, axis=1).mean()
    total = platform.platform_mass + 6 * (platform.leg_lower_mass + platform.leg_upper_mass)
    share = float(total * -platform.gravity[2] * arm / (6 * t[2]))
    return {"static_leg_force": held, "share_of_total_weight": share}


def _turned_alike(platform: Platform) -> Platform:
    """Both lists of the appendix as printed, + before −: platform azimuths 75, 45, 195, 165, 315, 285 deg."""
    return _on_azimuths(platform, [75, 45, 195, 165, 315, 285])


def _far_pairing(platform: Platform) -> Platform:
    """Each leg to a platform joint 60° away, alternately + and −."""
    return _on_azimuths(platform, [75, -75, 195, 45, 315, 165])


def _on_azimuths(platform: Platform, degrees: list[float]) -> Platform:
    azimuth = np.radians(degrees)
    points = np.stack([np.sin(azimuth), np.cos(azimuth), np.zeros(6)], axis=1)
    return replace(platform, platform_points=points)


def _as_uniform_rod(platform: Platform) -> Platform:
    """The upper part as a uniform rod with its J2 and m2, suspended from P: half its length √(12 J2/m2)."""
    half = np.sqrt(12 * platform.leg_upper_inertia / platform.leg_upper_mass) / 2
    return replace(platform, leg_upper_com=float(half))


_OTHERS: list[tuple[str, str, str, Callable[[Platform], Platform] | None]] = [
    (
        "pairing of joints",
        "each base joint to the platform joint 30° away, alternately + and −",
        "60° away, alternately + and −",
        _far_pairing,
    ),
    (
        "pairing of joints",
        "each base joint to the platform joint 30° away, alternately + and −",
        "both lists in the printed order, all legs twisted by +60°",
        _turned_alike,
    ),
    ("order of the ± in the appendix, which swaps the forces of each pair", "+ first", "− first", None),
    (
        "r2, centre of mass of the upper part",
        "0.4144 m below P, as both readings of the garbled value give",
        "half of a uniform rod with J2 and m2, 0.4014 m below P",
        _as_uniform_rod,
    ),
    (
        "r_G, centre of mass of the platform",
        "at Op",
        "0.1 m above Op",
        lambda platform: replace(platform, platform_com=np.array([0.0, 0.0, 0.1])),
    ),
    (
        "g",
        "9.81 m/s²",
        "9.80665 m/s²",
        lambda platform: replace(platform, gravity=np.array([0.0, 0.0, -9.80665])),
    ),
    (
        "friction in the legs",
        "none",
        "viscous, 1 N s/m",
        lambda platform: replace(platform, leg_viscous_friction=1.0),
    ),
]
NUMBER_OF_RUNS = len(_OTHERS)


def _compare(
    point: str,
    decided: str,
    other: str,
    make: Callable[[Platform], Platform] | None,
    minus_first: bool,
    final: FloatArray,
) -> Reading:
    if make is None:
        changed = paper_case(not minus_first)
        decided, other = (other, decided) if minus_first else (decided, other)
    else:
        try:
            platform = make(paper_case().platform)
        except PlatformError as error:
            return Reading(point, decided, other, None, None, remark=f"impossible: {error}")
        platform = with_pairs_swapped(platform) if minus_first else platform
        changed = replace(paper_case(minus_first), platform=platform)
    end = run_kernel(changed, _RTOL).states[-1]
    difference = np.abs(end - final)
    return Reading(
        point, decided, other, float(difference[:3].max()), float(difference[3:6].max()), height=float(end[2])
    )


def _body_fixed_angles(final: FloatArray) -> Reading:
    """The same motion, with orientation read as rotations about moving axes: X, then Y', then Z''."""
    moving = Rotation.from_matrix(matrix_from_orientation(final[3:6])).as_euler("XYZ")
    return Reading(
        "axes of roll, pitch, yaw",
        "fixed X, then Y, then Z",
        "moving X, then Y', then Z''",
        0.0,
        float(np.abs(moving - final[3:6]).max()),
        "the same motion under other angles",
        float(final[2]),
    )
