"""Maps of one plane of a workspace: the limits around the reachable region, and results inside it."""

from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm, Normalize
from matplotlib.contour import QuadContourSet
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion, distance_transform_edt

from gough_stewart.harness.report.words import number_text
from gough_stewart.harness.workspace.display import (
    Result,
    Shown,
    clearance,
    is_through_home,
    reachable_values,
    shown_coordinate,
    shown_length,
)
from gough_stewart.model.vectors import FloatArray
from gough_stewart.model.workspace import Limit
from gough_stewart.model.workspace_grid import COORDINATES, Workspace, home_of

# Orange, sky blue, purple and green of Okabe & Ito, lightened to stay in the background.
LIMIT_COLOURS = {
    Limit.NONE: "#FFFFFF",
    Limit.PITCH: "#DDDDDD",
    Limit.SINGULAR: "#999999",
    Limit.LEG_TOO_SHORT: "#F0C566",
    Limit.LEG_TOO_LONG: "#9AD2F2",
    Limit.BASE_JOINT: "#E0AECA",
    Limit.PLATFORM_JOINT: "#66C5AB",
}
# Perceptually uniform, and safe for colour-blind readers. The steps are too many to be seen, and compress well.
MAPS = {"condition_number": "magma_r", "payload": "viridis", "force_margin": "cividis"}
_OTHER_MAP = "viridis"
_STEPS = 64
# The range of it that maps use; the darkest colours would hide lines, crosses and the shape of a surface.
_SHARES = {"magma_r": 0.72}
# Colours end at this condition number; otherwise, next to a singular pose all others would share one colour.
LARGEST_SHOWN = 1000.0
_ROUND = np.array([1.2, 1.5, 2, 2.5, 3, 4, 5, 7, 10, 15, 20, 30, 50, 70, 100, 200, 500])
_LINE = "#222222"


class Plane(NamedTuple):
    """A grid over two coordinates; arrays (n, m), with the first coordinate pointing right."""

    names: tuple[str, str]
    shown: tuple[Shown, Shown]
    values: tuple[FloatArray, FloatArray]  # in display units
    part: tuple[Any, ...]  # index of the plane in the workspace's arrays
    clearance: FloatArray
    home: tuple[float, float] | None  # None if it is not in the plane


def plane_of(workspace: Workspace, k: int | None = None) -> Plane:
    """The plane of a map, or slice k of a volume."""
    (a, first), (b, second) = list(workspace.swept.items())[:2]
    shown = (shown_coordinate(workspace, a), shown_coordinate(workspace, b))
    others = dict(workspace.fixed)
    if k is not None:
        name, values = list(workspace.swept.items())[2]
        others[name] = float(values[k])
    home = home_of(workspace.platform)
    part = (...,) if k is None else (..., k)
    return Plane(
        (a, b),
        shown,
        (first * shown[0].factor, second * shown[1].factor),
        part,
        clearance(workspace)[part],
        (home[a] * shown[0].factor, home[b] * shown[1].factor) if is_through_home(workspace, others) else None,
    )


def draw_limits(axes: Axes, workspace: Workspace, plane: Plane) -> None:
    """Draw the reachable region in white, the limits beyond it in colour, and contour lines of the stroke left."""
    code = workspace.qualities.limit[plane.part]
    beyond = code != Limit.NONE
    if beyond.any():
        norm = BoundaryNorm(np.arange(len(Limit) + 1) - 0.5, len(Limit))
        colours = ListedColormap([LIMIT_COLOURS[limit] for limit in Limit])
        _image(axes, plane, limits_behind(code), cmap=colours, norm=norm, interpolation="nearest")
    if _has_border(plane):
        white = LIMIT_COLOURS[Limit.NONE]
        axes.contourf(*plane.values, plane.clearance.T, levels=[0, np.inf], colors=[white])
    margin = workspace.qualities.leg_length_margin
    if margin is not None and not beyond.all():
        left = np.asarray(margin[plane.part] * shown_length(workspace).factor)
        high = float(left[~beyond].max())
        levels = [level for level in MaxNLocator(5).tick_values(0, high) if level > 0]
        _clip(axes, plane, _lines(axes, workspace, plane, left, levels, "#8A8A8A"))
    _border(axes, plane)


def limits_behind(code: NDArray[np.int8]) -> NDArray[np.int8]:
    """Limits on a map (n, m), extended under the reachable region, whose border is drawn over them."""
    beyond = code != Limit.NONE
    if not beyond.any():
        return code
    nearest = distance_transform_edt(~beyond, return_distances=False, return_indices=True)
    return np.asarray(code[tuple(nearest)])


def draw_field(axes: Axes, workspace: Workspace, plane: Plane, result: Result) -> Any:
    """Draw a map of values at reachable poses with contour lines; return what its colour bar needs."""
    axes.set_facecolor("#F0F0F0")
    values = np.asarray(result.values[plane.part] * result.shown.factor)
    norm = norm_of(workspace, result)
    bounded = np.nan_to_num(values, nan=norm.vmax or 0.0, posinf=norm.vmax)
    image = _image(axes, plane, bounded, cmap=colour_map(result), norm=norm, interpolation="bilinear")
    reached = workspace.qualities.reachable[plane.part]
    if not reached.any():
        image.set_visible(False)
        return image
    near = np.where(binary_dilation(reached, iterations=2) & np.isfinite(values), values, np.nan)
    lines = _lines(axes, workspace, plane, near, _levels(norm, result), "white")
    _clip(axes, plane, image, lines)
    _border(axes, plane)
    return image


