"""Steps a second and core of vector environments: `make bench`.

The heave step at 1 kHz with noise and quantisation, its reference observed beside the measurements, and the reward of
a metric: forces at every sample, and poses held for 20 of them. Best of several rounds, in processor time; resets of
ended episodes are among the steps.
"""

import sys
import time

import numpy as np
from rich.console import Console
from rich.table import Table

import gough_stewart as gs

ROUNDS, STEPS = 5, 2000
SETTINGS = {"loop.duration": 0.5, "sensors.noise.leg_length": "5 um"}
OBSERVED = ["leg_length", "leg_velocity", "reference.leg_length"]
# Members, and the least steps of 1 ms a second of forces.
LEAST = {16: 120_000, 512: 400_000}


def samples_a_second(members: int, actions: str, hold: int) -> float:
    """Samples of all members in a second of processor time."""
    env = gs.vector_env(
        "heave_step",
        members,
        SETTINGS,
        actions="force" if actions == "force" else "pose",
        observations=OBSERVED,
        hold=hold,
    )
    env.reset(seed=1)
    space, rng = env.single_action_space, np.random.default_rng(1)
    centre = (space.low + space.high) / 2  # type: ignore[attr-defined]
    taken = centre + 1e-3 * rng.standard_normal((members, 6))
    rounds = []
    for _ in range(ROUNDS):
        start = time.thread_time()
        for _ in range(STEPS // hold):
            env.step(taken)
        rounds.append(time.thread_time() - start)
    return STEPS // hold * hold * members / min(rounds)


def main() -> int:
    """Print the table; 1 if forces miss their figures."""
    table = Table("members", "actions", "steps of 1 ms a second and core", "at least")
    missed = False
    for members, least in LEAST.items():
        forces, poses = samples_a_second(members, "force", 1), samples_a_second(members, "pose", 20)
        table.add_row(str(members), "forces", f"{forces:,.0f}", f"{least:,}")
        table.add_row("", "poses, held for 20 steps", f"{poses:,.0f}", "")
        missed |= forces < least
    Console().print(table)
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
