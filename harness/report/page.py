"""One HTML page of a report: verdict, numbers and picture first, then charts and tables; works offline.

Texts and tables are HTML by `web/report.html`, so that they are there without a script; charts and scenes are data,
drawn by the scripts of `web/`.
"""

import html
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from itertools import cycle, groupby
from typing import Any
from urllib.parse import quote

import numpy as np
from markupsafe import Markup

from gough_stewart.harness.report.chart import COLUMNS, Axis, Chart, Map, Scene, Series, Surface, looks_of
from gough_stewart.harness.report.document import Cell, Column, Part, Report, Section, Table, Value, is_at_right
from gough_stewart.harness.report.offline import TEMPLATES, asset, bokeh, document, licence_of, three, three_licence
from gough_stewart.harness.report.packing import MOST_ROWS, Arrays, blocks
from gough_stewart.harness.report.palette import (
    DASHES,
    GROUND,
    INK,
    KINDS,
    MARK_DASHES,
    ROLES,
    THEMES,
    Role,
    Theme,
    colour_of,
    colour_of_six,
)
from gough_stewart.harness.report.quantities import Quantity, least_span, percent
from gough_stewart.harness.report.requirements import OUTCOMES
from gough_stewart.harness.report.words import explained, with_minus, with_terms
from gough_stewart.model.vectors import FloatArray

PAGE = "report.html"
_SCRIPTS = ("page.js", "state.js", "tables.js", "members.js")
_MAP_SCRIPTS = ("heat.js",)
_SCENE_SCRIPTS = ("records.js", "shapes.js", "bodies.js", "viewer.js", "scene.js")
_SURFACE_SCRIPTS = ("shapes.js", "viewer.js", "surface.js")
_CHART_SCRIPTS = ("lines.js", "figure.js", "legend.js", "charts.js", "player.js")
_STYLES = ("page.css", "first.css", "charts.css", "stage.css", "print.css")
_SIGNS = {"good": "✓", "marginal": "!", "bad": "✗", "told": "→", "met": "✓", "missed": "✗", "open": "?"}
# Colours of nearness to a limit, from 0 in the middle to 1 at the limit, and beyond it. Lightness and the contrast of
# blue and yellow tell them apart without red and green (simulated as by Machado et al., IEEE Trans. Vis.
# Comput. Graph. 15 (2009), 1291-1298).
NEARNESS: dict[str, Any] = {
    "stops": [(0.0, "#6baed6"), (0.5, "#b8d0dc"), (0.8, "#f5b722"), (1.0, "#a50f15")],
    "beyond": "#5c1a7e",
}
THEME_OPTIONS = "".join(
    f'<option value="{value}">{text}</option>'
    for value, text in (("", "as the system"), ("light", "light"), ("dark", "dark"), ("contrast", "high contrast"))
)
# Roles that colour flags on the bar of time.
_FLAGS: tuple[Role, ...] = ("bad", "neutral", "marginal", "published", "measured")
# Largest number of values that stand beside the verdict, and of names in a description; letters of a vertical title
# that fit beside a chart.
_MOST_NUMBERS, _MOST_NAMES, _LONGEST = 6, 12, 28
# Steps of the range of a signal in which those of single members are stored: a chart has some 200 pixels of height.
_SAMPLE_STEPS = 1000.0


