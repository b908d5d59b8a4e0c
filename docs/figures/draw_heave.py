"""Draws docs/figures/heave.svg, the picture of README's closed loop: `make figures`."""

from saving import save_svg

from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.experiment.run import run
from gough_stewart.harness.report.figures import figures


def main() -> None:
    """Write the picture beside this file."""
    save_svg("heave.svg", figures(run(load_experiment("heave_step")).report(), ("svg",), "pose")["pose.svg"])


if __name__ == "__main__":
    main()
