"""The paper's figures 4 to 7, and the drift of the constraints, as PNG."""

from typing import Any

from matplotlib.figure import Figure

from gough_stewart.harness.paper.open_loop import Trajectory
from gough_stewart.harness.report.plotting import COLOURS, DASHES, label, panels, png
from gough_stewart.model.formulations.cases import OpenLoopCase
from gough_stewart.model.formulations.kane import KaneTrajectory

_LEGS = tuple(f"leg {k}" for k in range(1, 7))
# Title by number of the figure, and its panels: result, names of its components, title, unit.
_FIGURES: dict[int, tuple[str, tuple[tuple[str, tuple[str, ...], str, str], ...]]] = {
    4: (
        "Position and orientation of the platform",
        (
            ("position", ("x", "y", "z"), "position of Op", "m"),
            ("orientation", ("roll α", "pitch β", "yaw γ"), "roll, pitch, yaw", "rad"),
        ),
    ),
    5: (
        "Linear and angular velocities of the platform",
        (
            ("velocity", ("v_x", "v_y", "v_z"), "velocity of Op", "m/s"),
            ("angular_velocity", ("ω_x", "ω_y", "ω_z"), "angular velocity, world", "rad/s"),
        ),
    ),
    6: ("The length of legs", (("leg_length", _LEGS, "leg length", "m"),)),
    7: ("Sliding velocities between two parts of legs", (("leg_velocity", _LEGS, "sliding velocity", "m/s"),)),
}


def open_loop_figures(case: OpenLoopCase, run: Trajectory) -> dict[str, bytes]:
    """File name to PNG of figures 4 to 7."""
    pictures = {}
    for number, (title, shown) in _FIGURES.items():

        def draw(figure: Figure, heading: str = f"Fig. {number} — {title}", shown: Any = shown) -> None:
            all_axes = panels(figure, f"{heading} ({case.platform.name})", len(shown))
            for axes, (name, components, what, unit) in zip(all_axes, shown, strict=True):
                for k, component in enumerate(components):
                    style = {"color": COLOURS[k], "linestyle": DASHES[k], "label": component}
                    axes.plot(run.time, run[name][:, k], **style)
                label(axes, what, unit)
                axes.legend(ncols=2 if len(components) > 3 else 1)

        pictures[f"figure-{number}.png"] = png(draw, 8.0 if len(shown) > 1 else 6.0)
    return pictures


def drift_figure(runs: dict[str, KaneTrajectory]) -> bytes:
    """PNG of the constraint violation of Kane's DAE at the integrator's steps; `runs` by legend label."""

    def draw(figure: Figure) -> None:
        left, right = panels(figure, "Drift of the constraints of Kane's DAE, at the steps of RK45", 2)
        for k, (name, run) in enumerate(runs.items()):
            style: dict[str, Any] = {"color": COLOURS[k], "linestyle": DASHES[k], "label": name}
            style.update(marker="o", markersize=3)
            # the consistent start has no violation, which a logarithmic axis cannot show
            left.semilogy(run.time[1:], run.position_violation[1:], **style)
            right.semilogy(run.time[1:], run.velocity_violation[1:], **style)
        label(left, "gap in the closures, largest |Φ|", "m")
        label(right, "slip of the constraints, largest |Φ_q y|", "m/s, rad/s")
        figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=2)

    return png(draw, 9.0, 4.4)
