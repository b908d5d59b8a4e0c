"""Draws docs/figures/fastest.svg, the limits along a fastest path, of docs/motion.md: `make figures`."""

import matplotlib.style as mpl_style
import numpy as np
from matplotlib.figure import Figure
from saving import save_svg

from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.motion.limits.shares import shares_along
from gough_stewart.model.platform import load_preset

STYLE = {"font.family": "DejaVu Sans", "font.size": 10, "svg.fonttype": "path", "svg.hashsalt": "gough-stewart"}
LIMITS = {
    "leg_velocity_max": ("leg velocity", "#0072B2"),
    "actuator_force_max": ("force", "#D55E00"),
    "actuator_power_max": ("power", "#009E73"),
}


def main() -> None:
    """Write the picture beside this file."""
    platform = load_preset("motion_base")
    with mpl_style.context(["default", STYLE]):
        figure = Figure(figsize=(8, 4.4), layout="constrained")
        rows = figure.subplots(2, 1, sharex=True, sharey=True)
        for axes, ramp in zip(rows, ("0 s", "20 ms"), strict=True):
            settings = {"reference.ramp": ramp, "reference.at": 0}
            reference = load_experiment("fastest_path", settings).reference.about(platform)
            time = np.linspace(0, reference.end, 2000)
            of = shares_along(platform, time, reference(time)).of
            for limit, (label, colour) in LIMITS.items():
                axes.plot(time, 100 * of[limit].max(axis=1), color=colour, lw=1.3, label=label)
            axes.axhline(90, color="#888888", lw=0.7, ls="--")
            axes.set(ylabel="of the limit [%]", ylim=(0, 105), xlim=(0, reference.end))
            axes.set_title(f"ramp of {ramp}: {reference.end:.3f} s", loc="left", fontsize=10)
            axes.spines[["top", "right"]].set_visible(False)
        rows[0].legend(loc="lower center", frameon=False, ncols=3)
        rows[1].set_xlabel("time [s]")
        save_svg("fastest.svg", figure)


if __name__ == "__main__":
    main()