def page_of(report: Report) -> bytes:
    """The page; it loads nothing, and the same report gives the same bytes.

    Series of more than `packing.MOST_ROWS` rows are kept as blocks with their smallest and largest value, and the page
    says so.
    """
    arrays, charts = Arrays(), report.charts
    scenes = [part for part in report.parts() if isinstance(part, Scene)]
    surfaces = [part for part in report.parts() if isinstance(part, Surface)]
    is_solid = bool(scenes or surfaces)
    # a single chart over time among others needs no controls of time
    has_time = bool(scenes) or sum(c.is_over_time for c in charts) > 1 or bool(charts and charts[0].is_over_time)
    clock, flags = _clock(charts, scenes)
    data = {
        "title": report.title,
        "clock": clock,
        "changed": report.changed,
        "runs": report.runs,
        "palette": {theme: palette_of(theme) for theme in THEMES},
        "nearness": NEARNESS,
        "charts": [chart_data(chart, arrays, has_time=has_time) for chart in charts],
        "scenes": [_scene_data(scene, arrays) for scene in scenes],
        "surfaces": [_surface_data(surface, arrays) for surface in surfaces],
        "members": _member_data(report, arrays),
        "arrays": arrays.packed,
    }
    differences = None
    if report.settings and len(report.runs) > 1:  # of a single run, what was set is in the head
        rows = tuple((setting.key, *setting.values) for setting in report.settings)
        differences = Table("What differs between the runs", tuple(map(Column, ("setting", *report.runs))), rows)
    curves = [chart for chart in charts if chart.kind in ("line", "step")]
    longest = max((len(chart.x_of(series)) for chart in curves for series in chart.series), default=0)
    rounding = "rounded to less than a pixel, or to an eighth of the smallest difference that is drawn"
    kept = f"Charts have all rows, {rounding}. " if longest else ""
    if longest > MOST_ROWS:
        kept = (
            f"Of more than {MOST_ROWS:,} rows, charts show the smallest and the largest value of each block of "
            f"{-(-2 * longest // MOST_ROWS)} rows. "
        )
    first = None if is_solid else next((chart for chart in charts if not chart.detail), None)
    is_beside = bool(first or surfaces)
    body = TEMPLATES.get_template("report.html").render(
        report=report,
        charts=charts,
        scenes=scenes,
        surfaces=surfaces,
        first=first,
        beside=[part for part in report.parts() if is_beside and isinstance(part, Table) and part.beside],
        number_of={id(chart): k for k, chart in enumerate(charts)},
        has_time=has_time,
        flags=flags,
        has_legs=bool(scenes) or any(series.leg is not None for chart in charts for series in chart.series),
        has_members=bool(data["members"]),
        differences=differences,
        themes=Markup(THEME_OPTIONS),
        signs=_SIGNS,
        outcomes=OUTCOMES,
        most_numbers=_MOST_NUMBERS,
        kept=kept,
        inside=[*(["three.js"] if is_solid else []), *(["Bokeh"] if charts else [])],
        licences=[*([three_licence()] if is_solid else []), *([f"BokehJS\n{licence_of('bokeh')}"] if charts else [])],
    )
    solid = _SCENE_SCRIPTS if scenes else _SURFACE_SCRIPTS if surfaces else ()
    maps = _MAP_SCRIPTS if surfaces or any(chart.kind == "heat" for chart in charts) else ()
    drawing = "\n".join(asset(name) for name in (*_SCRIPTS, *maps, *solid, *_CHART_SCRIPTS))
    # the scene first, so that it appears while the library of the charts is still loading
    scripts = [*([three()] if is_solid else []), drawing, *([bokeh(), "GoughStewart.charts();"] if charts else [])]
    return document(report.title, body, colours() + "".join(map(asset, _STYLES)), data, scripts)


def to_html(report: Report) -> str:
    """A report in a notebook: the verdict, the tables but those of details, and the notes; all texts escaped."""
    macros: Any = TEMPLATES.get_template("notebook.html").module
    return str(macros.whole(report, lambda part: type(part).__name__))


def table_to_html(table: Table) -> str:
    """A table in a notebook; a unit that all numbers of a row share stands beside its first cell."""
    macros: Any = TEMPLATES.get_template("notebook.html").module
    return str(macros.table(table))


# --- colours ---------------------------------------------------------------------------------------------------------


def palette_of(theme: Theme) -> dict[str, Any]:
    """Ground, ink, and the colours of roles and of six."""
    return {
        "ground": GROUND[theme],
        "ink": INK[theme],
        "roles": {role: colour_of(role, theme) for role in ROLES},
        "six": [colour_of_six(k, theme) for k in range(6)],
        "kinds": KINDS[theme],
    }


