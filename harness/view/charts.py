"""The interactive curves of a page, as a figure of plotly.js: one column of panels over a common time axis."""

import html
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.harness.output.colours import COLOURS
from gough_stewart.harness.output.decimation import decimated
from gough_stewart.harness.output.pages import packed
from gough_stewart.harness.results.record import Record
from gough_stewart.model.kinematics import conditioning
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# Of a line, if there is one record; several share them.
POINTS = 800
# of the records, by plotly.js' name or lengths [px]
DASHES = ("solid", "6px,4px", "2px,3px", "10px,4px", "8px,3px,2px,3px", "4px,2px")
_REFERENCE = {"color": "#222222", "width": 1, "dash": "dot"}
_LIMIT = {"color": "#D55E00", "width": 1, "dash": "dot"}
_HEIGHT, _GAP, _TOP, _BOTTOM = 190, 62, 40, 44  # [px]
_GRID = "#e6e9ed"
_LAYOUT: dict[str, Any] = {
    "margin": {"l": 64, "r": 16, "t": _TOP, "b": _BOTTOM},
    "font": {"family": "system-ui, sans-serif", "size": 12, "color": "#222"},
    "paper_bgcolor": "rgba(0,0,0,0)",
    "plot_bgcolor": "#ffffff",
    "hovermode": "x unified",
    "hoverlabel": {"font": {"size": 11}, "bgcolor": "rgba(255,255,255,0.92)"},
    "dragmode": "zoom",
    "modebar": {"bgcolor": "rgba(255,255,255,0.85)", "color": "#8a96a3", "activecolor": COLOURS[0]},
}
_VALUES: dict[str, Any] = {"gridcolor": _GRID, "zeroline": False, "exponentformat": "power", "minexponent": 5}
# Title and legend of a panel stand above it, at its left.
_ABOVE: dict[str, Any] = {"x": 0, "xanchor": "left", "yanchor": "bottom"}
_TITLE: dict[str, Any] = {**_ABOVE, "xref": "paper", "yref": "paper", "yshift": 20, "showarrow": False}
_LEGEND: dict[str, Any] = {**_ABOVE, "orientation": "h", "font": {"size": 11}, "bgcolor": "rgba(0,0,0,0)"}
# Less than this, in a panel's unit, is no motion to look at.
_LEAST = 1e-5
_AXES = ("x", "y", "z")
_ANGLES = ("roll", "pitch", "yaw")
_LEGS = tuple(str(i) for i in range(1, 7))


class _Curves(NamedTuple):
    """Columns (n, size) that share a panel: actual values, and perhaps wanted ones."""

    values: FloatArray
    wanted: FloatArray | None = None


@dataclass(frozen=True)
class _Panel:
    title: str
    names: tuple[str, ...]
    curves: tuple[_Curves | None, ...]  # by record
    bounds: tuple[float, ...] = ()


def chart_of(records: Sequence[Record], platforms: Sequence[Platform], names: Sequence[str]) -> dict[str, Any]:
    """Data and layout for `Plotly.newPlot`.

    Lines are `decimated`: no peak is lost. Colours tell axes and legs, dashes tell records, dotted black is wanted.
    """
    panels = [panel for panel in _panels(records, platforms) if any(panel.curves)]
    inner = len(panels) * _HEIGHT + (len(panels) - 1) * _GAP
    ends = [float(record["time"][k]) for record in records for k in (0, -1)]
    time = {"gridcolor": _GRID, "zeroline": False, "range": [min(ends), max(ends)]}
    data: list[dict[str, Any]] = []
    layout: dict[str, Any] = {**_LAYOUT, "height": _TOP + inner + _BOTTOM, "annotations": [], "shapes": []}
    for k, panel in enumerate(panels):
        number = "" if k == 0 else str(k + 1)
        top = 1 - k * (_HEIGHT + _GAP) / inner
        axes = {"xaxis": f"x{number}", "yaxis": f"y{number}", "legend": f"legend{number}"}
        data += _lines(panel, records, names, axes)
        domain = [max(0.0, top - _HEIGHT / inner), top]
        layout[f"yaxis{number}"] = {**_VALUES, "domain": domain, **_range_of_what_rests(panel)}
        layout[f"xaxis{number}"] = time | {"anchor": f"y{number}"} | ({"matches": "x"} if k else {})
        layout[f"legend{number}"] = {**_LEGEND, "y": top}
        layout["annotations"].append({**_TITLE, "text": f"<b>{panel.title}</b>", "y": top})
        layout["shapes"] += [
            {"type": "line", "xref": f"x{number} domain", "yref": f"y{number}", "x0": 0, "x1": 1, "y0": y, "y1": y}
            | {"line": _LIMIT}
            for y in _near(panel)
        ]
        if k == len(panels) - 1:
            layout[f"xaxis{number}"]["title"] = {"text": "time [s]", "standoff": 6}
    return {"data": data, "layout": layout}


