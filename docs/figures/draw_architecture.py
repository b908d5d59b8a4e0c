"""Draws docs/figures/architecture.svg, the data flow between the three packages: `make figures`."""

import matplotlib.style as mpl_style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Rectangle
from saving import save_svg

STYLE = {"font.family": "DejaVu Sans", "font.size": 9, "svg.fonttype": "path", "svg.hashsalt": "gough-stewart"}
INK, FAINT = "#222222", "#5A6B7D"
MODEL, BUILD, HARNESS, YOURS = "#E3EEF7", "#F6EAD7", "#E4F1E4", "#FFFFFF"
# The rows: input of the user, two rows of blocks, output to the user.
GIVEN, UPPER, LOWER, MADE = 5.55, 3.95, 2.35, 0.55


def package(axes: Axes, left: float, right: float, title: str, colour: str) -> None:
    """The frame of a package with its name."""
    axes.add_patch(Rectangle((left, 1.45), right - left, 3.45, fc=colour, ec=FAINT, lw=1))
    axes.text(left + 0.15, 4.77, title, color=INK, va="top", weight="bold")


def block(axes: Axes, x: float, y: float, text: str, width: float, yours: bool = False) -> None:
    """A block about (x, y); dashed if the user supplies it."""
    axes.add_patch(
        FancyBboxPatch(
            (x - width / 2, y - 0.36),
            width,
            0.72,
            boxstyle="round,pad=0,rounding_size=0.08",
            fc=YOURS,
            ec=INK,
            lw=1.2,
            ls="--" if yours else "-",
        )
    )
    axes.text(x, y, text, ha="center", va="center", color=INK, linespacing=1.25)


def arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], text: str = "", right: bool = True) -> None:
    """An arrow from start to end, with its name beside it if vertical, or above it if horizontal."""
    style = {"arrowstyle": "-|>", "color": INK, "lw": 1.2, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, start, arrowprops=style)
    x, y = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
    if start[0] == end[0]:
        axes.text(x + (0.1 if right else -0.1), y, text, ha="left" if right else "right", va="center", color=FAINT)
    else:
        axes.text(x, y + 0.07, text, ha="center", va="bottom", color=FAINT)


def draw(axes: Axes) -> None:
    """Draw the flow from platform and equations to FMU and records."""
    package(axes, 0.0, 4.1, "model", MODEL)
    package(axes, 5.1, 7.7, "fmu_build", BUILD)
    package(axes, 8.7, 12.8, "harness", HARNESS)
    block(axes, 1.0, UPPER, "platform", 1.5)
    block(axes, 3.05, UPPER, "equations", 1.6)
    block(axes, 1.0, LOWER, "stepping\nmodel", 1.5)
    block(axes, 3.05, LOWER, "kernel", 1.6)
    block(axes, 6.4, UPPER, "C core", 1.9)
    block(axes, 6.4, LOWER, "compiler", 1.9)
    block(axes, 9.75, UPPER, "plant", 1.6)
    block(axes, 11.8, UPPER, "loop", 1.5)
    block(axes, 9.75, LOWER, "reproduction", 1.6)
    block(axes, 11.8, LOWER, "record", 1.5)
    arrow(axes, (1.75, UPPER), (2.25, UPPER))
    arrow(axes, (3.05, UPPER - 0.36), (3.05, LOWER + 0.36), "traced")
    arrow(axes, (2.25, LOWER), (1.75, LOWER))
    arrow(axes, (3.85, LOWER), (5.45, LOWER), "C code")
    arrow(axes, (6.4, UPPER - 0.36), (6.4, LOWER + 0.36))
    arrow(axes, (10.55, UPPER), (11.05, UPPER))
    arrow(axes, (11.05, UPPER - 0.12), (10.55, UPPER - 0.12))
    arrow(axes, (11.8, UPPER - 0.36), (11.8, LOWER + 0.36))
    arrow(axes, (9.75, UPPER - 0.36), (9.75, LOWER + 0.36))
    # input of the user
    block(axes, 1.0, GIVEN, "platform file, TOML", 2.0, yours=True)
    block(axes, 9.65, GIVEN, "experiment file, TOML", 2.2, yours=True)
    block(axes, 11.85, GIVEN, "your controller", 1.9, yours=True)
    arrow(axes, (1.0, GIVEN - 0.36), (1.0, UPPER + 0.36))
    arrow(axes, (9.75, GIVEN - 0.36), (9.75, UPPER + 0.36))
    arrow(axes, (11.8, GIVEN - 0.36), (11.8, UPPER + 0.36))
    # output to the user
    block(axes, 1.0, MADE, "your Python", 2.0, yours=True)
    block(axes, 6.4, MADE, "FMU 2.0, FMU 3.0:\nyour simulator", 2.3, yours=True)
    block(axes, 9.75, MADE, "report, figures", 1.8, yours=True)
    block(axes, 11.8, MADE, "CSV, Parquet,\nfigures", 1.7, yours=True)
    for x in (1.0, 6.4, 9.75, 11.8):
        arrow(axes, (x, LOWER - 0.36), (x, MADE + 0.36))
    # both plants of the harness
    axes.plot([7.35, 8.2, 8.2], [LOWER, LOWER, UPPER - 0.12], color=INK, lw=1.2)
    arrow(axes, (8.2, UPPER - 0.12), (8.95, UPPER - 0.12))
    axes.text(8.2, LOWER - 0.1, "FMU", ha="center", va="top", color=FAINT)
    axes.plot([0.25, -0.3, -0.3, 8.2, 8.2], [LOWER, LOWER, 5.05, 5.05, UPPER + 0.12], color=INK, lw=1.2)
    arrow(axes, (8.2, UPPER + 0.12), (8.95, UPPER + 0.12))
    axes.text(4.6, 5.1, "the same plant in process", ha="center", va="bottom", color=FAINT)


def main() -> None:
    """Write the picture beside this file."""
    with mpl_style.context(STYLE, after_reset=True):
        figure = Figure(figsize=(10.6, 5.0))
        axes = figure.add_axes((0.005, 0.01, 0.99, 0.98))
        draw(axes)
        axes.set(xlim=(-0.45, 12.95), ylim=(0.0, 6.1))
        axes.set_aspect("equal")
        axes.axis("off")
        save_svg("architecture.svg", figure)


if __name__ == "__main__":
    main()