def colours() -> str:
    """The colours of roles as custom properties, for light and dark, and for high contrast."""
    light, dark, strong = (
        palette["roles"] | {f"six-{k}": colour for k, colour in enumerate(palette["six"])}
        for palette in map(palette_of, THEMES)
    )
    shared = "".join(f"--{name}: light-dark({colour}, {dark[name]}); " for name, colour in light.items())
    contrast = "".join(f"--{name}: {colour}; " for name, colour in strong.items())
    return f":root {{ {shared}}}\n:root[data-theme=contrast] {{ {contrast}}}\n"


# --- charts and scenes as data for the scripts -----------------------------------------------------------------------


def chart_data(chart: Chart, arrays: Arrays, *, has_time: bool) -> dict[str, Any]:
    """A chart as data; it shares the time of the page if that `has_time`."""
    quantity, over = chart.series[0].quantity, chart.map
    sizes = [np.abs(series.values[np.isfinite(series.values)]).max(initial=0.0) for series in chart.series]
    # the title above the chart says the rest of a long one
    title = re.split(", | of ", chart.title)[0][:_LONGEST] if len(chart.title) > _LONGEST else chart.title
    of_values = quantity.unit or "1", quantity.factor * float(max(sizes)), quantity.least
    marks = list[dict[str, Any]]()
    for mark in chart.marks:
        is_vertical, dashes = mark.direction == "vertical", DASHES.get(mark.role, MARK_DASHES)
        value = with_minus((chart.x.quantity if is_vertical else quantity).text(mark.value))
        text = f"{mark.text} {value}" if mark.tells else mark.text
        look = {"role": mark.role, "dashes": [3 * length for length in dashes]}
        marks.append({"value": mark.value, "text": text, "vertical": is_vertical, **look})
    data: dict[str, Any] = {
        "title": chart.title,
        "kind": chart.kind,
        "isTime": has_time and chart.is_over_time,
        "x": _axis(chart.x, arrays),
        "y": {
            **_written(quantity),
            # the smallest difference of these values, and span of their axis [shown unit]
            "least": least_span(*of_values),
            "span": least_span(*of_values, is_axis=True),
            "title": chart.y_title if chart.y is not None or quantity.name else quantity.headed(title),
            "scale": chart.y.scale if chart.y else "linear",
        },
        "series": [
            {**_series(series, chart, arrays), "look": {"colour": look.colour, "dashes": look.dashes}}
            for series, look in zip(chart.series, looks_of(chart.series), strict=True)
        ],
        "marks": marks,
        "spans": [asdict(span) for span in chart.spans],
        "strips": [{**asdict(strip), "share": percent(strip.share)} for strip in chart.strips],
    }
    if chart.samples is not None:
        data["samples"] = {
            "members": arrays.add(chart.samples.members),
            "x": arrays.add(chart.samples.x),
            "values": arrays.add(chart.samples.values, quantity, _SAMPLE_STEPS),
        }
    if chart.kind == "heat" and chart.y is not None:
        data["rows"] = _axis(chart.y, arrays)
        data["map"] = over and {
            "inside": None if over.inside is None else arrays.add(_single(over.inside)),
            "scale": over.scale,
            "classes": over.classes,
            "slices": None if over.slices is None else _axis(over.slices, arrays),
            "first": over.first,
            "point": over.point,
            "pointName": over.point_name,
        }
    elif chart.y is not None and chart.y.labels:
        data["y"]["labels"] = chart.y.labels
    return data


def _written(quantity: Quantity) -> dict[str, Any]:
    return {"unit": quantity.unit_text, "factor": quantity.factor, "digits": quantity.digits}


def _single(values: FloatArray) -> FloatArray:
    """Seven digits of each number, which compress to half; those of a map may be far apart, or infinite."""
    with np.errstate(over="ignore"):
        return values.astype(np.float32).astype(float)


