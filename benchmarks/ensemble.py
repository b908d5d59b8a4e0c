"""Ensembles: closed loop, whole command, scaling and memory, `make bench`.

The closed loop of `heave_step` (1 kHz, PD in leg space, delay, quantisation, figures of merit): members against
the single run on the FMU, alternately, with one substep and with the number for a tolerance of 1e-8. The whole
command with its output files. Chunks with one and with two warm workers. Memory of the largest process of short runs.
"""

import os
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path

from rich.console import Console
from rich.table import Table

from gough_stewart.harness.ensemble.chunk import SIZE, limits_of_members
from gough_stewart.harness.ensemble.workers import Workers, chunks_here
from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.experiment.members import Members, varying_members
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.loop.rows import FoldsOfRows
from gough_stewart.harness.loop.run import observe, simulate
from gough_stewart.harness.plants.lanes import Stepping
from gough_stewart.harness.plants.open import cached_build
from gough_stewart.harness.plants.unit import FmuPlant
from gough_stewart.harness.results.metric_folds import metric_folds, metric_kernels

ROUNDS, MEMBERS = 3, 1000
VARIED = "ensemble.platform_mass={factor={uniform=[0.8,1.3]}}"
SHORT = ["loop.duration=0.5", "reference.at=0.1", VARIED]
MEMORY = (10_000, 100_000)
ENSEMBLE = """
import resource, sys, tempfile
import gough_stewart as gs
if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        gs.ensemble("heave_tolerances", {"loop.duration": 0.02}, members=int(sys.argv[1]), out=folder)
    usages = (resource.getrusage(each).ru_maxrss for each in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    print(max(usages) // 1024)
"""


def simulated_seconds(members: Members, stepping: Stepping) -> tuple[float, float]:
    """Simulated seconds per second: members on one core, and a single run on the FMU."""
    batch = members.preparation.members(members.draws(0, SIZE).values, range(SIZE))
    duration = batch.timing.duration
    # longer, so that its start is negligible
    single = prepare(load_experiment("heave_step", ["loop.duration=4"]))
    rounds = []
    for _ in range(ROUNDS):
        running = batch.in_parallel(stepping)
        limits = limits_of_members(batch, running.size)
        folds = metric_folds(running.loop.timing.times, running.loop.reference, limits)
        rows = FoldsOfRows(running.loop, folds, running.size, metric_kernels())
        start = time.perf_counter()
        with running.plant:
            observe(running.plant, running.law_from, running.loop, rows)
        many = time.perf_counter() - start
        unit = FmuPlant(cached_build("3.0"), single.machine, single.start)
        with unit as plant, single.law_in_a_run() as law_from:
            start = time.perf_counter()
            simulate(plant, law_from, single.loop)
            alone = time.perf_counter() - start
            rounds.append((SIZE * duration / many, single.loop.timing.duration / alone))
    return max(each[0] for each in rounds), max(each[1] for each in rounds)


def command() -> float:
    """Duration of the whole command [s]."""
    with tempfile.TemporaryDirectory() as folder:
        words = ["ensemble", "heave_step", "--set", VARIED, "--members", str(MEMBERS), "--out", folder]
        start = time.perf_counter()
        subprocess.run([sys.executable, "-m", "gough_stewart", *words], check=True, stdout=subprocess.DEVNULL)
        return time.perf_counter() - start


def scaling(members: Members) -> float:
    """Speed-up of two workers over one, without their start."""

    def seconds(workers: Workers | int, chunks: int) -> float:
        ranges = [(k * SIZE, (k + 1) * SIZE) for k in range(chunks)]
        start = time.perf_counter()
        for _ in chunks_here(members, ranges, workers):
            pass
        return time.perf_counter() - start

    with closing(Workers(2)) as two:
        seconds(two, 8)  # imports modules
        return seconds(1, 12) / seconds(two, 12)


def megabytes(members: int) -> int:
    """Peak memory of the largest process of an ensemble [MB]."""
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder, "ensemble.py")
        script.write_text(ENSEMBLE)
        done = subprocess.run([sys.executable, script, str(members)], check=True, capture_output=True, text=True)
    return int(done.stdout)


def main() -> int:
    """Measure and print; 1 if a target is missed."""
    members = varying_members(load_experiment("heave_step", [*SHORT, f"ensemble.members={12 * SIZE}"]))
    once, single = simulated_seconds(members, Stepping(substeps=1))
    needed, _ = simulated_seconds(members, members.stepping)
    whole = command()
    faster = scaling(members) if (os.cpu_count() or 1) > 1 else float("nan")
    memory = [megabytes(number) for number in MEMORY]
    table = Table("what", "measured", "target", "", title="ensembles")
    missed = 0
    for what, measured, target, holds in (
        ("simulated s per s and core, 1 substep", f"{once:.0f}", ">= 1500", once >= 1500),
        (f"the same, tolerance {members.stepping.tolerance:g}", f"{needed:.0f}", "", True),
        ("against the single run on the FMU", f"{once / single:.0f} ×", ">= 30 ×", once >= 30 * single),
        (f"{MEMBERS} members of heave_step, the command", f"{whole:.1f} s", "<= 10 s", whole <= 10),
        ("two workers against one", f"{faster:.2f} ×", ">= 1.8 ×", faster >= 1.8),
        (f"memory at {MEMORY[0]} members", f"{memory[0]} MB", "", True),
        (f"memory at {MEMORY[1]} members", f"{memory[1]} MB", "<= 1500 MB", memory[1] <= 1500),
    ):
        missed += not holds
        table.add_row(what, measured, target, "ok" if holds else "missed")
    Console().print(table)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
