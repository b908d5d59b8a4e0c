"""Draws docs/figures/shares.svg, the picture of docs/motion.md: `make figures`."""

from saving import save_svg

from gough_stewart.harness.experiment.checking import check
from gough_stewart.harness.report.figures import figures


def main() -> None:
    """Write the picture beside this file."""
    found = check("pitch_sine", {"reference.frequency": 2.5, "loop.duration": 4})
    save_svg("shares.svg", figures(found.report(), ("svg",))["shares.svg"])


if __name__ == "__main__":
    main()
