"""The paper's figures 4 to 7, and the drift of the constraints, as PNG."""

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gough_stewart.harness.paper.open_loop import Trajectory
from gough_stewart.harness.report.plotting import COLOURS, DASHES, label, panels, png
from gough_stewart.model.formulations.cases import OpenLoopCase
from gough_stewart.model.formulations.kane import KaneTrajectory
from gough_stewart.model.vectors import FloatArray


def open_loop_figures(case: OpenLoopCase, run: Trajectory) -> dict[str, bytes]:
    """File name to PNG of figures 4 to 7."""
    t = run.time
    platform = case.platform.name

    def pose(figure: Figure) -> None:
        left, right = panels(figure, f"Fig. 4 — Position and orientation of the platform ({platform})", 2)
        _lines(left, t, run["position"], ("x", "y", "z"), "position of Op", "m")
        _lines(right, t, run["orientation"], ("roll α", "pitch β", "yaw γ"), "roll, pitch, yaw", "rad")

    def velocity(figure: Figure) -> None:
        left, right = panels(figure, f"Fig. 5 — Linear and angular velocities of the platform ({platform})", 2)
        _lines(left, t, run["velocity"], ("v_x", "v_y", "v_z"), "velocity of Op", "m/s")
        _lines(right, t, run["angular_velocity"], ("ω_x", "ω_y", "ω_z"), "angular velocity, world", "rad/s")

    legs = tuple(f"leg {i}" for i in range(1, 7))

    def lengths(figure: Figure) -> None:
        (axes,) = panels(figure, f"Fig. 6 — The length of legs ({platform})")
        _lines(axes, t, run["leg_length"], legs, "leg length", "m")

    def sliding(figure: Figure) -> None:
        (axes,) = panels(figure, f"Fig. 7 — Sliding velocities between two parts of legs ({platform})")
        _lines(axes, t, run["leg_velocity"], legs, "sliding velocity", "m/s")

    return {
        "figure-4.png": png(pose, 8.0),
        "figure-5.png": png(velocity, 8.0),
        "figure-6.png": png(lengths, 6.0),
        "figure-7.png": png(sliding, 6.0),
    }


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


def _lines(axes: Axes, time: FloatArray, values: FloatArray, labels: tuple[str, ...], title: str, unit: str) -> None:
    for k, name in enumerate(labels):
        axes.plot(time, values[:, k], color=COLOURS[k], linestyle=DASHES[k], label=name)
    label(axes, title, unit)
    axes.legend(ncols=2 if len(labels) > 3 else 1)
