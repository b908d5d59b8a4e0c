"""Draws docs/figures/platform.svg, the picture of README and docs/notation.md: `make figures`."""

import matplotlib.style as mpl_style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from saving import save_svg

from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.platform import load_preset

STYLE = {"font.family": "DejaVu Sans", "font.size": 10, "svg.fonttype": "path", "svg.hashsalt": "gough-stewart"}
INK, BASE, TOP, LOWER, UPPER, FORCE = "#222222", "#6B7785", "#0072B2", "#8A6D3B", "#D9A441", "#C0392B"
Points = NDArray[np.float64]


def camera(points: Points) -> Points:
    """Orthographic view from azimuth −55°, elevation 24°: world (..., 3) to paper (..., 2)."""
    azimuth, elevation = np.radians(-55), np.radians(24)
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0])
    up = np.array([-np.sin(elevation) * np.cos(azimuth), -np.sin(elevation) * np.sin(azimuth), np.cos(elevation)])
    return np.stack([points @ right, points @ up], axis=-1)


def arrow(axes: Axes, start: Points, end: Points, colour: str, label: str = "", offset: Points | None = None) -> None:
    """Arrow on paper with a label beyond its head."""
    axes.annotate(
        "", end, start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.6, "shrinkA": 0, "shrinkB": 0}
    )
    if label:
        away = (end - start) / np.linalg.norm(end - start) * 0.16 if offset is None else offset
        axes.text(*(end + away), label, color=colour, ha="center", va="center")


def frame(axes: Axes, origin: Points, rotation: Points, size: float, names: tuple[str, str, str]) -> None:
    """Three axes of a frame."""
    for direction, name in zip(rotation.T, names, strict=True):
        arrow(axes, camera(origin), camera(origin + size * direction), INK, name)


def overview(axes: Axes) -> None:
    """The published platform in its home pose."""
    platform = load_preset("liu2000")
    t = platform.home_position
    legs = leg_geometry(platform, t, platform.home_orientation)
    B, P = platform.base_points, t + legs.arm
    around_B, around_P = np.argsort(np.arctan2(B[:, 0], B[:, 1])), np.argsort(np.arctan2(P[:, 0], P[:, 1]))
    axes.fill(*camera(B[around_B]).T, facecolor="#E8ECF0", edgecolor=BASE, lw=1.6)
    for k in range(6):
        middle = B[k] + 0.52 * (P[k] - B[k])
        axes.plot(*camera(np.stack([B[k], middle])).T, color=LOWER, lw=5, solid_capstyle="round")
        axes.plot(*camera(np.stack([middle, P[k]])).T, color=UPPER, lw=2.6, solid_capstyle="round")
    axes.fill(*camera(P[around_P]).T, facecolor="#CFE3F2CC", edgecolor=TOP, lw=1.6, zorder=3)
    axes.plot(*camera(B).T, "o", color=BASE, ms=6, zorder=4)
    axes.plot(*camera(P).T, "o", color=TOP, ms=6, zorder=4)
    for k in range(6):
        outward_B, outward_P = B[k] / np.linalg.norm(B[k]), legs.arm[k] / np.linalg.norm(legs.arm[k])
        axes.text(*camera(B[k] + 0.36 * outward_B), f"$B_{k + 1}$", color=BASE, ha="center", va="center")
        axes.text(
            *camera(P[k] + 0.30 * outward_P + [0, 0, 0.04]),
            f"$P_{k + 1}$",
            color=TOP,
            ha="center",
            va="center",
            zorder=6,
        )
    frame(axes, np.zeros(3), np.eye(3), 0.9, ("$X_0$", "$Y_0$", "$Z_0$"))
    frame(axes, t, np.eye(3), 0.62, ("$x_p$", "$y_p$", "$z_p$"))
    axes.text(*(camera(t) + np.array([-0.20, -0.02])), "$O_p$", ha="center", va="center", zorder=5)
    arrow(axes, np.array([-2.2, 3.4]), np.array([-2.2, 2.6]), FORCE, "$g$")
    axes.set_xlim(-2.7, 2.7)
    axes.set_ylim(-1.35, 3.9)
    axes.set_title("World frame at the base, Z up; leg $i$ from $B_i$ to $P_i$", loc="left")


def one_leg(axes: Axes) -> None:
    """A leg with its centres of mass and the positive actuator force."""
    B, u = np.zeros(2), np.array([np.sin(0.32), np.cos(0.32)])
    across, L = np.array([u[1], -u[0]]), 4.0
    P = L * u

    def part(start: float, end: float, half: float, face: str) -> None:
        ends = [start * u - half * across, end * u - half * across, end * u + half * across, start * u + half * across]
        axes.fill(*np.array(ends).T, facecolor=face, edgecolor=INK, lw=1)

    part(0.0, 2.3, 0.17, LOWER)
    part(1.6, L, 0.09, UPPER)
    axes.plot(*np.stack([B, P]).T, "o", color=INK, ms=8, zorder=5)
    axes.text(*(B + np.array([-0.25, -0.22])), "$B_i$\nuniversal joint", ha="center", va="top")
    axes.text(*(P + np.array([0.0, 0.30])), "$P_i$  spherical joint", ha="center", va="bottom")
    r1, d = 1.1, 1.2
    for along, name in ((r1, "$G_{i,1}$"), (L - d, "$G_{i,2}$")):
        axes.plot(*(along * u), marker="o", color="white", markeredgecolor=INK, ms=8, zorder=6)
        axes.text(*(along * u - 0.36 * across), name, ha="center", va="center")

    def measure(start: float, end: float, at: float, text: str) -> None:
        a, b = start * u + at * across, end * u + at * across
        axes.annotate("", b, a, arrowprops={"arrowstyle": "<|-|>", "color": BASE, "lw": 1, "shrinkA": 0, "shrinkB": 0})
        axes.text(
            *((a + b) / 2 + np.sign(at) * 0.17 * across), text, color=BASE, rotation=np.degrees(np.arctan2(u[1], u[0])),
            ha="center", va="center", rotation_mode="anchor", size=9,
        )  # fmt: skip

    measure(0, r1, 1.25, "leg_lower_com")
    measure(L - d, L, 1.25, "leg_upper_com")
    measure(0, L, -0.72, "leg_length")
    for sign, name in ((1, "$+F_i$ on the\nupper part"), (-1, "$-F_i$ on the\nlower part")):
        tail = (2.05 + 0.1 * sign) * u + 0.38 * across
        arrow(axes, tail, tail + 0.7 * sign * u, FORCE, name, np.array([0.66, -0.10 - 0.42 * sign]))
    arrow(axes, -1.35 * across + 0.6 * u, -1.35 * across + 1.3 * u, INK, "$u_i$")
    axes.set_xlim(-1.6, 3.0)
    axes.set_ylim(-1.0, 4.6)
    axes.set_title("actuator_force > 0 extends the leg", loc="left")


def main() -> None:
    """Write the picture beside this file."""
    with mpl_style.context(STYLE, after_reset=True):
        figure = Figure(figsize=(9.6, 4.9), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=[1.35, 1])
        for axes, draw in ((left, overview), (right, one_leg)):
            draw(axes)
            axes.set_aspect("equal")
            axes.axis("off")
        save_svg("platform.svg", figure)


if __name__ == "__main__":
    main()