def _axis(axis: Axis, arrays: Arrays) -> dict[str, Any]:
    words = {"title": axis.title, "name": axis.name, "scale": axis.scale, "labels": axis.labels}
    return {**_written(axis.quantity), **words, "values": arrays.add(blocks(axis.values, axis.values)[0])}


def _series(series: Series, chart: Chart, arrays: Arrays) -> dict[str, Any]:
    x, is_curve = chart.x_of(series), chart.kind in ("line", "step")

    def kept(values: FloatArray | None) -> int | None:
        if values is None:
            return None
        if chart.map is not None:
            return arrays.add(_single(values))
        return arrays.add(blocks(x, values)[1] if is_curve else values, series.quantity)

    data = {
        "name": series.name,
        "role": series.role,
        "values": kept(series.values),
        "leg": series.leg,
        "run": series.run,
        "component": series.component,
        "low": kept(series.low),
        "high": kept(series.high),
        "x": None if series.x is None else arrays.add(blocks(x, x)[0]),
        "members": None if series.members is None else arrays.add(series.members),
    }
    return {name: value for name, value in data.items() if value not in (None, "")}


def _member_data(report: Report, arrays: Arrays) -> dict[str, Any] | None:
    """The members of an ensemble, and their values of the metrics that have a chart; None without such."""
    titles = [chart.title for chart in report.charts]
    # the first chart is of the metric that the ensemble is judged by
    known = sorted((n for n in report.numbers if n.name in titles), key=lambda number: titles.index(number.name))
    numbers = [(number, number.members) for number in known if number.members is not None]
    ids = (series.members for chart in report.charts for series in chart.series if series.members is not None)
    members = next(ids, None)
    if not numbers or members is None:
        return None
    listed = [
        {
            "name": number.name,
            **_written(number.quantity),
            "smallIsWorse": number.small_is_worse,
            "values": arrays.add(values, number.quantity),
        }
        for number, values in numbers
    ]
    return {"ids": arrays.add(members), "repeat": report.repeat, "numbers": listed}


def _surface_data(surface: Surface, arrays: Arrays) -> dict[str, Any]:
    ends = zip(surface.names, surface.quantities, surface.low.tolist(), surface.high.tolist(), strict=True)
    return {
        "title": surface.title,
        "axes": [{**_written(quantity), "name": name, "low": low, "high": high} for name, quantity, low, high in ends],
        "vertices": arrays.add(_single(surface.vertices)),
        "triangles": arrays.add(surface.triangles),
        "values": arrays.add(_single(surface.values)),
        "of": {**_written(surface.quantity), "name": surface.name, "scale": surface.scale},
    }


def _scene_data(scene: Scene, arrays: Arrays) -> dict[str, Any]:
    in_frames = {name: getattr(scene, name) for name in ("time", *COLUMNS)}
    return {
        "name": scene.name,
        "run": scene.run,
        "base": scene.base_points.tolist(),
        "platform": scene.platform_points.tolist(),
        "lower": scene.lower,
        "upper": scene.upper,
        "home": scene.home.tolist(),
        "rows": scene.rows,
        "digits": scene.decimals,
        "nearnessOf": scene.nearness_of,
        "arrays": {name: arrays.add(values) for name, values in in_frames.items() if values is not None},
    }


