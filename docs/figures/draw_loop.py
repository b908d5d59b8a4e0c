"""Draws docs/figures/loop.svg, the block diagram of docs/control.md: `make figures`."""

from itertools import pairwise

import matplotlib.style as mpl_style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Rectangle
from saving import save_svg

STYLE = {"font.family": "DejaVu Sans", "font.size": 9, "svg.fonttype": "path", "svg.hashsalt": "gough-stewart"}
INK, DIGITAL, PHYSICAL = "#222222", "#E3EEF7", "#F6EAD7"
# The band of the main signals, and those of feedforward and measurement.
MAIN, ABOVE, BELOW = 2.0, 3.55, 0.45


def block(axes: Axes, x: float, y: float, text: str, colour: str, width: float = 1.5) -> None:
    """Draw a block about (x, y)."""
    axes.add_patch(
        FancyBboxPatch(
            (x - width / 2, y - 0.42), width, 0.84, boxstyle="round,pad=0,rounding_size=0.08", fc=colour, ec=INK, lw=1.2
        )
    )
    axes.text(x, y, text, ha="center", va="center", color=INK, linespacing=1.25)


def joint(axes: Axes, x: float, y: float) -> None:
    """Draw a summing point."""
    axes.add_patch(Circle((x, y), 0.13, fc="white", ec=INK, lw=1.2, zorder=3))


def wire(axes: Axes, *points: tuple[float, float]) -> None:
    """Draw lines from point to point, with an arrow at the end."""
    for (x0, y0), (x1, y1) in pairwise(points[:-1]):
        axes.plot([x0, x1], [y0, y1], color=INK, lw=1.2, solid_capstyle="round")
    axes.annotate(
        "",
        points[-1],
        points[-2],
        arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.2, "shrinkA": 0, "shrinkB": 0},
    )


def name(axes: Axes, x: float, y: float, text: str, **how: str) -> None:
    """Write the name of a signal."""
    axes.text(x, y, text, ha=how.get("ha", "center"), va=how.get("va", "bottom"), color=INK, style="italic")


def draw(axes: Axes) -> None:
    """Draw reference, controller, actuators, plant and sensors, in the sampled and the continuous part."""
    axes.add_patch(Rectangle((-0.9, -0.25), 7.35, 4.55, fc="none", ec="#7A8CA0", ls="--", lw=1))
    axes.text(-0.8, 4.15, "sample_time: computed", color="#5A6B7D", va="top")
    axes.add_patch(Rectangle((6.65, -0.25), 6.95, 4.55, fc="none", ec="#A08C60", ls="--", lw=1))
    axes.text(6.75, 4.15, "plant_step: physical", color="#806C40", va="top")
    block(axes, 0, MAIN, "reference\nmotion", DIGITAL)
    block(axes, 3.1, MAIN, "controller\nPD · PID · own", DIGITAL, 1.7)
    block(axes, 3.1, ABOVE - 0.15, "feedforward\ngravity · inverse dyn.", DIGITAL, 2.1)
    block(axes, 5.55, MAIN, "force\nlimit", DIGITAL, 1.1)
    block(axes, 7.35, MAIN, "delay\nhold", PHYSICAL, 1.1)
    block(axes, 9.15, MAIN, "rate limit\nlag", PHYSICAL, 1.3)
    block(axes, 11.35, MAIN, "platform\nmodel · FMU", PHYSICAL, 1.6)
    block(axes, 8.1, BELOW, "noise · quantisation", PHYSICAL, 2.0)
    joint(axes, 1.5, MAIN)
    joint(axes, 4.5, MAIN)
    wire(axes, (0.75, MAIN), (1.37, MAIN))
    wire(axes, (1.63, MAIN), (2.25, MAIN))
    wire(axes, (3.95, MAIN), (4.37, MAIN))
    wire(axes, (0, MAIN + 0.42), (0, ABOVE - 0.15), (2.05, ABOVE - 0.15))
    wire(axes, (4.15, ABOVE - 0.15), (4.5, ABOVE - 0.15), (4.5, MAIN + 0.13))
    wire(axes, (4.63, MAIN), (5.0, MAIN))
    wire(axes, (6.1, MAIN), (6.8, MAIN))
    wire(axes, (7.9, MAIN), (8.5, MAIN))
    wire(axes, (9.8, MAIN), (10.55, MAIN))
    wire(axes, (12.15, MAIN), (13.4, MAIN))
    wire(axes, (11.35, ABOVE - 0.15), (11.35, MAIN + 0.42))
    wire(axes, (12.75, MAIN), (12.75, BELOW), (9.1, BELOW))
    wire(axes, (7.1, BELOW), (1.5, BELOW), (1.5, MAIN - 0.13))
    wire(axes, (5.55, MAIN - 0.42), (5.55, 1.12), (3.1, 1.12), (3.1, MAIN - 0.42))
    name(axes, 1.06, MAIN + 0.06, "r")
    name(axes, 1.93, MAIN + 0.06, "e")
    name(axes, 1.42, MAIN - 0.42, "−", ha="right")
    name(axes, 4.82, MAIN + 0.06, "F")
    name(axes, 10.18, MAIN + 0.5, "actuator_force")
    name(axes, 12.8, MAIN + 0.06, "pose, legs", ha="center")
    name(axes, 11.35, ABOVE - 0.1, "external wrench, payload")
    name(axes, 3.9, BELOW + 0.06, "measured y")
    name(axes, 4.35, 1.16, "excess (anti-windup)")


def main() -> None:
    """Write the picture beside this file."""
    with mpl_style.context(STYLE, after_reset=True):
        figure = Figure(figsize=(10.6, 3.7))
        axes = figure.add_axes((0.005, 0.01, 0.99, 0.98))
        draw(axes)
        axes.set(xlim=(-1.0, 13.75), ylim=(-0.4, 4.45))
        axes.set_aspect("equal")
        axes.axis("off")
        save_svg("loop.svg", figure)


if __name__ == "__main__":
    main()
