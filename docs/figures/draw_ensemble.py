"""Draws docs/figures/ensemble.svg, the picture of docs/ensembles.md: `make figures`."""

import numpy as np
import polars
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from saving import save_svg

from gough_stewart.harness.ensemble.ensemble import ensemble
from gough_stewart.harness.report.plotting import COLOURS, files_of
from gough_stewart.model.kinematics import leg_jacobian
from gough_stewart.model.platform import load_preset

SPREADS = (0.02, 0.05, 0.1, 0.15, 0.2)  # [mm]
TARGET = 0.1  # [mm]


def bands(spread: float) -> polars.DataFrame:
    """Bands of the distance of Op from home [m], for a thousand machines with this spread of their joints [mm]."""
    joints = {"normal": f"{spread} mm"}
    varied = {"members": 1000, "seed": 1, "base_points": joints, "platform_points": joints}
    settings = {
        "controller": {"type": "pd", "bandwidth": "4 Hz", "feedforward": "computed_torque"},
        "ensemble": varied,
        "loop.duration": "0.8 s",
        "loop.sample_time": "5 ms",
    }
    return ensemble("hold_against_gravity", settings).bands.filter(signal="error.position.norm")


def over_time(axes: Axes, found: polars.DataFrame) -> None:
    """Draw the bands of one ensemble."""
    time = found["time"].to_numpy()
    lines = {name: 1e3 * found[name].to_numpy() for name in ("q05", "q25", "q50", "q75", "q95", "highest")}
    axes.fill_between(time, lines["q05"], lines["q95"], color=COLOURS[0], alpha=0.22, linewidth=0, label="5 to 95 %")
    axes.fill_between(time, lines["q25"], lines["q75"], color=COLOURS[0], alpha=0.35, linewidth=0, label="25 to 75 %")
    axes.plot(time, lines["q50"], color=COLOURS[0], label="median")
    axes.plot(time, lines["highest"], color="#777777", linewidth=0.8, label="highest")
    axes.set_title(f"1000 machines, joints made to {SPREADS[-1]:g} mm")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("error of Op [mm]")
    axes.set_ylim(0, 1.25 * lines["highest"].max())
    axes.legend(loc="upper left", fontsize=8, ncols=2)


def over_spread(axes: Axes, found: list[polars.DataFrame]) -> None:
    """Draw quantiles at rest, with those of first-order geometry."""
    platform = load_preset("motion_base")
    J = leg_jacobian(platform, platform.home_position, platform.home_orientation)
    covariance = 2 * np.linalg.inv(J.T @ J)[:3, :3]
    unit = np.linalg.norm(np.random.default_rng(1).multivariate_normal(np.zeros(3), covariance, 200_000), axis=1)
    for name, level, colour in (("q95", 0.95, COLOURS[1]), ("q50", 0.5, COLOURS[0])):
        axes.plot(SPREADS, [1e3 * each[name][-1] for each in found], "o", color=colour, label=f"{100 * level:g} %")
        slope = float(np.quantile(unit, level))
        axes.plot([0, SPREADS[-1]], [0, slope * SPREADS[-1]], color=colour, linewidth=1)
        if name == "q95":
            axes.plot([0, TARGET / slope, TARGET / slope], [TARGET, TARGET, 0], "--", color="black", linewidth=1)
            axes.annotate(f"{TARGET / slope:.3f} mm", (TARGET / slope, 0), (4, 4), textcoords="offset points")
    axes.set_title("At rest: dots as run, lines first-order geometry")
    axes.set_xlabel("standard deviation of each joint coordinate [mm]")
    axes.set_xlim(0, 1.05 * SPREADS[-1])
    axes.set_xticks([0, *SPREADS[1:]])
    axes.set_ylim(0, None)
    axes.legend(loc="upper left")


def main() -> None:
    """Write the picture beside this file."""
    found = [bands(spread) for spread in SPREADS]

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        over_time(left, found[-1])
        over_spread(right, found)

    save_svg("ensemble.svg", files_of(draw, 9.0, 3.4, ("svg",))["svg"])


if __name__ == "__main__":
    main()