def _clock(
    charts: Sequence[Chart], scenes: Sequence[Scene]
) -> tuple[dict[str, float], list[tuple[str, Role, list[tuple[float, float]]]]]:
    """The time that charts and scenes share, and what is on at any of it.

    Start and end [s], and the decimals in which it is shown; of each flag its name, the role that colours it, and when
    it is on: beginnings and lengths [%].
    """
    curves = [chart.x_of(series) for chart in charts if chart.is_over_time for series in chart.series]
    times = [time for time in (*(scene.time for scene in scenes), *curves) if len(time)] or [np.zeros(2)]
    start, end = min(float(time[0]) for time in times), max(float(time[-1]) for time in times)
    step = (end - start) / (max(2, *map(len, times)) - 1) or 1.0
    clock = {"start": start, "end": end, "digits": min(max(math.ceil(0.3 - math.log10(step)), 2), 6)}
    on = dict.fromkeys(flag.name for scene in scenes for flag in scene.flags if "1" in flag.values)
    flags = []
    for name, role in zip(on, cycle(_FLAGS), strict=False):
        parts = list[tuple[float, float]]()
        for scene in scenes:
            at = (100 * (scene.time - start) / (end - start or 1.0)).tolist()
            for values in (flag.values for flag in scene.flags if flag.name == name):
                spans = [(at[run.start()], at[run.end()]) for run in re.finditer("1+", values)]
                parts += [(round(first, 3), round(max(last - first, 0.1), 3)) for first, last in spans]
        flags.append((name.replace("_", " "), role, parts))
    return clock, flags


def _described(chart: Chart) -> str:
    """A chart in words, for screen readers."""
    quantity, over = chart.series[0].quantity, chart.map or Map()
    values = np.concatenate([series.values.ravel() for series in chart.series])
    held = np.isfinite(values) if over.inside is None else np.isfinite(values) & (over.inside.ravel() > 0)
    ends = quantity.range_text(*(float(end(values[held])) for end in (np.min, np.max))) if held.any() else ""
    said = f"values from {with_minus(ends)}" if ends else "no values"
    if chart.kind == "heat" and chart.y is not None:
        if over.classes:
            said = ", ".join(kind for k, kind in enumerate(over.classes) if (values == k).any())
        return f"Map of {chart.title} over {chart.x.title} and {chart.y.title}: {said}. Arrows go from value to value."
    names = [series.name for series in chart.series[:_MOST_NAMES]]
    also = [*(span.text for span in chart.spans), *(f"{s.name}, {percent(s.share)} of the time" for s in chart.strips)]
    return f"Chart of {chart.title} over {chart.x.title}: {'; '.join([*names, said, *also])}."


# --- filters of the templates ----------------------------------------------------------------------------------------


def _drawn(section: Section, first: Chart | None, beside: Sequence[Table]) -> list[Part]:
    """The parts of a section that are neither in the picture of the page nor beside it."""
    above = [id(part) for part in (first, *beside)]
    return [part for part in section.parts if id(part) not in above and not isinstance(part, Scene | Surface)]


def _neighbours(parts: Iterable[Part]) -> list[tuple[str, list[Part]]]:
    """Parts in order; neighbours of a kind share a grid."""
    kinds: dict[type, str] = {Chart: "charts", Table: "tables"}
    return [(kind, list(alike)) for kind, alike in groupby(parts, key=lambda part: kinds.get(type(part), "notes"))]


def _sides(table: Table) -> list[bool]:
    """Which columns are right-aligned."""
    texts = [table.texts(k) for k in range(len(table.rows))]
    columns = range(len(table.columns))
    return [k > 0 and is_at_right([row[k] for row in table.rows], [row[k] for row in texts]) for k in columns]


def _sort_value(cell: Cell) -> str:
    value = cell.value if isinstance(cell, Value) else cell
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return Markup(f' data-value="{float(value)!r}"') if is_number else ""  # type: ignore[arg-type]


def _link(file: str, text: str) -> Markup:
    """A link to a file in the page's folder, whose name may have marks of URLs; only the text of a path out of it."""
    is_inside = not file.startswith("/") and ".." not in file.split("/")
    shown = html.escape(text)
    return Markup(f'<a href="{quote(file)}">{shown}</a>' if is_inside else shown)


TEMPLATES.filters |= {
    "terms": with_terms,
    "explained": explained,
    "minus": with_minus,
    "id": id,
    "described": _described,
    "drawn": _drawn,
    "neighbours": _neighbours,
    "sides": _sides,
    "sort_value": _sort_value,
    "link": _link,
}
