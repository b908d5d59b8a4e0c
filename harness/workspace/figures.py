"""Figures of a workspace for screen and print: reachable region, conditioning and strength."""

import textwrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from gough_stewart.harness.output.plotting import pictures
from gough_stewart.harness.workspace.display import (
    Result,
    fixed_text,
    limits_met,
    limits_text,
    results_of,
    shown_coordinate,
    shown_length,
)
from gough_stewart.harness.workspace.explained import notices
from gough_stewart.harness.workspace.maps import (
    LIMIT_COLOURS,
    MAPS,
    draw_field,
    draw_limits,
    dress,
    height_over_width,
    plane_of,
)
from gough_stewart.model.workspace import Limit
from gough_stewart.model.workspace_grid import Workspace

FILES = ("workspace.png", "workspace.svg")
# Slices of a volume.
_SLICES = 4
# All positions are explicit [inch]: otherwise, maps of equal scales and their colour bars would not line up.
_LEFT, _TOP, _BOTTOM, _RIGHT = 0.65, 0.62, 0.98, 0.62
_GAP, _BAR, _BAR_GAP = 1.32, 0.11, 0.08
# Notices: line height [inch], letters per inch.
_LINE, _LETTERS = 0.17, 15.5


def workspace_figures(workspace: Workspace) -> dict[str, bytes]:
    """Maps of a workspace as `workspace.png` and `workspace.svg`; for a volume, slices of it."""
    results = [result for result in results_of(workspace) if result.name in MAPS]
    if not workspace.qualities.reachable.any():
        results = []
    if len(workspace.shape) == 2:
        return _maps(workspace, results)
    return _slices(workspace, results)