def dress(axes: Axes, plane: Plane, has_x: bool = True, has_y: bool = True) -> None:
    """Draw home, and set limits, scales and names of the axes of a map."""
    if plane.home is not None:
        axes.plot(*plane.home, marker="+", color="black", markersize=8, markeredgewidth=1.4, linestyle="none")
    axes.set_xlim(plane.values[0][0], plane.values[0][-1])
    axes.set_ylim(plane.values[1][0], plane.values[1][-1])
    axes.grid(visible=False)
    for side in axes.spines.values():
        side.set(visible=True, color="#BBBBBB", linewidth=0.8)
    axes.tick_params(color="#BBBBBB", labelbottom=has_x, labelleft=has_y)
    if has_x:
        axes.set_xlabel(f"{plane.names[0]} [{plane.shown[0].unit}]")
    if has_y:
        axes.set_ylabel(f"{plane.names[1]} [{plane.shown[1].unit}]")


def norm_of(workspace: Workspace, result: Result) -> Normalize:
    """The colour scale, from the least to the largest value at reachable poses."""
    seen = reachable_values(workspace, result.values) * result.shown.factor
    low, high = (float(seen.min()), float(seen.max())) if seen.size else (1.0, 2.0)
    if result.logarithmic:
        return LogNorm(low, max(min(high, LARGEST_SHOWN), 1.01 * low))
    return Normalize(low, high if high > low else low + 1.0)


def colour_map(result: Result) -> ListedColormap:
    """The colour map of a result, from its least value to its largest."""
    name = MAPS.get(result.name, _OTHER_MAP)
    return ListedColormap(mpl.colormaps[name](np.linspace(0, _SHARES.get(name, 1.0), _STEPS)))


def height_over_width(workspace: Workspace) -> float:
    """Aspect ratio of a map: equal scales if both coordinates have the same unit, within limits that fit a page."""
    (a, first), (b, second) = list(workspace.swept.items())[:2]
    if COORDINATES[a] != COORDINATES[b]:
        return 0.85
    return float(np.ptp(second) / np.ptp(first))


def _image(axes: Axes, plane: Plane, values: Any, **options: Any) -> Any:
    """Cells centred on the grid's points."""
    (x, y), (a, b) = plane.values, ((v[1] - v[0]) / 2 for v in plane.values)
    extent = (x[0] - a, x[-1] + a, y[0] - b, y[-1] + b)
    return axes.imshow(values.T, extent=extent, origin="lower", aspect="auto", interpolation_stage="data", **options)


def _has_border(plane: Plane) -> bool:
    return bool(plane.clearance.min() < 0 < plane.clearance.max())


def _border(axes: Axes, plane: Plane) -> None:
    if _has_border(plane):
        axes.contour(*plane.values, plane.clearance.T, levels=[0], colors=_LINE, linewidths=1.1)


def _clip(axes: Axes, plane: Plane, *drawn: Any) -> None:
    """Clip to the border."""
    if not _has_border(plane):
        return
    border = axes.contourf(*plane.values, plane.clearance.T, levels=[0, np.inf], colors="none")
    path = border.get_paths()[0]
    border.remove()
    for each in drawn:
        if each is not None:
            each.set_clip_path(path, axes.transData)


def _lines(
    axes: Axes, workspace: Workspace, plane: Plane, values: FloatArray, levels: Any, colour: str
) -> QuadContourSet | None:
    finite = values[np.isfinite(values)]
    inside = [level for level in levels if finite.min(initial=np.inf) < level < finite.max(initial=-np.inf)]
    if not inside:
        return None
    lines = axes.contour(*plane.values, values.T, levels=inside, colors=colour, linewidths=0.7)
    # a label at the border would reach outside it
    well_inside = binary_erosion(workspace.qualities.reachable[plane.part], iterations=2)
    for text in axes.clabel(lines, fmt=lambda level: number_text(level, 3), fontsize=7):
        x, y = text.get_position()
        at = tuple(int(np.abs(v - p).argmin()) for v, p in zip(plane.values, (x, y), strict=True))
        text.set_visible(bool(well_inside[at]))
    return lines


def _levels(norm: Normalize, result: Result) -> FloatArray:
    low, high = float(norm.vmin or 0.0), float(norm.vmax or 0.0)
    if not result.logarithmic:
        return np.asarray(MaxNLocator(7).tick_values(low, high))
    inside = np.array([level for level in _ROUND if low < level < high])
    # levels close together: the level 2 alone would show little
    few = np.asarray(MaxNLocator(5).tick_values(low, high)) if len(inside) < 3 else inside
    return np.asarray(few[:: max(1, -(-len(few) // 7))])
