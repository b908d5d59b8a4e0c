"""Draws docs/figures/paper.svg, the paper's figures 4 to 7 as one picture: `make figures`."""

import matplotlib.style as mpl_style
from matplotlib.figure import Figure
from saving import save_svg

from gough_stewart.harness.paper.open_loop import run_kernel
from gough_stewart.harness.report.plotting import COLOURS, DASHES, STYLE
from gough_stewart.model.formulations.cases import paper_case

PANELS = (
    ("position", "Fig. 4: position of Op [m]", ("x", "y", "z")),
    ("orientation", "Fig. 4: roll, pitch, yaw [rad]", ("roll", "pitch", "yaw")),
    ("velocity", "Fig. 5: velocity of Op [m/s]", ("x", "y", "z")),
    ("angular_velocity", "Fig. 5: angular velocity [rad/s]", ("x", "y", "z")),
    ("leg_length", "Fig. 6: length of legs [m]", tuple("123456")),
    ("leg_velocity", "Fig. 7: sliding velocity of legs [m/s]", tuple("123456")),
)


def main() -> None:
    """Write the picture beside this file."""
    run = run_kernel(paper_case())
    with mpl_style.context({**STYLE, "svg.fonttype": "path"}, after_reset=True):
        figure = Figure(figsize=(10.2, 4.6))
        for axes, (name, title, names) in zip(figure.subplots(2, 3).T.flat, PANELS, strict=True):
            for k, line in enumerate(names):
                axes.plot(run.time, run[name][:, k], color=COLOURS[k], linestyle=DASHES[k], label=line)
            axes.set_title(title)
            axes.margins(x=0)
            axes.legend(ncols=2 if len(names) == 6 else 1, fontsize=8)
            axes.set_xlabel("time [s]")
        save_svg("paper.svg", figure)


if __name__ == "__main__":
    main()