def _maps(workspace: Workspace, results: list[Result]) -> dict[str, bytes]:
    width, height = _map_size(workspace, 3.3)
    columns = 2 if results else 1
    across = max(_LEFT + columns * width + (columns - 1) * _GAP + _RIGHT, 5.5)
    lines = _notices(workspace, across)
    rows, above, between = -(-(1 + len(results)) // columns), 0.3 + _LINE * len(lines), 0.8
    size = (across, _TOP + above + rows * height + (rows - 1) * between + _BOTTOM)

    def draw(figure: Figure) -> None:
        _title(figure, workspace, size, lines)
        plane = plane_of(workspace)
        for k, result in enumerate([None, *results]):
            row, column = divmod(k, columns)
            left, top = _LEFT + column * (width + _GAP), _TOP + above + row * (height + between)
            axes = _placed(figure, size, left, top, width, height)
            axes.set_title(_title_of(workspace, result))
            if result is None:
                draw_limits(axes, workspace, plane)
            else:
                bar = _placed(figure, size, left + width + _BAR_GAP, top, _BAR, height)
                _colour_bar(bar, draw_field(axes, workspace, plane, result), workspace, result)
            dress(axes, plane)
        _legend(figure, workspace, plane.home is not None)

    return pictures("workspace", draw, *size)


def _slices(workspace: Workspace, results: list[Result]) -> dict[str, bytes]:
    width, height = _map_size(workspace, 2.0)
    chosen, gap, between = _chosen_slices(workspace), 0.12, 0.36
    across = _LEFT + len(chosen) * width + (len(chosen) - 1) * gap + _RIGHT
    lines = _notices(workspace, across)
    rows, above = 1 + len(results), 0.5 + _LINE * len(lines)
    size = (across, _TOP + above + rows * height + (rows - 1) * between + _BOTTOM)
    name, values = list(workspace.swept.items())[2]
    shown = shown_coordinate(workspace, name)

    def draw(figure: Figure) -> None:
        _title(figure, workspace, size, lines)
        planes = [plane_of(workspace, k) for k in chosen]
        for row, result in enumerate([None, *results]):
            top = _TOP + above + row * (height + between)
            for column, plane in enumerate(planes):
                axes = _placed(figure, size, _LEFT + column * (width + gap), top, width, height)
                if result is None:
                    draw_limits(axes, workspace, plane)
                    axes.annotate(
                        f"{name} {shown.text(values[chosen[column]], 3)}", (0.5, 1), (0, 4), "axes fraction",
                        "offset points", ha="center", color="#555555",
                    )  # fmt: skip
                else:
                    drawn = draw_field(axes, workspace, plane, result)
                    if column == len(planes) - 1:
                        left = _LEFT + len(planes) * (width + gap) - gap + _BAR_GAP
                        _colour_bar(_placed(figure, size, left, top, _BAR, height), drawn, workspace, result)
                dress(axes, plane, has_x=row == rows - 1, has_y=column == 0)
                if column == 0:
                    above_axes = (0, 20 if row == 0 else 5)
                    axes.annotate(
                        _title_of(workspace, result), (0, 1), above_axes, "axes fraction", "offset points", fontsize=10
                    )
        _legend(figure, workspace, any(plane.home is not None for plane in planes))

    return pictures("workspace", draw, *size)


def _placed(figure: Figure, size: tuple[float, float], left: float, top: float, width: float, height: float) -> Axes:
    """Axes at a distance [inch] from the left and top of the figure."""
    return figure.add_axes((left / size[0], 1 - (top + height) / size[1], width / size[0], height / size[1]))


def _map_size(workspace: Workspace, width: float) -> tuple[float, float]:
    """Size of a map [inch]; the area is about the same for all shapes."""
    # a long and thin grid needs room for its labels
    ratio = min(max(height_over_width(workspace), 0.25), 4.0)
    across = float(width / np.sqrt(max(ratio, 0.9)))
    return across, across * ratio


def _chosen_slices(workspace: Workspace) -> list[int]:
    reached = np.flatnonzero(workspace.qualities.reachable.any(axis=(0, 1)))
    low, high = (int(reached[0]), int(reached[-1])) if reached.size else (0, workspace.shape[2] - 1)
    # not the ends, where the region closes
    shares = (np.arange(_SLICES) + 0.5) / _SLICES
    return sorted({round(low + share * (high - low)) for share in shares})


def _notices(workspace: Workspace, width: float) -> list[str]:
    """The notices, wrapped to lines that fit a figure of this width [inch]."""
    return [line for notice in notices(workspace) for line in textwrap.wrap(notice, int(_LETTERS * (width - 0.2)))]


def _title(figure: Figure, workspace: Workspace, size: tuple[float, float], lines: list[str]) -> None:
    figure.set_layout_engine("none")
    heading = f"Workspace of {workspace.platform.name} at {fixed_text(workspace)}"
    place: dict[str, Any] = {"x": 0.01, "y": 1 - 0.1 / size[1], "ha": "left", "va": "top"}
    figure.suptitle(heading, fontsize=10.5, fontweight="bold", parse_math=False, **place)
    quiet: dict[str, Any] = {"va": "top", "fontsize": 8.5, "color": "#555555", "parse_math": False}
    figure.text(0.01, 1 - 0.34 / size[1], limits_text(workspace), **quiet)
    for k, line in enumerate(lines, start=1):
        figure.text(0.01, 1 - (0.38 + _LINE * k) / size[1], line, **quiet | {"color": "black"})


def _title_of(workspace: Workspace, result: Result | None) -> str:
    if result is None:
        has_lines = workspace.qualities.leg_length_margin is not None and workspace.qualities.reachable.any()
        return f"reachable, with stroke left [{shown_length(workspace).unit}]" if has_lines else "reachable"
    return f"{result.title} [{result.shown.unit}]" if result.shown.unit else result.title


def _colour_bar(axes: Axes, drawn: Any, workspace: Workspace, result: Result) -> None:
    seen = result.values[workspace.qualities.reachable] * result.shown.factor
    is_capped = bool((seen > drawn.norm.vmax * (1 + 1e-9)).any())
    bar = axes.figure.colorbar(drawn, cax=axes, extend="max" if is_capped else "neither")
    bar.outline.set_visible(False)
    span = drawn.norm.vmax / drawn.norm.vmin if result.logarithmic else 1.0
    if span > 4:
        bar.ax.yaxis.set_major_locator(LogLocator(10, subs=(1, 2, 3, 5, 7) if span < 40 else (1, 2, 5)))
    else:
        bar.ax.yaxis.set_major_locator(MaxNLocator(6))
    bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    bar.ax.yaxis.set_minor_formatter(NullFormatter())
    bar.ax.grid(visible=False)


def _legend(figure: Figure, workspace: Workspace, has_home: bool) -> None:
    met = [limit for limit in (Limit.NONE, *limits_met(workspace)) if limit in workspace.qualities.limit]
    handles: list[Any] = [
        Patch(facecolor=LIMIT_COLOURS[limit], edgecolor="#222222" if limit == Limit.NONE else "none", label=limit.text)
        for limit in met
    ]
    if has_home:
        cross: dict[str, Any] = {"marker": "+", "color": "black", "markersize": 8, "linestyle": "none"}
        handles.append(Line2D([], [], label="home", **cross))
    figure.legend(
        handles=handles, loc="lower left", ncols=4, fontsize=8.5, bbox_to_anchor=(0.0, 0.0), borderaxespad=0.3
    )
