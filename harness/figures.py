"""The paper's figures 4 to 7, and the drift of the constraints, as PNG."""

import warnings
from collections.abc import Callable
from io import BytesIO
from typing import Any

import matplotlib.style as mpl_style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gough_stewart.harness.open_loop import FloatArray, Trajectory
from gough_stewart.model.cases import OpenLoopCase
from gough_stewart.model.kane_simulation import KaneTrajectory

# Distinct in print and for colour-blind readers (Okabe & Ito, Color Universal Design, 2008).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
DASHES = ("-", "--", "-.", "-", "--", "-.")
STYLE: dict[str, Any] = {
    "figure.dpi": 150,
    "figure.constrained_layout.use": True,
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.7,
    "legend.frameon": False,
    "xtick.direction": "out",
    "ytick.direction": "out",
}
Draw = Callable[[Figure], None]


def open_loop_figures(case: OpenLoopCase, run: Trajectory) -> dict[str, bytes]:
    """File name to PNG of figures 4 to 7."""
    t = run.time
    platform = case.platform.name

    def pose(figure: Figure) -> None:
        left, right = _two_panels(figure, f"Fig. 4 — Position and orientation of the platform ({platform})")
        _lines(left, t, run["position"], ("x", "y", "z"), "position of Op", "m")
        _lines(right, t, run["orientation"], ("roll α", "pitch β", "yaw γ"), "roll, pitch, yaw", "rad")

    def velocity(figure: Figure) -> None:
        left, right = _two_panels(figure, f"Fig. 5 — Linear and angular velocities of the platform ({platform})")
        _lines(left, t, run["velocity"], ("v_x", "v_y", "v_z"), "velocity of Op", "m/s")
        _lines(right, t, run["angular_velocity"], ("ω_x", "ω_y", "ω_z"), "angular velocity, world", "rad/s")

    legs = tuple(f"leg {i}" for i in range(1, 7))

    def lengths(figure: Figure) -> None:
        axes = _panel(figure, f"Fig. 6 — The length of legs ({platform})")
        _lines(axes, t, run["leg_length"], legs, "leg length", "m")

    def sliding(figure: Figure) -> None:
        axes = _panel(figure, f"Fig. 7 — Sliding velocities between two parts of legs ({platform})")
        _lines(axes, t, run["leg_velocity"], legs, "sliding velocity", "m/s")

    return {
        "figure-4.png": _png(pose, 8.0),
        "figure-5.png": _png(velocity, 8.0),
        "figure-6.png": _png(lengths, 6.0),
        "figure-7.png": _png(sliding, 6.0),
    }


def drift_figure(runs: dict[str, KaneTrajectory]) -> bytes:
    """PNG of the constraint violation of Kane's DAE at the integrator's steps; `runs` by their legend."""

    def draw(figure: Figure) -> None:
        left, right = _two_panels(figure, "Drift of the constraints of Kane's DAE, at the steps of RK45")
        for k, (label, run) in enumerate(runs.items()):
            style: dict[str, Any] = {"color": COLOURS[k], "linestyle": DASHES[k], "label": label}
            style.update(marker="o", markersize=3)
            # the consistent start violates nothing, which a logarithm cannot show
            left.semilogy(run.time[1:], run.position_violation[1:], **style)
            right.semilogy(run.time[1:], run.velocity_violation[1:], **style)
        _label(left, "gap in the closures, largest |Φ|", "m")
        _label(right, "slip of the constraints, largest |Φ_q y|", "m/s, rad/s")
        figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=2)

    return _png(draw, 9.0, 4.4)


def _png(draw: Draw, width: float, height: float = 3.6) -> bytes:
    with mpl_style.context(STYLE, after_reset=True), warnings.catch_warnings():
        # a platform's name may be in any script; a box in its place is no reason to disturb the terminal
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        figure = Figure(figsize=(width, height))
        draw(figure)
        buffer = BytesIO()
        figure.savefig(buffer, format="png")
    return buffer.getvalue()


def _two_panels(figure: Figure, title: str) -> tuple[Axes, Axes]:
    figure.suptitle(title, x=0.01, ha="left", fontsize=10.5, fontweight="bold", parse_math=False)
    left, right = figure.subplots(1, 2)
    return left, right


def _panel(figure: Figure, title: str) -> Axes:
    figure.suptitle(title, x=0.01, ha="left", fontsize=10.5, fontweight="bold", parse_math=False)
    axes: Axes = figure.subplots()
    return axes


def _lines(axes: Axes, time: FloatArray, values: FloatArray, labels: tuple[str, ...], title: str, unit: str) -> None:
    for k, label in enumerate(labels):
        axes.plot(time, values[:, k], color=COLOURS[k], linestyle=DASHES[k], label=label)
    _label(axes, title, unit)
    axes.legend(ncols=2 if len(labels) > 3 else 1)


def _label(axes: Axes, title: str, unit: str) -> None:
    axes.set_title(title)
    axes.set_ylabel(f"[{unit}]")
    axes.set_xlabel("time [s]")
    axes.margins(x=0)
