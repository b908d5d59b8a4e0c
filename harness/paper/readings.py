"""Ambiguities in the scan of the paper: the reading used here, and the effect of another."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from gough_stewart.harness.paper.open_loop import run_kernel
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.errors import PlatformError
from gough_stewart.model.formulations.cases import paper_case, with_pairs_swapped
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation

# Sufficient for differences shown with three digits.
_RTOL = 1e-9


@dataclass(frozen=True)
class Reading:
    """One ambiguity: the reading used, another reading, and its effect at the end of the case."""

    point: str
    decided: str
    other: str
    position_change: float | None = None  # largest component [m]; None if the other reading cannot run
    orientation_change: float | None = None  # [rad]
    remark: str = ""
    height: float | None = None  # of the platform at the end [m]


def _on_azimuths(platform: Platform, degrees: Sequence[float]) -> Platform:
    """With platform joints at these azimuths."""
    azimuth = np.radians(degrees)
    points = np.stack([np.sin(azimuth), np.cos(azimuth), np.zeros(6)], axis=1)
    return replace(platform, platform_points=points)


_PAIRING = "pairing of joints", "each base joint to the platform joint 30° away, alternately + and −"
# Each with the platform that it would mean; None for the other order of legs.
_OTHERS: list[tuple[Reading, Callable[[Platform], Platform] | None]] = [
    (
        Reading(*_PAIRING, "60° away, alternately + and −"),
        lambda platform: _on_azimuths(platform, [75, -75, 195, 45, 315, 165]),
    ),
    (
        # both lists of the appendix as printed, + before −
        Reading(*_PAIRING, "both lists in the printed order, all legs twisted by +60°"),
        lambda platform: _on_azimuths(platform, [75, 45, 195, 165, 315, 285]),
    ),
    (Reading("order of the ± in the appendix, which swaps the forces of each pair", "+ first", "− first"), None),
    (
        Reading(
            "r2, centre of mass of the upper part",
            "0.4144 m below P, as both readings of the garbled value give",
            "half of a uniform rod with J2 and m2, 0.4014 m below P",
        ),
        lambda p: replace(p, leg_upper_com=float(np.sqrt(12 * p.leg_upper_inertia / p.leg_upper_mass) / 2)),
    ),
    (
        Reading("r_G, centre of mass of the platform", "at Op", "0.1 m above Op"),
        lambda platform: replace(platform, platform_com=np.array([0.0, 0.0, 0.1])),
    ),
    (
        Reading("g", "9.81 m/s²", "9.80665 m/s²"),
        lambda platform: replace(platform, gravity=np.array([0.0, 0.0, -9.80665])),
    ),
    (
        Reading("friction in the legs", "none", "viscous, 1 N s/m"),
        lambda platform: replace(platform, leg_viscous_friction=1.0),
    ),
]


def other_readings(minus_first: bool = False) -> list[Reading]:
    """Run the paper's case under each of the other readings, in the given order of its legs."""
    decided = paper_case(minus_first)
    final = run_kernel(decided, _RTOL).states[-1]
    rows = []
    for reading, make in _OTHERS:
        row, case = reading, paper_case(not minus_first)
        if make is None and minus_first:
            row = replace(reading, decided=reading.other, other=reading.decided)
        try:
            if make is not None:
                platform = make(paper_case().platform)
                case = replace(decided, platform=with_pairs_swapped(platform) if minus_first else platform)
            end = run_kernel(case, _RTOL).states[-1]
            change = np.abs(end - final)
            rows.append(
                replace(
                    row,
                    position_change=float(change[:3].max()),
                    orientation_change=float(change[3:6].max()),
                    height=float(end[2]),
                )
            )
        except PlatformError as error:
            rows.append(replace(row, remark=f"impossible: {error}"))
    # the same motion, with orientation read as rotations about moving axes
    moving = Rotation.from_matrix(matrix_from_orientation(final[3:6])).as_euler("XYZ")
    axes = "axes of roll, pitch, yaw", "fixed X, then Y, then Z", "moving X, then Y', then Z''"
    change_of_angles = float(np.abs(moving - final[3:6]).max())
    rows.append(Reading(*axes, 0.0, change_of_angles, "the same motion under other angles", float(final[2])))
    return rows


def weight_of_the_published_forces() -> dict[str, float]:
    """The published forces compared with the weight: static forces at zero yaw, and the weight of all bodies.

    The even legs' 49.5 N is the axial share of the whole mechanism's weight, m_total g L / (6 z), although the
    base joints carry most of the lower parts. So the platform is far from equilibrium and rises.
    """
    case = paper_case()
    platform, t = case.platform, case.start.position
    held = float(static_leg_forces(platform, t, np.zeros(3)).mean())
    arm = np.linalg.norm(t + platform.platform_points - platform.base_points, axis=1).mean()
    total = platform.platform_mass + 6 * (platform.leg_lower_mass + platform.leg_upper_mass)
    share = float(total * -platform.gravity[2] * arm / (6 * t[2]))
    return {"static_leg_force": held, "share_of_total_weight": share}
