"""Open-loop cases: a platform, a start, constant actuator forces, a duration."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.interface import Inputs, State
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.platform import Platform, load_preset

PAPER_PRESET = "liu2000"
ROWS = 101
# Section IV of the paper.
_PAPER_START = State(
    position=np.array([0.0, 0.0, 3.0]),
    orientation=np.array([0.0, 0.0, -0.1]),
    velocity=np.array([0.0, 0.2, 0.0]),
    angular_velocity=np.array([0.0, 0.1, 0.0]),
)
_PAPER_FORCES = np.array([55.0, 49.5, 55.0, 49.5, 55.0, 49.5])
_PAPER_DURATION = 1.0


@dataclass(frozen=True)
class OpenLoopCase:
    """Constant forces on a platform from a start state."""

    title: str
    platform: Platform
    start: State
    actuator_force: NDArray[np.float64]  # (6,) [N]
    duration: float  # [s]
    is_published: bool = False  # the paper's own plant, start and forces
    minus_first: bool = False  # the other order of its appendix

    @property
    def time(self) -> NDArray[np.float64]:
        """The 101 result times [s]."""
        return np.linspace(0.0, self.duration, ROWS)

    @property
    def inputs(self) -> Inputs:
        """Actuator forces without an external wrench."""
        return Inputs(self.actuator_force, np.zeros(3), np.zeros(3))


def paper_case(minus_first: bool = False) -> OpenLoopCase:
    """Section IV of the paper; `minus_first` reads its appendix's ± as − first, which swaps the legs of each pair."""
    platform = load_preset(PAPER_PRESET)
    title = "open-loop case of Liu, Li & Li (2000)"
    if minus_first:
        platform, title = with_pairs_swapped(platform), f"{title}, − before + in the appendix"
    return OpenLoopCase(title, platform, _PAPER_START, _PAPER_FORCES, _PAPER_DURATION, True, minus_first)


def case_of(platform: Platform) -> OpenLoopCase:
    """The paper's case, scaled to the size of another platform.

    Froude's rule, with λ the mean home leg length over that of the paper's platform: the start is the home pose rotated
    by the paper's yaw, velocities × √λ, angular velocities / √λ, duration × √λ. Even legs push with their static force
    in the home pose and odd legs with 55/49.5 of it, the ratio of the published forces. The published forces are about
    twice the static ones, with which most platforms would pass a singular pose. For the paper's platform this is the
    paper's case.
    """
    paper = paper_case()
    if replace(platform, name="", source="") == replace(paper.platform, name="", source=""):
        return replace(paper, platform=platform)
    lengths = [leg_geometry(p, p.home_position, p.home_orientation).length for p in (platform, paper.platform)]
    scale = np.sqrt(lengths[0].mean() / lengths[1].mean())
    turned = platform.home_orientation + paper.start.orientation
    start = State(
        platform.home_position.copy(), turned, paper.start.velocity * scale, paper.start.angular_velocity / scale
    )
    ratio = paper.actuator_force / paper.actuator_force.min()
    return OpenLoopCase(
        f"open-loop case of Liu, Li & Li (2000), scaled to {platform.name}",
        platform,
        start,
        static_leg_forces(platform, platform.home_position, platform.home_orientation) * ratio,
        float(paper.duration * scale),
    )


def with_pairs_swapped(platform: Platform) -> Platform:
    """Swap the numbers of legs 1 and 2, 3 and 4, 5 and 6; the mechanism is the same."""
    order = [1, 0, 3, 2, 5, 4]
    return replace(platform, base_points=platform.base_points[order], platform_points=platform.platform_points[order])
