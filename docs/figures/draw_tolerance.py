"""Draws docs/figures/tolerance.svg, the error over the work in docs/ensembles.md: `make figures`."""

import numpy as np
from matplotlib.figure import Figure
from saving import save_svg

from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.preparation import Batch
from gough_stewart.harness.loop.run import simulate
from gough_stewart.harness.plants.lanes import Stepping
from gough_stewart.harness.report.plotting import COLOURS, files_of
from gough_stewart.harness.sampling.variation import EnsembleChoice
from gough_stewart.model.vectors import FloatArray

TOLERANCES = (1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)
DEFAULT = EnsembleChoice.model_fields["tolerance"].default
SUBSTEPS = (1, 2, 4, 8, 16, 32)
MEMBERS = 16


def batch() -> Batch:
    """Machines in the heave step with friction of 0 to 100 N; no steps of encoders, which would hide small errors."""
    varied = {"members": MEMBERS, "seed": 1, "platform_mass": {"factor": {"uniform": [0.8, 1.3]}}}
    varied["leg_coulomb_friction"] = {"uniform": ["0 N", "100 N"]}
    settings = {"loop.duration": 1, "sensors.quantisation": {}, "ensemble": varied}
    members = Members(load_experiment("heave_step", settings))
    return members.preparation.members(members.draws(0, MEMBERS).values, range(MEMBERS))


def motion(members: Batch, stepping: Stepping) -> tuple[FloatArray, float]:
    """Signals of all rows (n, N, 24), and evaluations of the derivatives in a row, on average."""
    running = members.in_parallel(stepping)
    with running.plant:
        found = simulate(running.plant, running.law_from, running.loop)
        steps = float(running.plant.internal_steps.mean()) / running.loop.timing.steps
    return found.results[..., :24], 4 * (stepping.substeps or steps)


def main() -> None:
    """Write the picture beside this file."""
    members = batch()
    exact, _ = motion(members, Stepping(substeps=256))

    def error(stepping: Stepping) -> tuple[float, float]:
        found, work = motion(members, stepping)
        return work, float((np.abs(found - exact) / (1 + np.abs(exact))).max())

    own = [error(Stepping(tolerance=each)) for each in TOLERANCES]
    fixed = [error(Stepping(substeps=each)) for each in SUBSTEPS]

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.loglog(*zip(*own, strict=True), "o-", color=COLOURS[0], label="tolerance, each machine its own steps")
        axes.loglog(*zip(*fixed, strict=True), "s-", color=COLOURS[1], label="fixed steps of RK4, without an estimate")
        for (work, gap), tolerance in zip(own, TOLERANCES, strict=True):
            text = f"{tolerance:.0e}".replace("e-0", "e-") + (", default" if tolerance == DEFAULT else "")
            axes.annotate(text, (work, gap), (7, -3), textcoords="offset points", fontsize=7)
        for (work, gap), substeps in zip(fixed, SUBSTEPS, strict=True):
            axes.annotate(f"{substeps} a row", (work, gap), (7, 1), textcoords="offset points", fontsize=7)
        axes.set_title("heave_step at 1 kHz, 16 machines that stick at times")
        axes.set_xlabel("evaluations of the derivatives in a row, mean of all machines and rows")
        axes.set_ylabel("largest error of a run, |Δx| / (1 + |x|)")
        axes.grid(visible=True, which="major", alpha=0.3)
        axes.set_xticks([4, 8, 16, 32, 64, 128], [f"{each}" for each in (4, 8, 16, 32, 64, 128)])
        axes.minorticks_off()
        axes.legend(loc="upper right", fontsize=8)

    save_svg("tolerance.svg", files_of(draw, 7.0, 4.0, ("svg",))["svg"])


if __name__ == "__main__":
    main()
