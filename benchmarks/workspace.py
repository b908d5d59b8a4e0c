"""Cost of a workspace of 100,000 poses, against a plain loop over poses: `make bench`.

Reachability, condition number, payload and force margin of motion_base. The loop computes the same pose by pose with
the functions of kinematics and dynamics; it is timed on a subset of the poses. Best of several rounds.
"""

import sys
import time
from collections.abc import Callable

import numpy as np
from rich.console import Console
from rich.table import Table

from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.kinematics import conditioning, joint_angles, leg_geometry, leg_jacobian
from gough_stewart.model.platform import Platform, load_preset
from gough_stewart.model.vectors import FloatArray
from gough_stewart.model.workspace import evaluate_poses

POSES, IN_LOOP, ROUNDS = 100_000, 500, 3
TARGET = 10.0  # [s]


def one_pose(platform: Platform, position: FloatArray, orientation: FloatArray) -> tuple[bool, float, float, float]:
    """The results of `evaluate_poses` at one pose: reachable, condition number, payload, force margin."""
    pose, home = (position, orientation), (platform.home_position, platform.home_orientation)
    length = leg_geometry(platform, *pose).length
    angles = joint_angles(platform, *pose, *home)
    J = leg_jacobian(platform, *pose)
    side = np.linalg.det(J) * np.linalg.det(leg_jacobian(platform, *home)) > 0
    largest = platform.actuator_force_max or np.inf
    within = (platform.leg_length_min or 0) <= length.min() and length.max() <= (platform.leg_length_max or np.inf)
    is_near = max(angle.max() for angle in angles) <= (platform.joint_angle_max or np.inf)
    f0, A = static_leg_forces(platform, *pose), np.linalg.inv(J.T)[:, :3]
    f1 = -A @ platform.gravity
    holds = np.abs(f0).max() <= largest
    payload = ((largest - np.sign(f1) * f0) / np.abs(f1)).min()
    margin = ((largest - np.abs(f0)) / np.linalg.norm(A, axis=1)).min()
    number = float(conditioning(platform, *pose).condition_number)
    return bool(side and within and is_near), number, holds * float(payload), holds * float(margin)


def best(task: Callable[[], object]) -> float:
    """Seconds of the fastest round."""
    rounds = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        task()
        rounds.append(time.perf_counter() - start)
    return min(rounds)


def main() -> int:
    """Measure, check that both agree, print the table, and report a missed target."""
    platform, rng = load_preset("motion_base"), np.random.default_rng(0)
    position = platform.home_position + rng.uniform(-0.8, 0.8, (POSES, 3))
    orientation = rng.uniform(-0.3, 0.3, (POSES, 3))
    poses = list(zip(position[:IN_LOOP], orientation[:IN_LOOP], strict=True))
    found = evaluate_poses(platform, position[:IN_LOOP], orientation[:IN_LOOP])
    expected = np.array([one_pose(platform, *pose) for pose in poses])
    together = np.array([found.reachable, found.condition_number, found.payload, found.force_margin], dtype=float).T
    if not np.allclose(together, expected, rtol=1e-9):
        Console().print("the loop finds something else", style="bold red")
        return 1
    whole = best(lambda: evaluate_poses(platform, position, orientation))
    loop = best(lambda: [one_pose(platform, *pose) for pose in poses]) * POSES / IN_LOOP
    table = Table(f"workspace, {POSES:,} poses", "measured", "target")
    table.add_row("together", f"{whole:.2f} s, {1e6 * whole / POSES:.1f} µs per pose", f"{TARGET:g} s")
    table.add_row("a pose at a time", f"{loop:.0f} s, {loop / whole:.0f} × as long", "")
    Console().print(table)
    if whole > TARGET:
        Console().print("missed: workspace", style="bold red")
    return 0


if __name__ == "__main__":
    sys.exit(main())