def points_of(records: int) -> int:
    """How many points a line has, if so many records share them."""
    return max(POINTS // records, 100)


def _panels(records: Sequence[Record], platforms: Sequence[Platform]) -> list[_Panel]:
    def each(name: str, scale: float, wanted: str | None = None, home: str | None = None) -> tuple[_Curves | None, ...]:
        found: list[_Curves | None] = []
        for record, platform in zip(records, platforms, strict=True):
            if name not in record:
                found.append(None)
                continue
            zero = getattr(platform, home) if home else 0.0
            other = scale * (record[wanted] - zero) if wanted and wanted in record else None
            found.append(_Curves(scale * (record[name] - zero), other))
        return tuple(found)

    degree = 180 / np.pi
    low, high = (_common(getattr(p, name) for p in platforms) for name in ("leg_length_min", "leg_length_max"))
    stroke = tuple(x for x in (low, high) if x is not None)
    force = _both_ways(_common(record.metadata.get("force_limit") for record in records))
    velocity = _both_ways(_common(p.leg_velocity_max for p in platforms))
    power = _both_ways(_common(p.actuator_power_max for p in platforms))
    powers = tuple(_Curves(r["actuator_force"] * r["leg_velocity"]) for r in records)
    with np.errstate(all="ignore"):  # a leg of length 0 has no direction
        condition = tuple(
            _Curves(conditioning(p, r["position"], r["orientation"]).condition_number[:, None])
            for r, p in zip(records, platforms, strict=True)
        )
    return [
        _Panel("position from home [mm]", _AXES, each("position", 1e3, "reference.position", "home_position")),
        _Panel(
            "orientation from home [deg]",
            _ANGLES,
            each("orientation", degree, "reference.orientation", "home_orientation"),
        ),
        _Panel("position error [mm]", _AXES, each("error.position", 1e3)),
        _Panel("orientation error [mrad]", _ANGLES, each("error.orientation", 1e3)),
        _Panel("actuator force of legs [N]", _LEGS, each("actuator_force", 1.0), force),
        _Panel("length of legs [m]", _LEGS, each("leg_length", 1.0, "reference.leg_length"), stroke),
        _Panel("sliding velocity of legs [m/s]", _LEGS, each("leg_velocity", 1.0), velocity),
        _Panel("actuator power of legs [W]", _LEGS, powers, power),
        _Panel("condition number of the leg Jacobian", ("condition number",), condition),
    ]


def _common(limits: Iterable[float | None]) -> float | None:
    """What all agree in, if they do."""
    different = set(limits)
    return different.pop() if len(different) == 1 else None


def _both_ways(limit: float | None) -> tuple[float, ...]:
    return () if limit is None else (float(limit), -float(limit))


def _lines(
    panel: _Panel, records: Sequence[Record], names: Sequence[str], axes: dict[str, str]
) -> list[dict[str, Any]]:
    lines: list[dict[str, Any]] = []
    points = points_of(len(records))
    wanted: list[tuple[FloatArray, list[int]]] = []  # with the records that share them
    for k, (record, curves) in enumerate(zip(records, panel.curves, strict=True)):
        if curves is None:
            continue
        which = "" if len(records) == 1 else f" · {_without_markup(names[k])}"
        is_first = not lines
        for i, name in enumerate(panel.names):
            said = f"leg {name}" if panel.names is _LEGS else name
            style = {"color": COLOURS[i], "width": 1.6, "dash": DASHES[k]}
            group = {"legendgroup": f"{panel.title} {name}"} if len(panel.names) > 1 else {}
            lines.append(
                _line(record, curves.values[:, i], points, name, style)
                | axes
                | group
                | {"hovertemplate": f"{said}{which}: %{{y:.5g}}<extra></extra>", "meta": [k]}
                | {"showlegend": bool(group) and is_first}
            )
        if curves.wanted is None:
            continue
        shared = next((sharing for other, sharing in wanted if np.array_equal(curves.wanted, other)), None)
        if shared is not None:
            shared.append(k)
            continue
        wanted.append((curves.wanted, [k]))
        for i in range(len(panel.names)):
            lines.append(
                _line(record, curves.wanted[:, i], points, "wanted", _REFERENCE)
                | axes
                | {"legendgroup": f"{panel.title} wanted", "showlegend": i == 0 and len(wanted) == 1}
                | {"hoverinfo": "skip", "meta": wanted[-1][1]}
            )
    return lines


def _line(record: Record, values: FloatArray, points: int, name: str, style: dict[str, Any]) -> dict[str, Any]:
    time, shown = decimated(record["time"], values, points)
    return {
        "type": "scatter",
        "mode": "lines" if len(time) > 1 else "markers",
        "x": packed(time, "f4"),
        "y": packed(shown, "f4"),
        "name": name,
        "line": style,
    }


def _without_markup(name: str) -> str:
    """A name that plotly.js, which knows some HTML and templates, shows as it is."""
    return html.escape(name, quote=False).replace("%{", "%&#123;")


def _range_of_what_rests(panel: _Panel) -> dict[str, Any]:
    """A range for a panel in which nothing moves; plotly.js would blow rounding up to its height."""
    shown = np.concatenate([part for c in panel.curves if c is not None for part in c if part is not None])
    low, high = float(shown.min()), float(shown.max())
    rests = high - low < _LEAST * max(1.0, abs(high))
    return {"range": [(low + high) / 2 + sign * max(1.0, abs(high)) / 100 for sign in (-1, 1)]} if rests else {}


def _near(panel: _Panel) -> list[float]:
    """The bounds that do not press the lines flat."""
    shown = np.concatenate([c.values.ravel() for c in panel.curves if c is not None])
    low, high = float(shown.min()), float(shown.max())
    air = max(high - low, 0.02 * max(abs(low), abs(high), 1e-9))
    return [bound for bound in panel.bounds if low - air <= bound <= high + air]
