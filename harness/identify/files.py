"""The files of an identification, with its figures: intervals and correlation, fit and residuals."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from gough_stewart.harness.identify.estimate import Estimate
from gough_stewart.harness.identify.report import estimate_report
from gough_stewart.harness.output.colours import COLOURS
from gough_stewart.harness.output.plotting import entitle, label, pictures
from gough_stewart.harness.output.tables import Sheet
from gough_stewart.harness.report.page import page_of
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import platform_to_toml

FIGURES = ("fit", "parameters")
FILES = (
    "platform.toml",
    "estimate.json",
    *(f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg")),
    "identify.html",
)


def identification_files(estimate: Estimate, nominal: Platform, more: Sequence[Sheet] = ()) -> dict[str, bytes]:
    """Contents by file name: the platform file for `run`, numbers, figures, and the page with `more` tables.

    Raises
    ------
    PlatformError
        The estimated values are not possible together with the rest of the nominal platform.
    """
    return {
        "platform.toml": platform_to_toml(estimate.platform(nominal)).encode(),
        "estimate.json": estimate.to_json(),
        **identification_figures(estimate),
        "identify.html": page_of(estimate_report(estimate, nominal.name, more)),
    }


def identification_figures(estimate: Estimate) -> dict[str, bytes]:
    """Figures as PNG and SVG by file name; the fit only if it is over time."""
    rows = len(estimate.names)
    files = pictures("parameters", lambda figure: _parameters(figure, estimate), 10.0, 1.6 + 0.28 * rows)
    if "time" in estimate.details:
        files |= pictures("fit", lambda figure: _fit(figure, estimate), 10.0, 5.6)
    return files


def _parameters(figure: Figure, estimate: Estimate) -> None:
    entitle(figure, "Identified parameters: change with 95 % intervals, and correlation")
    left, right = figure.subplots(1, 2, width_ratios=[1.3, 1])
    at, scale = np.arange(len(estimate.names)), 100 / estimate.scale
    half = (estimate.values - estimate.interval[:, 0]) * scale
    left.errorbar((estimate.values - estimate.nominal) * scale, at, xerr=half, fmt="o", color=COLOURS[0], capsize=3)
    left.axvline(0.0, color="#555555", linewidth=0.9)
    left.set_yticks(at, estimate.names)
    left.invert_yaxis()
    left.set_xlabel("identified − nominal [% of scale]")
    image = right.imshow(estimate.correlation, vmin=-1, vmax=1, cmap="RdBu", aspect="auto")
    right.set_yticks([])
    right.set_xticks(at, estimate.names, rotation=90, fontsize=7)
    right.grid(visible=False)
    figure.colorbar(image, ax=right)


def _fit(figure: Figure, estimate: Estimate) -> None:
    found, residuals = estimate.details, estimate.residuals
    unit, factor = ("µm", 1e6) if residuals.unit == "m" else (residuals.unit, 1.0)
    entitle(figure, f"{residuals.quantity.capitalize()}: measured (lines) and fitted (dots); residuals")
    above, middle, below = figure.subplots(3, 1, sharex=True, height_ratios=[1.4, 1, 1])
    thin = max(1, len(found["time"]) // 150)
    for k in range(found["measured"].shape[1]):
        line: dict[str, Any] = {"color": COLOURS[k % len(COLOURS)], "linewidth": 1.0}
        above.plot(found["time"], found["measured"][:, k], label=str(k + 1), **line)
        above.plot(found["time"][::thin], found["fitted"][::thin, k], ".", markersize=3, color=line["color"])
        middle.plot(found["time"], factor * (found["measured"] - found["before"])[:, k], **line)
        below.plot(found["time"], factor * (found["measured"] - found["fitted"])[:, k], **line)
    label(above, "measured, fitted", residuals.unit, "")
    label(middle, "residuals, nominal platform", unit, "")
    label(below, "residuals, identified platform", unit)
    above.legend(ncols=6, loc="upper right", fontsize=7)
    for axes in (above, middle, below):
        # what validates the fit
        for start, end in found["validating"]:
            axes.axvspan(start, end, color="#000000", alpha=0.06, linewidth=0)
