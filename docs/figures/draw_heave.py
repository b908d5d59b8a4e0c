"""Draws docs/figures/heave.svg, the picture of README's closed loop: `make figures`."""

from pathlib import Path

from gough_stewart.harness.experiment_file import shipped_experiment
from gough_stewart.harness.run import run
from gough_stewart.harness.run_figures import run_figures


def main() -> None:
    """Write the picture beside this file."""
    drawn = run_figures(run(shipped_experiment("heave_step")))["pose.svg"].decode()
    # matplotlib leaves spaces at line ends
    lines = "\n".join(line.rstrip() for line in drawn.splitlines())
    Path(__file__).with_name("heave.svg").write_text(lines + "\n")


if __name__ == "__main__":
    main()
