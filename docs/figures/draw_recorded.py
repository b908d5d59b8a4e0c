"""Draws docs/figures/recorded.svg, a noisy log with and without smoothing, of docs/motion.md: `make figures`."""

import matplotlib.style as mpl_style
import numpy as np
from matplotlib.figure import Figure
from saving import save_svg

from gough_stewart.harness.motion.recorded.from_table import FromTable, smoothed
from gough_stewart.harness.motion.references import FromFile
from gough_stewart.model.platform import load_preset

STYLE = {"font.family": "DejaVu Sans", "font.size": 10, "svg.fonttype": "path", "svg.hashsalt": "gough-stewart"}
NOISE, RATE, CUTOFF = 2e-5, 200.0, 8.0  # [m], [Hz], [Hz]


def main() -> None:
    """Write the picture beside this file."""
    ride = FromFile(file="ride.csv", at_home="start").about(load_preset("motion_base"))
    rows = np.arange(0, 8 + 0.5 / RATE, 1 / RATE)
    motion = ride(rows)
    noise = NOISE * np.random.default_rng(1).standard_normal(motion.position.shape)
    noisy = FromTable(rows, motion.position + noise, motion.orientation)
    time = np.linspace(2.0, 4.0, 1001)
    with mpl_style.context(["default", STYLE]):
        figure = Figure(figsize=(8, 3.6), layout="constrained")
        axes = figure.subplots()
        for reference, colour, label, width in (
            (noisy, "#A9B2BC", "rows with 0.02 mm of noise", 0.7),
            (smoothed(noisy, CUTOFF), "#0072B2", "the same, smoothing = 8 Hz", 2.4),
            (ride, "#222222", "without noise", 0.8),
        ):
            axes.plot(time, reference(time).acceleration[:, 0], color=colour, lw=width, label=label)
        axes.set(xlabel="time [s]", ylabel="surge acceleration [m/s²]", xlim=(2, 4), ylim=(-10, 12))
        axes.legend(loc="upper right", frameon=False, ncols=3)
        axes.spines[["top", "right"]].set_visible(False)
        save_svg("recorded.svg", figure)


if __name__ == "__main__":
    main()
