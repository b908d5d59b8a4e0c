"""An interactive page of a workspace: maps with all values at the pointer, a volume in 3-D; works offline."""

import html
from string import Template
from typing import Any

import numpy as np
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from gough_stewart.harness.output.pages import asset, packed, plotly
from gough_stewart.harness.report.notebook import table_to_html
from gough_stewart.harness.report.offline import document
from gough_stewart.harness.workspace.display import (
    Result,
    clearance,
    fixed_text,
    is_through_home,
    limits_met,
    results_of,
    shown_coordinate,
    swept_text,
)
from gough_stewart.harness.workspace.explained import notices
from gough_stewart.harness.workspace.isosurface import surface_of
from gough_stewart.harness.workspace.maps import LIMIT_COLOURS, colour_map, limits_behind, norm_of
from gough_stewart.harness.workspace.tables import size_text, workspace_tables
from gough_stewart.model.workspace import Limit
from gough_stewart.model.workspace_grid import Workspace, home_of

_STOPS = 17


def workspace_page(workspace: Workspace) -> bytes:
    """Create the page: maps with all values at the pointer; for three swept coordinates a volume and its slices.

    The page loads nothing, and its content security policy forbids it. Numbers are float32, seven digits.

    Raises
    ------
    GoughStewartError
        plotly is not installed.
    """
    platform = workspace.platform
    lead = f"{swept_text(workspace)}; at {fixed_text(workspace)}"
    hint = "Point at a map to see all values there. Drag to zoom all maps; double-click to reset."
    if len(workspace.shape) == 3:
        hint += " Move the slider to choose a slice; drag the volume to turn it."
    title = f"Workspace of {platform.name}"
    body = Template(asset("workspace", "workspace.html")).substitute(
        title=html.escape(title),
        lead=html.escape(lead),
        size=html.escape(size_text(workspace)),
        notices="".join(f'<p class="notice">{html.escape(notice)}</p>' for notice in notices(workspace)),
        legend=_legend(workspace),
        hint=hint,
        tables="".join(
            f'<div tabindex="0" role="group" aria-label="table">{table_to_html(table)}</div>'
            for table in workspace_tables(workspace)
        ),
        footer=html.escape(
            f"{platform.source}. Largest payload: a point mass at the platform frame's origin, held at rest. Force "
            "margin: the largest force there, in any direction, held at rest. Made by gough-stewart; includes "
            "plotly.js.".lstrip(". ")
        ),
    )
    scripts = [plotly(), asset("output", "page.js") + asset("workspace", "workspace.js")]
    styles = (("output", "page.css"), ("output", "panels.css"), ("workspace", "workspace.css"))
    style = "".join(asset(*each) for each in styles)
    return document(title, body, style, _data(workspace), scripts)


def _data(workspace: Workspace) -> dict[str, Any]:
    swept = []
    for name, values in workspace.swept.items():
        shown = shown_coordinate(workspace, name)
        swept.append({"name": name, "unit": shown.unit, "values": packed(values * shown.factor, "f4")})
    return {
        "swept": swept,
        "limits": [{"text": limit.text, "colour": LIMIT_COLOURS[limit]} for limit in Limit],
        "limit": packed(workspace.qualities.limit, "i1"),
        "behind": packed(_behind(workspace), "i1"),
        "clearance": packed(clearance(workspace), "f4"),
        "results": [_result(workspace, result) for result in results_of(workspace)],
        "home": _home(workspace),
        "level": _level(workspace),
        "surface": _surface(workspace),
    }


def _result(workspace: Workspace, result: Result) -> dict[str, Any]:
    norm, colours = norm_of(workspace, result), colour_map(result)
    return {
        "title": result.title,
        "unit": result.shown.unit,
        "logarithmic": result.logarithmic,
        "low": norm.vmin,
        "high": norm.vmax,
        "colours": [[float(share), to_hex(colours(float(share)))] for share in np.linspace(0, 1, _STOPS)],
        "values": packed(result.values * result.shown.factor, "f4"),
    }


def _behind(workspace: Workspace) -> NDArray[np.int8]:
    """The limits extended under the reachable region, map by map."""
    code = workspace.qualities.limit
    if code.ndim == 2:
        return limits_behind(code)
    return np.stack([limits_behind(code[..., k]) for k in range(code.shape[2])], axis=-1)


def _home(workspace: Workspace) -> dict[str, Any] | None:
    """Home on the maps, in display units, and its slice of a volume; None if it is on none."""
    if not is_through_home(workspace, workspace.fixed):
        return None
    home = home_of(workspace.platform)
    slices = [] if len(workspace.shape) == 2 else list(workspace.swept.items())[2:]
    level = 0
    for name, values in slices:
        level = _level(workspace)
        if not is_through_home(workspace, {name: float(values[level])}):
            return None
    place = [home[name] * shown_coordinate(workspace, name).factor for name in list(workspace.swept)[:2]]
    return {"place": place, "level": level}


def _level(workspace: Workspace) -> int:
    """The first slice to show: the value of the third coordinate nearest to home."""
    if len(workspace.shape) == 2:
        return 0
    name, values = list(workspace.swept.items())[2]
    return int(np.abs(values - home_of(workspace.platform)[name]).argmin())


def _surface(workspace: Workspace) -> dict[str, Any] | None:
    """Surface of the reachable volume in display units, with the logarithm of the condition number; None if empty."""
    surface = surface_of(workspace) if len(workspace.shape) == 3 else None
    if surface is None:
        return None
    factors = [shown_coordinate(workspace, name).factor for name in workspace.swept]
    return {
        "vertices": packed(surface.vertices * factors, "f4"),
        "triangles": packed(surface.triangles, "i4"),
        "colour": packed(surface.colour, "f4"),
    }


def _legend(workspace: Workspace) -> str:
    limits = [Limit.NONE] if workspace.qualities.reachable.any() else []
    parts = []
    for limit in [*limits, *limits_met(workspace)]:
        look = 'class="reachable"' if limit == Limit.NONE else f'style="background:{LIMIT_COLOURS[limit]}"'
        swatch = f"<i {look}></i>"
        parts.append(f"<span>{swatch}{html.escape(limit.text)}</span>")
    return "".join(parts)
